"""`solidtouch trials`: any number of perception trials on recorded taps, with interim results."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

from typer import Argument, Option

from ..models.settings import PlaySettings
from .shared.interrupt import loading
from .shared.options import (
    Fields,
    Force,
    Missing,
    Seed,
    Story,
    TestSessions,
    Thresholds,
    TrainingTaps,
    Workers,
    parse_thresholds,
    spelled_out,
)
from .shared.report import show_page

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import RenderableType

    from ..analysis.trials.report import TrialsReport


@spelled_out
def trials(
    model: Annotated[Path, Argument(metavar="MODEL", help="Fitted model, from `fit`.", show_default=False)],
    taps: Annotated[
        Path,
        Argument(metavar="TAPS", help="Test taps; those that trained the model are left out.", show_default=False),
    ],
    number: Annotated[int, Option("--trials", metavar="N", min=1, help="Number of trials.")] = 100_000,
    play: Annotated[PlaySettings, Fields("passive", "fixation", "theta_x", "deadline", "border")] = PlaySettings(),
    start: Annotated[
        int | None, Option(help="Initial position as an index from 0; default: random.", show_default=False)
    ] = None,
    thresholds: Thresholds = None,
    test: TestSessions = None,
    training_taps: TrainingTaps = False,
    story: Story = None,
    missing: Missing = "refuse",
    seed: Seed = 0,
    device: Annotated[
        Literal["cpu", "gpu", "xla-cpu"],
        Option(help="Compiled loops on the CPU, or arrays on a GPU; xla-cpu runs the GPU code on the CPU."),
    ] = "cpu",
    workers: Workers = None,
    out: Annotated[Path | None, Option(metavar="FILE.nc", help="Save counts and means to this file.")] = None,
    force: Force = False,
) -> None:
    """Run any number of trials on TAPS in constant memory; print errors and reaction times."""
    if out is not None:
        from ..models.storage import check_netcdf_name, check_writable

        check_netcdf_name(out)
        check_writable(out, force)
    with loading():
        from ..analysis.trials.report import trials as run
        from ..models.splits import parse_sessions

    with _Shown() as shown:
        try:
            run(
                model,
                taps,
                number,
                play=play,
                start=start,
                stop=parse_thresholds(thresholds),
                sessions=parse_sessions(test, "--test"),
                training_taps=training_taps,
                missing=missing,
                story=story,
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
    """Results so far: interim ones on standard error, final ones on standard output, also after an interruption."""

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
        self._live.stop()
        if self.report is not None:
            show_page(self.report)

    def stage(self, name: str, total: int) -> "Callable[[int], None]":
        """Starts a progress bar; returns the function that advances it."""
        return partial(self._bars.advance, self._bars.add_task(name, total=total))

    def update(self, report: "TrialsReport") -> None:
        """Shows this report from now on."""
        self.report = report

    def _render(self) -> "RenderableType":
        from rich.console import Group

        from ..analysis.page.terminal import cut_to

        return self._bars if self.report is None else Group(*cut_to(self.report.page, self._live.console), self._bars)
