"""Any number of trials on recorded taps: the function `solidtouch.trials` and its report."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ...inference.moves.control import check_fixation
from ...inference.trials.records import tap_table
from ...inference.trials.run import check_device, checked_thresholds
from ...inference.trials.tally import Tally, tally_trials
from ...models.errors import InputError, check_counts
from ...models.grid import ClassGrid
from ...models.io.load import TapSource, named, names_of, taps_of
from ...models.io.model_file import ModelSource, model_of
from ...models.measurement.model import TapModel
from ...models.progress import Progress, no_progress
from ...models.settings import Missing, PlaySettings
from ...models.splits import missing_sentence, select_sessions
from ...models.storage import complete_file, room_for, write_netcdf
from ...models.training import untrained_taps
from ..experiment.data_warnings import one_object
from ..page.page import Page
from ..page.report import Report
from ..stats.no_class_left import no_class_left_sentence
from ..stats.tallied import QUANTITIES, tally_means
from .page import tally_page
from .spread import TapSpread, spread_trials, tap_spread


@dataclass(frozen=True, eq=False, repr=False)
class TrialsReport(Report):
    """Counted trials and their means, with intervals over test taps.

    Attributes:
        found: All counts.
        spread: Trials on resampled and on fresh taps.
        model: The fitted model.
        thresholds: theta_W.
        about: What was asked for, as the attributes of the file hold it.
    """

    found: Tally
    spread: TapSpread
    model: TapModel
    thresholds: tuple[float, ...]
    about: dict[str, Any]

    def _page(self) -> Page:
        about = self.about
        moves = "" if about["policy"] == "passive" else f" to {about['fixation']}, theta_X {about['theta_x']:g}"
        which = (
            f"of {about['requested_trials']:,} trials, {about['policy']}{moves}, from {about['start']}, on "
            f"{about['taps']}; border {about['border']}, deadline {about['deadline']}, seed {about['seed']}"
        )
        return tally_page(self.found, self.model.grid, self.thresholds, which, self.spread)

    @property
    def warning(self) -> str:
        """Warning about trials in which no class was left, or about a single object; empty without them."""
        share = self.found.no_class_left.max() / self.found.trials
        grid = self.model.grid
        sentences = [no_class_left_sentence(share, self.model)] if share > 0 else []
        return " ".join([*sentences, *one_object(grid, range(grid.M))])

    @property
    def results(self) -> xr.Dataset:
        """Counts and means with their intervals, see `tally_dataset`."""
        return tally_dataset(self.found, self.model.grid, self.thresholds, self.spread).assign_attrs(self.about)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Writes `results` to a NetCDF file, whole or not at all.

        Raises:
            InputError: The file cannot be written.
        """
        with complete_file(path, force, room_for(self.results)) as temporary:
            write_netcdf(self.results, temporary)


def trials(
    model: ModelSource,
    taps: TapSource,
    number: int = 100_000,
    *,
    move: str | None = None,
    stop: float | Sequence[float] | None = None,
    play: PlaySettings = PlaySettings(),
    start: int | None = None,
    sessions: Sequence[int] | None = None,
    training_taps: bool = False,
    missing: Missing = "refuse",
    story: Callable[..., Any] | str | None = None,
    seed: int = 0,
    device: str = "cpu",
    workers: int | None = None,
    progress: Progress = no_progress,
    hear: Callable[[TrialsReport], object] = lambda report: None,  # noqa: ARG005
    note: Callable[[str], object] = lambda sentence: None,  # noqa: ARG005
) -> TrialsReport:
    """Plays trials on recorded taps and counts errors and reaction times; memory does not grow with their number.

    >>> import solidtouch as st
    >>> train, test = st.simulate("paper", sessions=2, seed=4)
    >>> report = st.trials(st.fit(train), test, 1000, stop=[0.5, 0.95])
    >>> report.results["taps"].round(1).values.tolist()
    [2.4, 14.7]

    Args:
        model: A fitted model or its file.
        taps: Test taps or their file; those that trained the model are left out.
        number: How many trials.
        move: `"fixation"` or `"passive"`; `None` for what `play` says.
        stop: The belief threshold, theta_W, or several; `None` for those of the paper's range.
        play: How they are played; `stop` takes the place of its threshold.
        start: Position that all begin in, as index; `None` for any.
        sessions: Sessions of the taps to take; `None` for all.
        training_taps: Whether taps that trained the model are kept.
        missing: What to do with samples of a file that are NaN: `"refuse"` or `"drop"` them; tap sets remember it.
        story: Function of the user's that the file of the model needs, as in `load_model`.
        seed: Random seed.
        device: `"cpu"`, `"gpu"`, or `"xla-cpu"` for the code of the latter on the processor.
        workers: Threads; `None` for as many as there are cores.
        progress: Called with the name and size of every stage; returns the function that advances it.
        hear: Called several times with the report of the trials so far.
        note: Called with a sentence about taps that trained the model, if any.

    Raises:
        InputError: The model, the taps or a setting cannot be used.
    """
    check_counts(trials=number, workers=workers)
    check_counts(0, start=start, seed=seed)
    theta = checked_thresholds(stop)
    if move is not None:
        if move not in ("fixation", "passive"):
            raise InputError(f"move must be 'fixation' or 'passive', got {move!r}.")
        play = play.changed(passive=move == "passive")
    if play.passive and (play.fixation is not None or play.theta_x > 0):
        raise InputError("--passive never moves and does not go with --fixation or --theta-x.")
    fitted = model_of(model, story=story)
    called = Path(model).name if isinstance(model, str | Path) else "model"
    grid = fitted.grid
    chosen = select_sessions(taps_of(taps, missing), None if sessions is None else [*sessions], "--test")
    with named(taps):
        fitted.check_tapset(chosen)
    tested, sentence = untrained_taps(chosen, fitted.training, training_taps)
    with named(taps):
        tested = fitted.usable(tested)
    lacking = missing_sentence([tested], "test taps")
    for line in filter(None, (sentence, lacking and f"Note: {lacking}")):
        note(line)
    check_device(device)
    with _computed_on(device):
        table = tap_table(fitted, tested)
    if start is not None and not 0 <= start < grid.L:
        raise InputError(f"--start must be an index from 0 to {grid.L - 1}, got {start}.")
    point = check_fixation(play.fixation, grid.L)
    about = {
        "model": called,
        "taps": f"{len(tested)} taps of {Path(*names_of([taps])).name}",
        "policy": "passive" if play.passive else "active",
        "fixation": "none" if play.passive else grid.where_label(point),
        "start": "anywhere" if start is None else grid.where_label(start),
        "theta_x": play.move_threshold,
        "border": play.border,
        "deadline": play.deadline,
        "seed": seed,
        "requested_trials": number,
        "solidtouch": version("solidtouch"),
    }
    rule: dict[str, Any] = {"fixation": point, "where": start, "workers": workers, "play": play, "seed": seed}
    advance = progress("Resampling test taps", spread_trials(number))
    spread = tap_spread(table, grid, theta, number, progress=advance, **rule)
    advance, played = progress("Playing trials", number), 0

    def told(tally: Tally) -> None:
        nonlocal played
        advance(tally.trials - played)
        played = tally.trials
        hear(report(tally))

    report = partial(TrialsReport, spread=spread, model=fitted, thresholds=theta, about=about)
    return report(tally_trials(table, theta, number, device=device, progress=told, **rule))


def _computed_on(device: str) -> AbstractContextManager[None]:
    """Where JAX makes tables of functions; other models do without it."""
    if device != "gpu":
        return nullcontext()
    from ...models.measurement.fits.device import on_device  # noqa: PLC0415 - JAX takes half a second to import

    return on_device(device)


def tally_dataset(tally: Tally, grid: ClassGrid, thresholds: ArrayLike, spread: TapSpread | None = None) -> xr.Dataset:
    """The counts and the means with labels.

    Args:
        tally: The counts.
        grid: The classes.
        thresholds: theta_W, shape (H,).
        spread: Trials on resampled and on fresh taps.

    Returns:
        The means (theta), with `spread` also the ends of their 95% intervals over test taps as ``<name>_low`` and
        ``<name>_high``, and all of that on fresh taps as ``fresh_<name>``, with ``fresh_used_up``; ``confusion``
        (theta, what, decided_what), ``place`` (theta, where, decided_where) and ``reaction_time`` (theta, tap) as
        counts; attributes ``trials``, ``what_unit``, ``where_unit``.
    """
    what_name = np.asarray(grid.what_name, dtype=np.str_)
    where = {"where": grid.where_value, "decided_where": grid.where_value}
    means = tally_means(tally, grid)
    return xr.Dataset(
        {name: ("theta", values, {"long_name": QUANTITIES[name]}) for name, values in means.items()}
        | (_spread_variables(means, spread) if spread else {})
        | {
            "confusion": (("theta", "what", "decided_what"), tally.what),
            "place": (("theta", "where", "decided_where"), tally.where),
            "reaction_time": (("theta", "tap"), tally.taps),
        },
        {
            "theta": np.asarray(thresholds, dtype=np.float64),
            "what": what_name,
            "decided_what": what_name,
            "tap": np.arange(tally.taps.shape[1]),
            **where,
        },
        {"trials": tally.trials, "what_unit": grid.what_error_unit, "where_unit": grid.where_unit},
    )


def _spread_variables(means: dict[str, NDArray[np.float64]], spread: TapSpread) -> dict[str, tuple[Any, ...]]:
    variables: dict[str, tuple[Any, ...]] = {
        "fresh_used_up": ("theta", spread.used_up, {"long_name": "fraction of trials that used up the taps of a class"})
    }
    for name, samples in spread.fresh.items():
        variables[f"fresh_{name}"] = "theta", samples[:, 0], {"long_name": f"{QUANTITIES[name]}, on fresh taps"}
    for prefix, intervals in (("", spread.intervals(means)), ("fresh_", spread.fresh_intervals())):
        for name, ends in intervals.items():
            for side, end in zip(("low", "high"), ends, strict=True):
                words = f"{'lower' if side == 'low' else 'upper'} end of the 95% interval over test taps"
                variables[f"{prefix}{name}_{side}"] = "theta", end, {"long_name": words}
    return variables
