"""Peak memory: of a process that plays many trials, and of commands on recordings larger than memory.

`python -m benchmarks.speed.memory TRIALS` prints the peak of the trials in MiB. `--recordings GB...` writes recordings
of these sizes into a temporary folder and runs `convert`, `inspect`, `fit` and `trials` on them, or with
`--models NAME...` fits of these models.
"""

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.inference.episode import DEADLINE
from solidtouch.inference.trials.tally import tally_trials
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.seeds import Purpose, generator
from solidtouch.models.settings import PlaySettings
from solidtouch.models.taps import TapSet

from benchmarks.speed.trials.job import POLICIES, SEED, paper_table

THRESHOLD = 0.995
TAP = 400, 100, 50, 10
"""Samples, taxels, positions and objects of the recordings."""
LIMIT = 2 * 10**9
"""Bytes of data that a command may hold, see `setrlimit(2)`, RLIMIT_DATA; twice as many if these are not enough."""
_COMMAND = """
import atexit, pathlib, re, resource, sys
resource.setrlimit(resource.RLIMIT_DATA, (int(sys.argv[1]), int(sys.argv.pop(1))))
status = pathlib.Path("/proc/self/status")
atexit.register(lambda: print(re.search(r"VmHWM:\\s+(\\d+) kB", status.read_text())[1], file=sys.stderr))
from solidtouch.cli.main import run
run()
"""
_BLOCK = 100  # taps made at a time
_COMMANDS = (
    ("convert", "taps.nc", "copy.nc", "--source", "copied"),
    ("inspect", "taps.nc"),
    ("fit", "taps.nc", "other.nc", "--out", "histogram.nc"),
    ("fit", "taps.nc", "other.nc", "--model", "gaussian", "--out", "gaussian.nc"),
    ("trials", "histogram.nc", "taps.nc", "--training-taps", "--trials", "1000"),
)


class CommandPeak(NamedTuple):
    """What a command on a recording took.

    Attributes:
        command: Its words.
        gigabytes: Size of the recording.
        seconds: From start to end.
        processor: Seconds of processor time.
        mebibytes: Peak resident memory.
        load: Load average over the minute before.
        limit: Bytes of data that it could hold.
    """

    command: str
    gigabytes: float
    seconds: float
    processor: float
    mebibytes: float
    load: float
    limit: int


def peaks(quick: bool = False) -> dict[int, float]:
    """Peak resident memory in MiB of a process of its own, by the number of passive trials that it plays."""
    return {trials: _peak(trials) for trials in ((100,) if quick else (10**5, 10**7))}


def stream(trials: int, policy: str) -> int:
    """Plays and counts trials of the paper's job on one core; returns the number of useful taps."""
    table = paper_table()
    options = {
        "fixation": (len(table.log_prior) - 1) // 2,
        "play": PlaySettings(theta_x=POLICIES[policy], deadline=DEADLINE),
        "seed": SEED,
        "workers": 1,
    }
    tally = tally_trials(table, THRESHOLD, trials, **options)
    return int(tally.taps[0] @ range(tally.taps.shape[1]))


def write_recording(path: Path, N: int, J: int, K: int, L: int, M: int, repetition: int = 0) -> None:
    """Writes N taps in single precision, in turn under each of L x M classes, of which few are in memory at a time.

    A tap is a bump in time and over the taxels, at the place of its position and of the height of its object, in noise
    of standard deviation 1.
    """
    import dask.array as da  # noqa: PLC0415

    where, what = np.divmod(np.arange(N) % (L * M), M)
    time_course = np.exp(-(np.linspace(-3, 3, J, dtype=np.float32)[:, None] ** 2))
    taxel = np.arange(K, dtype=np.float32) / K

    def block(block_info: dict) -> NDArray[np.float32]:
        taps = slice(*block_info[None]["array-location"][0])
        samples = generator(SEED, Purpose.REPEAT, repetition, taps.start).standard_normal(
            (taps.stop - taps.start, J, K), dtype=np.float32
        )
        place = np.exp(-(((taxel - where[taps, None].astype(np.float32) / L) * 4) ** 2))
        return samples + (1 + what[taps, None, None]).astype(np.float32) * place[:, None] * time_course

    step = [_BLOCK] * (N // _BLOCK) + [N % _BLOCK] * (N % _BLOCK > 0)
    samples = da.map_blocks(block, chunks=(tuple(step), (J,), (K,)), dtype=np.float32, meta=np.empty((0,) * 3, "f4"))
    labels = TapSet.from_arrays(
        np.zeros((N, J, 1), np.int8),
        what,
        [f"rod {m + 1} mm" for m in range(M)],
        preprocessing=Preprocessing(samples=J, rate_hz=1000.0),
        where=where.astype(np.float64),
        where_unit="mm",
        source="simulated bumps",
    )
    labels.dataset.assign(taps=(("tap", "sample", "taxel"), samples)).to_netcdf(path, engine="h5netcdf")


def recordings(sizes: Sequence[float], commands: Sequence[Sequence[str]] = _COMMANDS) -> list[CommandPeak]:
    """Commands on recordings of these sizes in GB, in processes that may hold `LIMIT` bytes of data."""
    J, K, L, M = TAP
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_recording(folder / "other.nc", L * M, J, K, L, M, 1)
        for size in sizes:
            write_recording(folder / "taps.nc", round(size * 1e9 / (4 * J * K)), J, K, L, M)
            for words in commands:
                found.append(_measured(words, size, folder))
                print(found[-1], file=sys.stderr)
            for file in folder.iterdir():
                if file.name != "other.nc":
                    file.unlink()
    return found


def recording_table(found: Sequence[CommandPeak]) -> str:
    """Time, rate and peak memory by command and size."""
    from benchmarks.page import table  # noqa: PLC0415 - its figures would be in the memory of trials

    lines = [
        [
            f"`solidtouch {one.command}`",
            f"{one.gigabytes:g} GB",
            f"{one.seconds:.1f} s",
            f"{one.processor:.1f} s",
            f"{1e3 * one.gigabytes / one.seconds:.0f} MB/s",
            f"{one.mebibytes:.0f} MiB",
            f"{one.limit / 1e9:g} GB",
            f"{one.load:.1f}",
        ]
        for one in found
    ]
    head = ["command", "recording", "time", "processor time", "rate", "peak memory", "may hold", "load before"]
    return table(head, lines)


def _measured(words: Sequence[str], size: float, folder: Path, limit: int = LIMIT) -> CommandPeak:
    load = os.getloadavg()[0]
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-c", _COMMAND, str(limit), *words]
    # Where pyarrow is installed, pandas loads it, and it reserves 1 GiB of addresses that it does not use.
    env = os.environ | {"ARROW_DEFAULT_MEMORY_POOL": "system"}
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=env)  # noqa: S603
    seconds, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode and "not enough memory" in done.stderr and limit == LIMIT:
        return _measured(words, size, folder, 2 * limit)
    if done.returncode:
        raise RuntimeError(f"solidtouch {' '.join(words)} failed:\n{done.stderr}")
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return CommandPeak(" ".join(words), size, seconds, processor, int(done.stderr.split()[-1]) / 1024, load, limit)


def _peak(trials: int) -> float:
    words = [sys.executable, "-m", "benchmarks.speed.memory", str(trials)]
    return float(subprocess.run(words, capture_output=True, text=True, check=True).stdout)  # noqa: S603


def _own_peak() -> float:
    """Of this process in MiB."""
    status = Path("/proc/self/status")
    if status.is_file():  # on Linux the other way may tell the peak of the process that started this one
        return int(re.search(r"VmHWM:\s+(\d+) kB", status.read_text(encoding="utf-8"))[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024**2 if sys.platform == "darwin" else 1024)


def main() -> None:
    """Measures as the command line says."""
    if sys.argv[1].isdecimal():
        stream(int(sys.argv[1]), "passive")
        print(_own_peak())
        return
    from benchmarks.page import parsed, write_block  # noqa: PLC0415

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=float, nargs="+", metavar="GB", required=True, help="sizes in GB")
    parser.add_argument("--models", nargs="+", metavar="NAME", default=(), help="models to fit, and nothing else")
    options = parsed(parser, "recordings", "recordings-models")
    fits = [("fit", "taps.nc", "--model", name, "--out", f"{name}.nc") for name in options.models]
    text = recording_table(recordings(options.recordings, fits or _COMMANDS))
    print(text)
    write_block(options.document, "recordings-models" if fits else "recordings", text)


if __name__ == "__main__":
    main()
