"""`solidtouch sweep`: a study over a grid of settings, on this machine or on a cluster."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .shared.interrupt import loading, terminable

if TYPE_CHECKING:
    from rich.console import Console

    from ..analysis.sweep.cell import Runner
    from ..analysis.sweep.run import SweepProgress


def sweep(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="The study.toml of the grid.", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option(help="The Zarr store to write or to continue; default STUDY.zarr.", show_default=False),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; default one per core.", show_default=False)
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Run on the Dask cluster with this scheduler instead.")
    ] = None,
    patience: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="Seconds to wait for a scheduler and workers that are gone.")
    ] = 300.0,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Try cells again that failed before.")] = False,
) -> None:
    """Runs all cells of STUDY that are not done yet and writes each as it finishes; exit code 1 if some failed."""
    from ..analysis.sweep.threads import one_thread
    from ..models.errors import InputError

    if scheduler is not None and workers is not None:
        raise InputError("--workers goes without --scheduler, whose cluster has workers of its own.")
    with loading(), one_thread():
        from rich.console import Console

        from ..analysis.sweep.run import sweep as run_sweep

    out = study.with_suffix(".zarr") if out is None else out
    console = Console(stderr=True)
    with terminable(), _progress(console) as (tallied, seen):
        say = partial(console.print, highlight=False, markup=False)
        runner = _runner(scheduler, workers, patience, say)
        try:
            tally = run_sweep(study, out, runner, retry_failed=retry_failed, progress=tallied, note=say)
        except BaseException:
            if seen:
                console.print(
                    f"{out} holds {_counts(seen[-1])}; the same command goes on with the rest.",
                    highlight=False,
                    markup=False,
                )
            raise
    print(f"{out}: {_counts(tally)}.")
    if tally.failed:
        for cause in tally.causes:
            print(f"Failed with: {cause}")
        print("The tracebacks stand in the store; --retry-failed tries these cells again.")
        raise typer.Exit(1)


def _runner(scheduler: str | None, workers: int | None, patience: float, note: Callable[[str], None]) -> "Runner":
    from ..analysis.sweep.local import in_processes, in_this_process

    if scheduler is not None:
        from ..analysis.sweep.dask import on_cluster

        return on_cluster(scheduler, patience, note)
    workers = workers or _cores()
    return in_this_process if workers == 1 else in_processes(workers)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _counts(tally: "SweepProgress") -> str:
    failed = f", {tally.failed} failed" if tally.failed else ""
    return f"{tally.done} of {tally.cells} cells{failed}"


@contextmanager
def _progress(console: "Console") -> Iterator[tuple[Callable[["SweepProgress"], None], list["SweepProgress"]]]:
    """A function that shows a tally, and a list that holds the last one; a bar, or lines where there is no terminal."""
    from .shared.progress import LINE_S, progress_bars

    bars = progress_bars()
    seen: list[SweepProgress] = []
    task = bars.add_task("Cells", total=None)
    said = time.monotonic()

    def show(tally: "SweepProgress") -> None:
        nonlocal said
        seen[:] = [tally]
        ended = tally.done + tally.failed
        if console.is_terminal:
            bars.start()
            failed = f", {tally.failed} failed" if tally.failed else ""
            bars.update(task, description=f"Cells{failed}", total=tally.cells, completed=ended)
        elif time.monotonic() - said > LINE_S or ended == tally.cells:
            said = time.monotonic()
            console.print(_counts(tally), highlight=False)

    try:
        yield show, seen
    finally:
        bars.stop()
