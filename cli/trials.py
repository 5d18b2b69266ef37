"""`solidtouch trials`: any number of perception trials on recorded taps, with results on the way."""

from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from typer import Argument, Option

from ..models.errors import InputError
from ..models.settings import PlaySettings
from .shared.interrupt import loading, terminable
from .shared.options import Fields, Force, Seed, TestSessions, TrainingTaps, Workers, parse_thresholds, spelled_out
from .shared.untrained import untrained

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import RenderableType

    from ..analysis.page.page import Page
    from ..analysis.trials.spread import TapSpread
    from ..inference.trials.tally import Tally


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
    thresholds: Annotated[str | None, Option(help="Belief thresholds, such as 0.5,0.9,0.99.")] = None,
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
    if play.passive and (play.fixation is not None or play.theta_x > 0):
        raise InputError("--passive never moves and does not go with --fixation or --theta-x.")
    if out is not None:
        from ..models.storage import check_netcdf_name, check_writable

        check_netcdf_name(out)
        check_writable(out, force)
    with loading():
        from ..analysis.stats.no_class_left import no_class_left_sentence
        from ..analysis.trials.page import tally_page
        from ..analysis.trials.spread import spread_trials, tap_spread
        from ..analysis.trials.tallied import tally_dataset
        from ..inference.moves.control import check_fixation
        from ..inference.trials.plan import tap_table
        from ..inference.trials.run import THRESHOLDS
        from ..inference.trials.tally import tally_trials
        from ..models.experiment import parse_sessions
        from ..models.io.load import load_taps
        from ..models.io.model_file import load_model
        from ..models.splits import select_sessions
        from ..models.storage import complete_file

    fitted = load_model(model)
    grid = fitted.grid
    recorded = select_sessions(load_taps(taps), parse_sessions(test, "--test"), "--test")
    tested = fitted.usable(untrained(fitted, recorded, training_taps))
    table = tap_table(fitted, tested)
    chosen = THRESHOLDS if thresholds is None else parse_thresholds(thresholds)
    if start is not None and not 0 <= start < grid.L:
        raise InputError(f"--start must be an index from 0 to {grid.L - 1}, got {start}.")
    point = check_fixation(play.fixation, grid.L)
    settings = {"theta_x": play.move_threshold, "border": play.border, "deadline": play.deadline, "seed": seed}
    about = {
        "model": model.name,
        "taps": f"{len(tested)} of {taps.name}",
        "policy": "passive" if play.passive else "active",
        "fixation": "none" if play.passive else grid.where_label(point),
        "start": "anywhere" if start is None else grid.where_label(start),
        **settings,
        "requested_trials": number,
        "solidtouch": version("solidtouch"),
    }
    rule = {"fixation": point, "where": start, "workers": workers, "play": play, "seed": seed}
    page_of = partial(tally_page, grid=grid, thresholds=chosen, what_for=_title(about))
    with terminable(), _Shown(page_of, number) as shown:
        spread = shown.spread(partial(tap_spread, table, grid, chosen, number, **rule), spread_trials(number))
        try:
            tally_trials(table, chosen, number, device=device, progress=shown.update, **rule)
        finally:
            if out is not None and shown.tally is not None:
                with complete_file(out, force) as temporary:
                    labelled = tally_dataset(shown.tally, grid, chosen, spread).assign_attrs(about)
                    labelled.to_netcdf(temporary, engine="h5netcdf")
    none_left = 0 if shown.tally is None else shown.tally.no_class_left.max() / shown.tally.trials
    if none_left > 0:
        print(no_class_left_sentence(none_left, fitted))


def _title(about: dict[str, Any]) -> str:
    """Which trials these are."""
    moves = "" if about["policy"] == "passive" else f" to {about['fixation']}, theta_X {about['theta_x']:g}"
    return (
        f"of {about['requested_trials']:,} trials, {about['policy']}{moves}, from {about['start']}, on "
        f"{about['taps']}; border {about['border']}, deadline {about['deadline']}, seed {about['seed']}"
    )


class _Shown:
    """The results so far: while they grow on standard error, in the end, also an early one, on standard output."""

    def __init__(self, page: "Callable[..., Page]", number: int) -> None:
        from rich.console import Console
        from rich.live import Live

        from .shared.progress import progress_bars

        self.tally: Tally | None = None
        self._page = page
        self._bars = progress_bars()
        self._task = self._bars.add_task("Playing trials", total=number)
        self._live = Live(console=Console(stderr=True), get_renderable=self._render, transient=True)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        from rich.console import Console

        from ..analysis.page.terminal import show

        self._live.stop()
        if self.tally is not None:
            show(self._page(self.tally), Console())

    def spread(self, play: "Callable[..., TapSpread]", total: int) -> "TapSpread":
        """Plays trials on resampled taps, with a bar, and shows intervals from now on."""
        bar = self._bars.add_task("Resampling test taps", total=total)
        spread = play(progress=partial(self._bars.advance, bar))
        self._page = partial(self._page, spread=spread)
        return spread

    def update(self, tally: "Tally") -> None:
        """Shows these counts from now on."""
        self.tally = tally
        self._bars.update(self._task, completed=tally.trials)

    def _render(self) -> "RenderableType":
        from rich.console import Group

        from ..analysis.page.terminal import gist

        return self._bars if self.tally is None else Group(*gist(self._page(self.tally)), self._bars)
