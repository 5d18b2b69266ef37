"""Counter-based random numbers by trial and tap, independent of the order of computation.

The counter of the generator (`philox`) holds the number of the block, what the numbers are for and the stream
of the trial, its key is the seed, so any processor can make any number at any time.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.errors import InputError

TAPS, STARTS, CHANCE = np.uint64(0), np.uint64(1), np.uint64(2)
"""Purposes of random numbers, each with its own numbers."""

LOW, HALF = np.uint64(0xFFFFFFFF), np.uint64(32)
_ROUNDS = 10
_MULTIPLIER0, _MULTIPLIER1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_INCREMENT0, _INCREMENT1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)

PER_BLOCK = 4
MOST_SEED, MOST_STREAM = 2**64 - 1, 2**63 - 1


def philox(c0: Any, c1: Any, c2: Any, c3: Any, k0: Any, k1: Any) -> tuple[Any, Any, Any, Any]:
    """Four random 32-bit words from four counter words and two key words, all held in unsigned 64-bit numbers.

    Philox4x32-10 of Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011. It runs as
    it stands on NumPy and JAX arrays and, compiled, on single numbers.
    """
    for _ in range(_ROUNDS):
        p0, p1 = _MULTIPLIER0 * c0, _MULTIPLIER1 * c2
        c0, c1, c2, c3 = (p1 >> HALF) ^ c1 ^ k0, p1 & LOW, (p0 >> HALF) ^ c3 ^ k1, p0 & LOW
        k0, k1 = (k0 + _INCREMENT0) & LOW, (k1 + _INCREMENT1) & LOW
    return c0, c1, c2, c3


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
        purpose: `TAPS`, `STARTS` or `CHANCE`.
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
