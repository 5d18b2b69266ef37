"""Time and peak memory of `convert` on one table of CSV or Parquet that a map describes.

`python -m benchmarks.speed.conversion GB` writes the table of so many gigabytes of CSV, and the same as Parquet, into a
temporary folder, converts both and prints a table.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from solidtouch.models.seeds import Purpose, generator

from benchmarks.page import table

SEED, TAP, TAXELS, BLOCK = 1, 50, 12, 2000
"""Samples of a tap, taxels, and taps that are written at a time."""
MAP = ["--taxels", "s*", "--tap", "press", "--what", "object", "--where", "pos", "--time", "t"]
_COMMAND = """
import atexit, pathlib, re, sys
status = pathlib.Path("/proc/self/status")
atexit.register(lambda: print(re.search(r"VmHWM:\\s+(\\d+) kB", status.read_text())[1], file=sys.stderr))
from solidtouch.cli.main import run
run()
"""


def write_tables(folder: Path, size: float) -> int:
    """Writes `taps.csv` of that many bytes and `taps.parquet`; returns the number of taps."""
    import pandas as pd  # noqa: PLC0415
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.parquet as pq  # noqa: PLC0415

    taps, writer = 0, None
    with (folder / "taps.csv").open("w", encoding="utf-8") as file:
        while file.tell() < size:
            row = taps * TAP + np.arange(BLOCK * TAP)
            samples = generator(SEED, Purpose.REPEAT, 0, taps).integers(-40000, 40000, (len(row), TAXELS)) / 100
            tap = row // TAP
            frame = pd.DataFrame(
                {"t": row / 100, "object": np.char.add("rod ", (tap % 5).astype(str)), "pos": tap // 5 % 16 / 2}
                | {"press": tap}
                | {f"s{k}": samples[:, k] for k in range(TAXELS)}
            )
            frame.to_csv(file, header=not taps, index=False)
            part = pa.Table.from_pandas(frame, preserve_index=False)
            writer = writer or pq.ParquetWriter(folder / "taps.parquet", part.schema)
            writer.write_table(part)
            taps += BLOCK
    if writer is not None:
        writer.close()
    return taps


def converted(path: Path) -> tuple[float, float]:
    """Seconds and peak memory in MiB of the conversion of a table."""
    start = time.perf_counter()
    words = ["convert", path, path.with_name("out.nc"), "--force", *MAP]
    done = subprocess.run([sys.executable, "-c", _COMMAND, *words], capture_output=True, text=True, check=True)  # noqa: S603
    return time.perf_counter() - start, int(done.stderr.split()[-1]) / 1024


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("gigabytes", type=float, help="size of the CSV file")
    size = parser.parse_args().gigabytes * 1e9
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        taps = write_tables(folder, size)
        rows = []
        for kind in ("csv", "parquet"):
            seconds, peak = converted(path := folder / f"taps.{kind}")
            rows.append((kind, f"{path.stat().st_size / 1e9:.2g} GB", f"{seconds:.1f} s", f"{peak:.0f} MiB"))
    print(f"{taps} taps of {TAP} samples from {TAXELS} taxels")
    print(table(("table", "size", "time", "peak memory"), rows))


if __name__ == "__main__":
    main()
