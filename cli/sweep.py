"""`solidtouch sweep`: a study over a grid of settings, on this machine or a cluster."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..analysis.tasks.crew import PATIENCE_S
from .shared.interrupt import loading
from .shared.options import Patience, Scheduler

if TYPE_CHECKING:
    from rich.console import Console

    from ..analysis.sweep.run import SweepProgress


def sweep(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY", help="Definition of the study, study.toml.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Zarr store to write or continue; default: STUDY.zarr.", show_default=False),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; default: one per core.", show_default=False)
    ] = None,
    scheduler: Scheduler = None,
    patience: Patience = PATIENCE_S,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Run cells again that failed before.")] = False,
) -> None:
    """Run all unfinished cells of STUDY and save each as it finishes; exit code 1 if some failed."""
    with loading():
        from rich.console import Console

        from ..analysis.sweep.report import sweep as run_sweep

    console = Console(stderr=True)
    say = partial(console.print, highlight=False, markup=False)
    with _progress(console) as (hear, heard):
        try:
            report = run_sweep(
                study,
                out,
                workers=workers,
                scheduler=scheduler,
                patience=patience,
                retry_failed=retry_failed,
                hear=hear,
                note=say,
            )
        except BaseException:
            if heard:
                store = out or study.with_suffix(".zarr")
                say(f"{store}: {heard[-1].counts}; run the same command to continue.")
            raise
    print("\n".join(report.sentences))
    if report.found.failed:
        raise typer.Exit(1)


@contextmanager
def _progress(console: "Console") -> Iterator[tuple[Callable[["SweepProgress"], None], list["SweepProgress"]]]:
    """Function that shows a tally, as a bar or as lines without a terminal, and a list with the last tally."""
    from .shared.progress import LINE_S, progress_bars

    bars = progress_bars()
    seen: list[SweepProgress] = []
    task = bars.add_task("Cells", total=None)
    said = time.monotonic()

    def show(tally: "SweepProgress") -> None:
        nonlocal said
        seen[:] = [tally]
        if console.is_terminal:
            bars.start()
            failed = f", {tally.failed} failed" if tally.failed else ""
            bars.update(task, description=f"Cells{failed}", total=tally.cells, completed=tally.ended)
        elif time.monotonic() - said > LINE_S or tally.ended == tally.cells:
            said = time.monotonic()
            console.print(tally.counts, highlight=False)

    try:
        yield show, seen
    finally:
        if bars.live.is_started:
            bars.stop()
