"""Short digests of taps, by which a model identifies its training taps."""

import hashlib

import numpy as np
from numpy.typing import NDArray

_BYTES = 8


def tap_digests(taps: NDArray[np.floating]) -> NDArray[np.uint64]:
    """Digest of each tap (N, J, K), equal for equal values in single or double precision, shape (N,)."""
    digests = (hashlib.blake2b(np.asarray(tap, np.float64).tobytes(), digest_size=_BYTES).digest() for tap in taps)
    return np.frombuffer(b"".join(digests), dtype="<u8").astype(np.uint64)
