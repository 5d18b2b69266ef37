"""Random numbers that belong to a trial and a tap, not to the order of the work: Philox4x32-10.

Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011. The counter holds the number
of the block, what the numbers are for and the stream of the trial, the key is the seed, so any processor can make any
number at any time. The arithmetic is written once, on unsigned 64-bit words, and runs as it stands on NumPy and JAX
arrays and, compiled, on single numbers.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

TAPS, STARTS = 0, 1
"""What numbers are for; each purpose has numbers of its own."""

PER_BLOCK = 4
ROUNDS = 10
_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_MULTIPLIERS = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_INCREMENTS = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)


def philox(c0: Any, c1: Any, c2: Any, c3: Any, k0: Any, k1: Any) -> tuple[Any, Any, Any, Any]:
    """Four random 32-bit words from four counter words and two key words, all held in 64 bits."""
    for _ in range(ROUNDS):
        p0, p1 = _MULTIPLIERS[0] * c0, _MULTIPLIERS[1] * c2
        c0, c1, c2, c3 = (p1 >> _HALF) ^ c1 ^ k0, p1 & _LOW, (p0 >> _HALF) ^ c3 ^ k1, p0 & _LOW
        k0, k1 = (k0 + _INCREMENTS[0]) & _LOW, (k1 + _INCREMENTS[1]) & _LOW
    return c0, c1, c2, c3


def key(seed: int) -> tuple[np.uint64, np.uint64]:
    """The two key words of a seed from 0 to 2^64 - 1."""
    return np.uint64(seed & 0xFFFFFFFF), np.uint64(seed >> 32 & 0xFFFFFFFF)


def words(seed: int, stream: ArrayLike, purpose: int, first: int, count: int) -> NDArray[np.uint64]:
    """Random 32-bit words number `first` to `first + count - 1` of streams.

    Args:
        seed: From 0 to 2^64 - 1.
        stream: Numbers of the streams, shape (n,).
        purpose: `TAPS` or `STARTS`.
        first: A multiple of `PER_BLOCK`.
        count: How many.

    Returns:
        Shape (n, count), values below 2^32.
    """
    stream = np.atleast_1d(np.asarray(stream)).astype(np.uint64)[:, np.newaxis]
    block = np.arange(first // PER_BLOCK, -(-(first + count) // PER_BLOCK)).astype(np.uint64)
    parts = philox(block, np.uint64(purpose), stream & _LOW, stream >> _HALF, *key(seed))
    return np.stack(np.broadcast_arrays(*parts), axis=-1).reshape(len(stream), -1)[:, :count]


def below(word: Any, count: Any) -> Any:
    """A number from 0 to `count` - 1 from a 32-bit word, all as likely to within count / 2^32."""
    return (word * count) >> _HALF


def uniform(word: Any) -> Any:
    """A number in [0, 1) from a 32-bit word, with which `floor(u * count)` is `below(word, count)`."""
    return word / 2.0**32
