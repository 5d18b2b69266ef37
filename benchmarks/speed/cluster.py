"""Overhead of a Dask cluster on this machine, and what that makes of a study of 10^12 tap-updates on many cores.

Processes have one thread each. Tasks that stand for work sleep, so that more processes than cores can be tried; what
the client, the scheduler and the workers do themselves shares the cores of this machine.
"""

import argparse
import logging
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from distributed import LocalCluster
from solidtouch.analysis.sweep.cell import run_cell
from solidtouch.analysis.sweep.cells import CellGrid, Effort
from solidtouch.analysis.sweep.data import Sources
from solidtouch.analysis.sweep.run import one_thread
from solidtouch.analysis.sweep.study import parse_study
from solidtouch.analysis.tasks.crew import crew_of

from benchmarks.page import parsed, table, write_block
from benchmarks.speed.report import machine_list
from benchmarks.speed.rows import machine
from benchmarks.speed.sweep import batches_of_one, study

PROCESSES = (2, 4, 8)
UPDATES = 1e12
CORES = (10, 100, 1000)
LONG_S, SHARED_MB = 0.5, 64
TRIALS = 1_000_000
_PER_PROCESS = 8  # long tasks


class Overhead(NamedTuple):
    """Overhead with a number of processes, medians of the rounds, in seconds.

    Attributes:
        processes: How many.
        first: From the call to the result of a single task, with the connection.
        batch: Per task, each a batch of its own.
        task: Per task, in batches that grow to half a second.
        efficiency: Share of the time of the processes in tasks of half a second.
        data: To send what tasks share to a process.
        fresh: The first cell of a sweep in new processes, each of which has its own.
    """

    processes: int
    first: float
    batch: float
    task: float
    efficiency: float
    data: float
    fresh: float


def nothing(item: int, _: Any) -> int:
    """A task without work."""
    return item


def long(item: int, _: Any) -> int:
    """A task that takes half a second of no core."""
    time.sleep(LONG_S)
    return item


def cell(trials: int, _: Any) -> tuple[float, float]:
    """Processor seconds and tap-updates of a cell of active trials in the paper's task, after one that compiles."""
    parsed_study = parse_study(study(trials, 1))
    sources = Sources(parsed_study, Path())
    one, data = CellGrid.of(parsed_study, tuple(sources.keys)).cell(0), sources.load("paper")
    effort = Effort(trials, parsed_study.thresholds, parsed_study.deadline)
    run_cell(one, data, effort._replace(trials=100))
    began = time.process_time()
    values = run_cell(one, data, effort)
    return time.process_time() - began, trials * float(values["taps"].max())


def seconds(work: Callable[[Any, Any], Any], items: Iterable[Any], address: str, shared: Any = None) -> float:
    """Time of all tasks, with the connection."""
    began = time.perf_counter()
    for _ in crew_of(address, None, 60.0)(work, items, shared):
        pass
    return time.perf_counter() - began


def overhead(processes: int, quick: bool) -> Overhead:
    """Measures a cluster of this many processes."""
    rounds, few, many = (1, 20, 200) if quick else (3, 200, 5000)
    how: dict[str, Any] = {"threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.CRITICAL}
    with one_thread(), LocalCluster(n_workers=processes, host="127.0.0.1", processes=True, **how) as cluster:
        address = cluster.scheduler_address
        cluster.wait_for_workers(processes)
        fresh = seconds(cell, [10] * processes, address)
        found = []
        for _ in range(rounds):
            first = seconds(nothing, [0], address)
            with batches_of_one():
                batch = (seconds(nothing, range(few), address) - first) / few
            task = (seconds(nothing, range(many), address) - first) / many
            bare = seconds(long, range(_PER_PROCESS * processes), address)
            data = seconds(nothing, [0], address, np.sqrt(np.arange(SHARED_MB << 17))) - first
            found.append((first, batch, task, _PER_PROCESS * LONG_S / (bare - first), data))
    return Overhead(processes, *(median(each) for each in zip(*found, strict=True)), fresh)


def overhead_table(found: Iterable[Overhead]) -> str:
    """The overheads as a table."""
    head = "processes", *(str(one.processes) for one in found)
    rows = {
        "one task, with the connection, s": [f"{one.first:.2f}" for one in found],
        "per batch of one task, ms": [f"{1e3 * one.batch:.1f}" for one in found],
        "per task in batches of up to 0.5 s, ms": [f"{1e3 * one.task:.2f}" for one in found],
        f"share of the time in tasks of {LONG_S:g} s": [f"{one.efficiency:.2f}" for one in found],
        f"{SHARED_MB} MB that tasks share to a process, s": [f"{one.data:.2f}" for one in found],
        "first cell of a sweep in every new process, s": [f"{one.fresh:.1f}" for one in found],
    }
    return table(head, ([name, *values] for name, values in rows.items()))


def estimate(update_s: float, batch_s: float, start_s: float) -> str:
    """How long a study takes on numbers of cores, from the time of a tap-update, of a batch and of the first cell."""
    lines = []
    for cores in CORES:
        work = UPDATES * update_s / cores
        for tasks in (1, 10, 100):
            whole = start_s + max(work, cores * tasks * batch_s)
            lines.append(
                [
                    f"{cores:,}",
                    f"{tasks}",
                    f"{work / tasks:,.2g}" if work / tasks < 10 else f"{work / tasks:,.0f}",
                    f"{work:,.0f}",
                    f"{cores * tasks * batch_s:,.1f}",
                    f"{whole:,.0f}",
                    f"{work / whole:.2f}",
                ]
            )
    head = "cores", "batches per core", "seconds of a batch", "work, s", "scheduler, s", "in all, s", "efficiency"
    return table(head, lines)


def main() -> None:
    """Prints the tables and writes them into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="tiny sizes, to test that everything runs")
    options = parsed(parser, "overhead", "estimate")
    load = os.getloadavg()[0]
    cells = [cell(2000 if options.quick else TRIALS, None) for _ in range(1 if options.quick else 5)]
    update, number = median(spent / updates for spent, updates in cells), UPDATES / cells[0][1]
    found = [overhead(processes, options.quick) for processes in PROCESSES[: 1 if options.quick else None]]
    last = found[-1]
    where = "\n".join(machine_list(machine()).splitlines()[:2])
    loads = f"- load {load:.1f} before, {os.getloadavg()[0]:.1f} after, which includes the benchmark itself"
    first = f"{where}\n{loads}\n\n{overhead_table(found)}"
    second = (
        f"- a tap-update in a cell of {TRIALS:,} active trials of the paper's task: {1e9 * update:.0f} ns of processor "
        f"time, so 10^12, in {number:,.0f} such cells, take {UPDATES * update / 3600:.1f} core-hours\n"
        f"- a batch: {1e3 * last.batch:.1f} ms of client, scheduler and worker ({last.processes} processes)\n"
        f"- the first cell of a new process: {found[0].fresh:.1f} s ({found[0].processes} processes)\n\n"
        f"{estimate(update, last.batch, found[0].fresh)}"
    )
    print(f"{first}\n\n{second}")
    write_block(options.document, "overhead", first)
    write_block(options.document, "estimate", second)


if __name__ == "__main__":
    main()
