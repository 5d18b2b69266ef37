"""`solidtouch trials`: any number of perception trials on recorded taps, with results on the way."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

from typer import Argument, Option

from ..models.settings import PlaySettings
from .shared.interrupt import loading, terminable
from .shared.options import (
    Fields,
    Force,
    Seed,
    TestSessions,
    Thresholds,
    TrainingTaps,
    Workers,
    parse_thresholds,
    spelled_out,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import RenderableType

    from ..analysis.trials.report import TrialsReport


@spelled_out
def trials(
    model: Annotated[Path, Argument(metavar="MODEL", help="A fitted model, from `fit`.", show_default=False)],
    taps: Annotated[
        Path,
        Argument(metavar="TAPS", help="Test taps; those that trained the model are left out.", show_default=False),
    ],
    number: Annotated[int, Option("--trials", metavar="N", min=1, help="How many.")] = 100_000,
    play: Annotated[PlaySettings, Fields("passive", "fixation", "theta_x", "deadline", "border")] = PlaySettings(),
    start: Annotated[
        int | None, Option(help="Where class to begin in, from 0; default any.", show_default=False)
    ] = None,
    thresholds: Thresholds = None,
    test: TestSessions = None,
    training_taps: TrainingTaps = False,
    seed: Seed = 0,
    device: Annotated[
        Literal["cpu", "gpu", "xla-cpu"],
        Option(help="Compiled loops on the processor, or arrays on a GPU; xla-cpu runs the code of the latter."),
    ] = "cpu",
    workers: Workers = None,
    out: Annotated[Path | None, Option(metavar="FILE.nc", help="Keep counts and means in this file.")] = None,
    force: Force = False,
) -> None:
    """Plays trials on TAPS and counts errors and reaction times; memory does not grow with their number."""
    if out is not None:
        from ..models.storage import check_netcdf_name, check_writable

        check_netcdf_name(out)
        check_writable(out, force)
    with loading():
        from ..analysis.trials.report import trials as run
        from ..models.experiment import parse_sessions

    with terminable(), _Shown() as shown:
        try:
            run(
                model,
                taps,
                number,
                play=play,
                start=start,
                thresholds=parse_thresholds(thresholds),
                sessions=parse_sessions(test, "--test"),
                training_taps=training_taps,
                seed=seed,
                device=device,
                workers=workers,
                progress=shown.stage,
                hear=shown.update,
                note=partial(print, file=sys.stderr),
            )
        finally:
            if out is not None and shown.report is not None:
                shown.report.save(out, force)
    if shown.report is not None and shown.report.warning:
        print(shown.report.warning)


class _Shown:
    """The results so far: while they grow on standard error, in the end, also an early one, on standard output."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.live import Live

        from .shared.progress import progress_bars

        self.report: TrialsReport | None = None
        self._bars = progress_bars()
        self._live = Live(console=Console(stderr=True), get_renderable=self._render, transient=True)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        from rich.console import Console

        from ..analysis.page.terminal import show

        self._live.stop()
        if self.report is not None:
            show(self.report.page, Console())

    def stage(self, name: str, total: int) -> "Callable[[int], None]":
        """Begins a bar, and gives the function that advances it."""
        return partial(self._bars.advance, self._bars.add_task(name, total=total))

    def update(self, report: "TrialsReport") -> None:
        """Shows this report from now on."""
        self.report = report

    def _render(self) -> "RenderableType":
        from rich.console import Group

        from ..analysis.page.terminal import gist

        return self._bars if self.report is None else Group(*gist(self.report.page), self._bars)
