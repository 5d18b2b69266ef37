"""Overhead of a sweep: time per cell, writing, listing, and efficiency with two workers.

Times run from the first to the last finished cell, so starting processes does not count. The overhead of a cell is the
worker time not spent in cells, per cell.
"""

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from solidtouch.analysis.sweep.cell import run_cell
from solidtouch.analysis.sweep.cells import Cell, CellGrid, Effort
from solidtouch.analysis.sweep.data import Sources
from solidtouch.analysis.sweep.result import open_sweep
from solidtouch.analysis.sweep.run import one_thread, sweep
from solidtouch.analysis.sweep.store import QUANTITIES, create_store
from solidtouch.analysis.sweep.study import parse_study
from solidtouch.analysis.tasks import batches as task_batches
from solidtouch.analysis.tasks.dask import on_cluster
from solidtouch.analysis.tasks.local import in_processes
from solidtouch.analysis.tasks.task import Load, Outcome, Runner, Work
from solidtouch.inference.trials.run import THRESHOLDS

STUDY = """
name = "benchmark"
trials = {trials}
thresholds = {thresholds}
[[data]]
name = "paper"
preset = "paper"
[grid]
policy = ["active"]
seed = {seeds}
"""


def study(trials: int, cells: int) -> str:
    """A study of equal cells."""
    return STUDY.format(trials=trials, thresholds=list(THRESHOLDS), seeds=list(range(cells)))


def trials_for(seconds: float) -> int:
    """How many trials make a cell of about this long, compiled and with likelihoods at hand."""
    trials = 2000
    parsed = parse_study(study(trials, 1))
    sources = Sources(parsed, Path())
    cell, data = CellGrid.of(parsed, tuple(sources.keys)).cell(0), sources.load("paper")
    effort = Effort(trials, parsed.thresholds, parsed.deadline)
    run_cell(cell, data, effort)
    began = time.perf_counter()
    run_cell(cell, data, effort)
    return max(1, round(trials * seconds / (time.perf_counter() - began)))


def timed(run: Runner, workers: int, trials: int, cells: int) -> tuple[float, float]:
    """Seconds of all workers per cell, and those that the cell took itself, after the first quarter of the cells."""
    came: list[tuple[float, float]] = []

    def watched(cells: Iterator[Cell], work: Work, load: Load) -> Generator[Outcome]:
        for outcome in run(cells, work, load):
            yield outcome
            came.append((time.perf_counter(), outcome.seconds))

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.toml"
        path.write_text(study(trials, cells), encoding="utf-8")
        tally = sweep(path, path.with_suffix(".zarr"), watched)
    if tally.done < cells:
        raise RuntimeError(f"{tally.failed} cells failed")
    skipped = min(max(workers, cells // 4), cells - 1)  # they wait for compilation and the first likelihoods
    when, own = np.transpose(came)
    return workers * (when[-1] - when[skipped - 1]) / (cells - skipped), float(np.mean(own[skipped:]))


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    """The address of a scheduler with workers of one thread."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    calls = [["scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]]
    calls += [["worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]] * workers
    with tempfile.TemporaryDirectory() as folder, one_thread():
        processes = [
            subprocess.Popen(  # noqa: S603
                [sys.executable, "-m", "dask", *call], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            for call in calls
        ]
        try:
            yield address
        finally:
            for process in processes:
                process.kill()
                process.wait()


def on_two_workers(trials: int, cells: int, workers: int = 2) -> tuple[float, float]:
    """`timed` on a Dask cluster of this machine."""
    with cluster(workers) as address:
        return timed(on_cluster(address, 60.0, print), workers, trials, cells)


@contextmanager
def batches_of_one() -> Iterator[None]:
    """Has every cell travel alone."""
    most, task_batches._MOST = task_batches._MOST, 1
    try:
        yield
    finally:
        task_batches._MOST = most


def store_costs(cells: int) -> dict[str, float]:
    """Time to write a cell and to list it at resume, and what it takes on disk."""
    axes = (("paper",), ("histogram",), (100,), ("global",), (0.01,), ("J",), ("uniform",), ("active",), (7,))
    grid = CellGrid((*axes, tuple(range(cells)), (0,)))
    values = {name: np.random.default_rng(0).random(len(THRESHOLDS)) for name in QUANTITIES}
    with tempfile.TemporaryDirectory() as folder:
        store = create_store(Path(folder) / "s.zarr", grid, THRESHOLDS, {"paper": ("mm", "mm")}, {})
        before = sum(1 for _ in store.path.rglob("*"))
        began = time.perf_counter()
        for number in range(cells):
            store.write(Outcome(number, values, 1.0))
        wrote = time.perf_counter()
        store.status()
        listed = time.perf_counter()
        open_sweep(store.path)["what_error"].load()
        read = time.perf_counter()
        files = list(store.path.rglob("c.*"))
        sizes = np.array([file.stat().st_size for file in files])
        blocks = np.array([file.stat().st_blocks * 512 for file in files])
        count = (sum(1 for _ in store.path.rglob("*")) - before) / cells
    return {
        "write, µs per cell": 1e6 * (wrote - began) / cells,
        "list at resume, µs per cell": 1e6 * (listed - wrote) / cells,
        "read one quantity with xarray, µs per cell": 1e6 * (read - listed) / cells,
        "files per cell": count,
        "bytes per cell": sizes.sum() / cells,
        "bytes on disk per cell": blocks.sum() / cells,
    }


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=12000, help="short cells, for the overhead")
    parser.add_argument("--stored", type=int, default=20000, help="cells, for the store")
    parser.add_argument("--long", type=int, default=24, help="long cells, for the efficiency")
    parser.add_argument("--seconds", type=float, default=2.0, help="duration of a long cell")
    options = parser.parse_args()
    table = Table("what", "figure")
    for name, figure in store_costs(options.stored).items():
        table.add_row(name, f"{figure:.0f}")
    small = {
        "1 local process": timed(in_processes(1), 1, 10, options.cells),
        "2 local processes": timed(in_processes(2), 2, 10, options.cells),
        "2 Dask workers": on_two_workers(10, options.cells),
    }
    with batches_of_one():
        small["2 Dask workers, batches of one cell"] = on_two_workers(10, max(8, options.cells // 6))
    for name, (spent, own) in small.items():
        table.add_row(f"cell of {1e3 * own:.1f} ms, {name}: overhead, ms per cell", f"{1e3 * (spent - own):.2f}")
    trials = trials_for(options.seconds)
    one, _ = timed(in_processes(1), 1, trials, options.long)
    long = {
        "2 local processes": timed(in_processes(2), 2, trials, options.long),
        "2 Dask workers": on_two_workers(trials, options.long),
    }
    for name, (spent, own) in long.items():
        table.add_row(f"cell of {own:.2f} s, {name}: time of 1 / (2 x time of 2)", f"{one / spent:.2f}")
        table.add_row(f"cell of {own:.2f} s, {name}: share of the time in cells", f"{own / spent:.3f}")
    Console(width=100).print(table)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
