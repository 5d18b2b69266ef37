"""Writes a recording of many classes and samples, too large to be compared with the caches of a processor.

`python -m benchmarks.speed.commands.large FILE TAPS SAMPLES TAXELS POSITIONS OBJECTS`
"""

import sys
from pathlib import Path

import numpy as np
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet

RATE_HZ = 1000.0
SEED = 20


def large_recording(N: int, J: int, K: int, L: int, M: int) -> TapSet:
    """Taps in single precision, in turn under each of L x M classes: a bump whose height and width tell the class."""
    random = np.random.default_rng(SEED)
    cell = np.arange(N) % (L * M)
    where, what = np.divmod(cell, M)
    time, taxel = np.linspace(-3, 3, J, dtype=np.float32)[:, None], np.arange(K, dtype=np.float32)
    taps = random.standard_normal((N, J, K), dtype=np.float32)
    for n, (l, m) in enumerate(zip(where, what, strict=True)):
        taps[n] += np.float32(10 * (1 + m)) * np.exp(-(time**2)) * np.exp(-(((taxel / K - np.float32(l / L)) * 4) ** 2))
    return TapSet.from_arrays(
        taps,
        what,
        [f"rod {m + 1} mm" for m in range(M)],
        preprocessing=Preprocessing(samples=J, rate_hz=RATE_HZ),
        where=where.astype(np.float64),
        where_unit="mm",
    )


if __name__ == "__main__":
    large_recording(*map(int, sys.argv[2:])).save(Path(sys.argv[1]))
