"""Time a local sweep takes to start and to stop, and what is reported when a worker is killed.

Compares the processes and pipes of `analysis/tasks/local.py` with a Dask `LocalCluster` under the runner of
`analysis/tasks/dask.py`, each in a fresh process. The start of the first cell is the arrival of its outcome minus its
running time.
"""

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterator
from pathlib import Path

STUDY = """
name = "start"
trials = {trials}
thresholds = [0.95]
[[data]]
name = "paper"
preset = "paper"
[grid]
policy = ["active"]
seed = [0, 1, 2, 3, 4, 5, 6, 7]
"""
REPEATS = 7


def on_local_cluster(workers: int):
    """A runner on a Dask cluster of this machine, begun when the sweep asks for it."""

    def run(*call) -> Generator:
        from distributed import LocalCluster
        from solidtouch.analysis.tasks.dask import on_cluster

        how = {"threads_per_worker": 1, "processes": True, "dashboard_address": None, "host": "127.0.0.1"}
        with LocalCluster(n_workers=workers, **how) as cluster:
            yield from on_cluster(cluster.scheduler_address, 60.0, print)(*call)

    return run


def begin(kind: str, workers: int) -> None:
    """Runs the study and prints when its first cell began, in seconds after the command's start of the sweep."""
    from solidtouch.analysis.sweep.run import sweep
    from solidtouch.analysis.tasks.local import in_processes

    run = in_processes(workers) if kind == "pipes" else on_local_cluster(workers)
    times: list[float] = []

    def watched(*call) -> Iterator:
        times.append(time.perf_counter())
        for outcome in run(*call):
            times.append(time.perf_counter() - outcome.seconds)
            yield outcome
        times.append(time.perf_counter())

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.toml"
        path.write_text(STUDY.format(trials=2000), encoding="utf-8")
        began = time.perf_counter()
        sweep(path, path.with_suffix(".zarr"), watched)
        ended = time.perf_counter()
    print(json.dumps({"runner": times[0] - began, "cell": times[1] - began, "whole": ended - began}))


def work(number: int) -> int:
    """A task of which the third kills its process."""
    time.sleep(0.3)
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def blame(saturation: float, allowed: int) -> None:
    """Prints which of eight tasks the scheduler gives up, and how it says so."""
    import logging

    from dask import config
    from distributed import Client, LocalCluster, wait

    config.set(
        {
            "distributed.scheduler.worker-saturation": saturation,
            "distributed.scheduler.allowed-failures": allowed,
        }
    )
    how = {"threads_per_worker": 1, "processes": True, "dashboard_address": None, "silence_logs": logging.CRITICAL}
    with LocalCluster(n_workers=2, host="127.0.0.1", **how) as cluster, Client(cluster) as client:
        futures = [client.submit(work, number, key=("cell", number), pure=False) for number in range(8)]
        wait(futures)
        given_up = [number for number, future in enumerate(futures) if future.status == "error"]
        print(f"saturation {saturation:g}, allowed failures {allowed}: given up {given_up}")
        print(f"  {futures[3].exception()}")


def command(kind: str, *words: str) -> None:
    """The command `sweep`, with two workers of this kind."""
    from solidtouch.cli import main
    from solidtouch.cli import sweep as command_sweep

    if kind == "cluster":
        command_sweep._runner = lambda *_: on_local_cluster(2)
    sys.argv[1:] = ["sweep", *words, "--workers", "2"]
    main.run()


def stop(kind: str, number: signal.Signals) -> None:
    """Prints how long the command takes to end when it is told to amid cells of minutes, and what it says."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.toml"
        path.write_text(STUDY.format(trials=10_000_000), encoding="utf-8")
        call = [sys.executable, __file__, "--command", kind, str(path)]
        process = subprocess.Popen(call, stderr=subprocess.PIPE, text=True, start_new_session=True)  # noqa: S603
        time.sleep(9)
        began = time.perf_counter()
        os.killpg(process.pid, number)
        errors = process.communicate(timeout=60)[1]
        print(f"{kind}, {number.name}: exit code {process.returncode} after {time.perf_counter() - began:.1f} s, says:")
        print("  " + "\n  ".join(errors.splitlines()))


def main() -> None:
    """Prints medians and ranges of fresh processes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--blame", action="store_true", help="show which tasks the scheduler gives up instead of times")
    parser.add_argument("--stop", action="store_true", help="show how Ctrl-C and SIGTERM end it instead of times")
    parser.add_argument("--command", nargs=2, metavar=("KIND", "STUDY"), help=argparse.SUPPRESS)
    parser.add_argument("--once", nargs=2, metavar=("KIND", "WORKERS"), help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.once:
        begin(chosen.once[0], int(chosen.once[1]))
        return
    if chosen.command:
        command(*chosen.command)
        return
    if chosen.stop:
        for kind in ("pipes", "cluster"):
            for number in (signal.SIGINT, signal.SIGTERM):
                stop(kind, number)
        return
    if chosen.blame:
        for saturation, allowed in ((1.1, 3), (1.1, 0), (1.0, 0), (1.0, 3)):
            blame(saturation, allowed)
        return
    runs: dict[tuple[str, int], list[dict[str, float]]] = {}
    for _ in range(REPEATS):
        for kind, workers in (("pipes", 2), ("cluster", 2), ("cluster", 1)):
            call = [sys.executable, __file__, "--once", kind, str(workers)]
            said = subprocess.run(call, stdout=subprocess.PIPE, check=True, text=True).stdout  # noqa: S603
            runs.setdefault((kind, workers), []).append(json.loads(said.splitlines()[-1]))
    for (kind, workers), times in runs.items():
        for name in ("runner", "cell", "whole"):
            values = sorted(time[name] for time in times)
            print(f"{kind} {workers} {name}: {statistics.median(values):.2f} s ({values[0]:.2f} to {values[-1]:.2f})")


if __name__ == "__main__":
    main()
