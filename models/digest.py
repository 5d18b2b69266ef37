"""Short digests of taps, by which a model knows the taps that trained it."""

import hashlib

import numpy as np
from numpy.typing import NDArray

_BYTES = 8


def tap_digests(taps: NDArray[np.floating]) -> NDArray[np.uint64]:
    """A number for each tap (N, J, K), the same for the same values in single or double precision, shape (N,)."""
    digests = (hashlib.blake2b(np.asarray(tap, np.float64).tobytes(), digest_size=_BYTES).digest() for tap in taps)
    return np.frombuffer(b"".join(digests), dtype="<u8").astype(np.uint64)
