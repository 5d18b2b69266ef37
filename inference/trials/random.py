"""Counter-based random numbers by trial and tap, independent of the order of computation.

The counter of the generator (`kernel.philox`) holds the number of the block, what the numbers are for and the stream
of the trial, its key is the seed, so any processor can make any number at any time.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.errors import InputError
from .kernel import HALF, LOW, philox

PER_BLOCK = 4
MOST_SEED, MOST_STREAM = 2**64 - 1, 2**63 - 1


def key(seed: int) -> tuple[np.uint64, np.uint64]:
    """Two key words of a seed.

    Raises:
        InputError: It is not a whole number from 0 to 2^64 - 1.
    """
    if int(seed) != seed or not 0 <= seed <= MOST_SEED:
        raise InputError(f"The seed must be an integer from 0 to {MOST_SEED}, got {seed}.")
    word = np.uint64(int(seed))
    return word & LOW, word >> HALF


def words(seed: int, stream: ArrayLike, purpose: np.uint64, first: int, count: int) -> NDArray[np.uint64]:
    """Random 32-bit words number `first` to `first + count - 1` of streams.

    Args:
        seed: From 0 to 2^64 - 1.
        stream: Numbers of the streams, shape (n,).
        purpose: `kernel.TAPS`, `kernel.STARTS` or `kernel.CHANCE`.
        first: A multiple of `PER_BLOCK`.
        count: How many.

    Returns:
        Shape (n, count), values below 2^32.
    """
    stream = np.atleast_1d(np.asarray(stream)).astype(np.uint64)[:, np.newaxis]
    block = np.arange(first // PER_BLOCK, -(-(first + count) // PER_BLOCK)).astype(np.uint64)
    parts = philox(block, purpose, stream & LOW, stream >> HALF, *key(seed))
    return np.stack(np.broadcast_arrays(*parts), axis=-1).reshape(len(stream), -1)[:, :count]


def below(word: Any, count: Any) -> Any:
    """Integer from 0 to `count` - 1 from a 32-bit word, uniform to within count / 2^32."""
    return (word * count) >> HALF


def uniform(word: Any) -> Any:
    """Number in [0, 1) from a 32-bit word, such that `floor(u * count)` is `below(word, count)`."""
    return word / 2.0**32
