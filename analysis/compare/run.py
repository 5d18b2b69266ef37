"""Comparison of measurement models on the same taps at three levels: taps, classes and decisions."""

import time
from collections.abc import Callable, Sequence
from contextvars import copy_context
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.optimize  # noqa: F401 - a library that is loaded later would use all cores and round otherwise
import xarray as xr

from ...inference.trials.records import TapTable, tap_table
from ...inference.trials.resampling import RESAMPLES
from ...inference.trials.run import THRESHOLDS
from ...inference.trials.selections import sessions_in_words
from ...inference.tuning.tempering import fit_tempered
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.fits.portable import PortableFit
from ...models.measurement.generic.source import registered_of, take_over
from ...models.measurement.likelihood.bins import bin_edges
from ...models.measurement.model import Fitted
from ...models.measurement.registry import KINDS, NAMES, check_states, measurement_model, split_name, suited
from ...models.progress import Progress, ShownHere
from ...models.settings import FitSettings, PlaySettings
from ...models.taps import TapSet
from ...models.threads import cores, in_order, one_blas_thread
from ..page.ahead import draw_ahead, later
from ..page.figure_sizes import for_all_widths
from ..page.stages import StageClock
from ..stats.checks import REPLICATES, predictive_checks
from ..stats.decisions import at_equal_taps, decision_curves, planned, play_models
from ..tasks.crew import ONE_BY_ONE, Crew, on_threads
from ..tasks.kept import Kept
from .classes import class_scores
from .groups import UNITS, known_taps
from .left_out import LeftGroups, leave_out_groups
from .taps import leave_one_tap_out, stacked

if TYPE_CHECKING:
    from . import figures, figures_decisions, figures_taps
else:  # they load matplotlib
    figures, figures_decisions, figures_taps = later(__package__, "figures", "figures_decisions", "figures_taps")

_FEWEST_DRAWS = 100
FEWEST_RESAMPLES = 2


@dataclass(frozen=True)
class CompareSettings:
    """Everything that changes the numbers of a comparison, see `report.compare`.

    With `one_recording`, sessions of the same number in training and test taps are the same session. Groups left out
    are sessions, positions or objects, `leave_out`, in at most `folds` folds. Of sessions one fold is TEST alone, for
    which no model is fitted again. Intervals of what models classify and decide are from so many `resamples` of the
    test taps, and predictive checks from so many `replicates` of each model.
    """

    models: tuple[str, ...]
    fit: FitSettings = field(default_factory=FitSettings)
    draws: int = 400
    trials: int = 4000
    thresholds: tuple[float, ...] = THRESHOLDS
    play: PlaySettings = PlaySettings()
    seed: int = 0
    one_recording: bool = False
    leave_out: str = "session"
    folds: int = 6
    resamples: int = RESAMPLES
    replicates: int = REPLICATES


class Comparison(NamedTuple):
    """Results of a comparison.

    Attributes:
        grid: The classes.
        fits: Of every model that could be fitted, by name.
        learned: How the power of each was learned, where it was.
        refused: Why each of the others could not.
        seconds: How long each model took to fit to the training taps.
        left_out_taps: Over (model, tap), see `taps.leave_one_tap_out`; `None` where it was skipped.
        left_out_groups: Means over (model) of `left_out`, see `taps.mean_scores`; `None` without a second
            group. The attribute `unit` says what groups are.
        elpd: Log probabilities of the taps of groups left out by model, see `taps.relative_elpd`; nothing without a
            second group.
        stacking: ArviZ's comparison of these, a data frame; `None` with less than two models.
        groups: How groups were left out, in a sentence.
        missing: Why models have no value for groups left out, there are no predictive checks, or trials mix sessions.
        checks: See `stats.checks`; `None` where they were skipped.
        classes: See `classes`.
        curves: See `stats.decisions.decision_curves`.
        equal: See `stats.decisions.at_equal_taps`.
        test_taps: How many test taps all models were given.
        elapsed_s: Seconds per stage.
    """

    grid: ClassGrid
    fits: dict[str, Fitted]
    learned: dict[str, str]
    refused: dict[str, str]
    seconds: dict[str, float]
    left_out_taps: xr.Dataset | None
    left_out_groups: xr.Dataset | None
    elpd: dict[str, Any]
    stacking: Any
    groups: str
    missing: list[str]
    checks: xr.Dataset | None
    classes: xr.Dataset
    curves: xr.Dataset
    equal: xr.Dataset
    test_taps: int
    elapsed_s: dict[str, float]


@one_blas_thread()
def compare_models(
    train: TapSet,
    test: TapSet,
    grid: ClassGrid,
    settings: CompareSettings,
    progress: Progress,
    crew: Crew | None = None,
) -> Comparison:
    """Fits every model and compares those that can be fitted to the training taps, here or on a cluster.

    Raises:
        InputError: No model could be fitted, no test tap belongs to a class that all know, or a setting is wrong.
    """
    _check(settings)
    clock = StageClock(progress)
    for name in settings.models:
        check_states(name, train, grid)
    edges = _edges(train, grid, settings.fit)
    fit = settings.fit.changed(edges=edges, bins=edges.shape[-1] - 1)
    each = ONE_BY_ONE if crew is None else crew
    fits, learned, refused, seconds = _fit_all(settings.models, train, grid, fit, clock, crew)
    shared = _shared(fits, test)
    how = settings.folds, settings.one_recording, settings.seed
    left = LeftGroups(settings.leave_out, train, test, grid, fit, *how, _functions(settings.models), Kept())
    decide = partial(_decide, fits, shared, grid, settings, clock, each)

    def predict() -> tuple[Any, ...]:
        # First what leaves cores to `decide`, last what uses all of them to its end.
        checks, unchecked = _check_predictions(fits, train, grid, settings, clock, each)
        if checks is not None:
            draw_ahead([partial(figures_taps.predictive_checks, checks)])
        left_out = _leave_out_taps(fits, train, settings, clock, each)
        if left_out is not None:
            draw_ahead(for_all_widths(partial(figures_taps.pareto, left_out)))
        groups, *others = leave_out_groups(fits, left, clock, crew)
        if groups is not None:
            draw_ahead(for_all_widths(partial(figures_taps.groups_left_out, groups)))
        return left_out, checks, unchecked, groups, *others

    several = crew is None and all(split_name(name)[0] in KINDS for name in fits)  # as NumPyro runs in one thread
    parts: list[Callable[[], Any]] = [decide, partial(copy_context().run, predict)]
    decisions, predictions = in_order(parts, cores(None) if several else 1, lambda part: part is decide)
    classes, curves, equal, mixed = decisions
    left_out, checks, unchecked, groups, elpd, sentence, missing = predictions
    missing += [reason for reason in (unchecked, mixed) if reason]
    return Comparison(
        grid=grid,
        fits=fits,
        learned=learned,
        refused=refused,
        seconds=seconds,
        left_out_taps=left_out,
        left_out_groups=groups,
        elpd=elpd,
        stacking=stacked(elpd) if len(elpd) > 1 else None,
        groups=sentence,
        missing=missing,
        checks=checks,
        classes=classes,
        curves=curves,
        equal=equal,
        test_taps=len(shared),
        elapsed_s=clock.elapsed_s,
    )


def _check(settings: CompareSettings) -> None:
    """Refuses what would fail only after the work."""
    if not settings.models:
        raise InputError("--models must name at least one model.")
    if len(set(settings.models)) < len(settings.models):
        raise InputError(f"--models must name different models, got {','.join(settings.models)!r}.")
    if 0 < settings.draws < _FEWEST_DRAWS:
        raise InputError(f"--draws must be 0, or {_FEWEST_DRAWS} or more to look at tails, got {settings.draws}.")
    if settings.leave_out not in UNITS:
        raise InputError(f"--leave-out must be one of {', '.join(UNITS)}, got {settings.leave_out!r}.")
    least = 1 if settings.leave_out == "session" else 2
    if settings.folds < least:
        raise InputError(f"--folds must be at least {least}, got {settings.folds}.")
    for name in ("resamples", "replicates"):
        if getattr(settings, name) < FEWEST_RESAMPLES:
            raise InputError(f"{name} must be at least {FEWEST_RESAMPLES}, got {getattr(settings, name)}.")
    in_states = [name for name in settings.models if split_name(name)[1]]
    if settings.play.border == "prior" and in_states:
        raise InputError(
            "--border prior renormalises the belief and does not go with models that carry a state: "
            f"{', '.join(in_states)}."
        )


def _edges(train: TapSet, grid: ClassGrid, fit: FitSettings) -> Any:
    """The bins on which all models are judged: those of the training taps in the grid."""
    known = known_taps(train, grid, np.ones(grid.shape, dtype=bool))
    return bin_edges(known.taps, fit.bins, fit.value_range) if fit.edges is None else fit.edges


class _Training(NamedTuple):
    """What is fitted to, and how; with the functions of users among the models."""

    taps: TapSet
    grid: ClassGrid
    fit: FitSettings
    functions: dict[str, Any]
    progress: ShownHere


def _functions(names: Sequence[str]) -> dict[str, Any]:
    return registered_of(split_name(name)[0] for name in names)


def _fit(name: str, given: _Training) -> tuple[PortableFit | None, str, float]:
    """A fit, how its power was learned or why there is no fit, and how long it took."""
    take_over(given.functions)
    began = time.perf_counter()
    try:
        fitted, power = fit_tempered(name, given.taps, given.grid, suited(name, given.fit), progress=given.progress)
    except InputError as error:
        return None, str(error), time.perf_counter() - began
    return PortableFit(fitted), "" if power is None else power.sentence, time.perf_counter() - began


def _by_numpyro(name: str) -> bool:
    """Whether a fit runs NumPyro."""
    return getattr(measurement_model(split_name(name)[0]), "own_threads", name not in NAMES)


def _fit_all(
    names: Sequence[str], train: TapSet, grid: ClassGrid, fit: FitSettings, clock: StageClock, crew: Crew | None
) -> tuple[dict[str, Fitted], dict[str, str], dict[str, str], dict[str, float]]:
    fits: dict[str, Fitted] = {}
    learned: dict[str, str] = {}
    refused: dict[str, str] = {}
    seconds: dict[str, float] = {}
    given = _Training(train, grid, fit, _functions(names), ShownHere(clock.progress))
    order = sorted(names, key=lambda name: not _by_numpyro(name))  # one thread fits these, so they end last
    results = iter((on_threads(alone=_by_numpyro, ahead=len(names)) if crew is None else crew)(_fit, order, given))
    found: dict[str, tuple[PortableFit | None, str, float]] = {}
    for name in order:
        with clock.stage(f"Fitting {name}"):
            found[name] = next(results)
    for name in names:
        made, told, seconds[name] = found[name]
        if made is None:
            refused[name] = told
        else:
            fits[name] = made.fitted
            learned |= {name: told} if told else {}
    if not fits:
        raise InputError("No model can be fitted. " + " ".join(dict.fromkeys(refused.values())))
    return fits, learned, refused, seconds


def _shared(fits: dict[str, Fitted], test: TapSet) -> TapSet:
    """The test taps of classes that all models know."""
    first = next(iter(fits.values())).model
    first.check_taps(test.preprocessing)
    return known_taps(test, first.grid, np.all([fitted.model.trained for fitted in fits.values()], axis=0))


def _decide(
    fits: dict[str, Fitted], test: TapSet, grid: ClassGrid, settings: CompareSettings, clock: StageClock, crew: Crew
) -> tuple[xr.Dataset, xr.Dataset, xr.Dataset, str]:
    """Scores of beliefs, decisions at each threshold and at equal taps, and what trials mix, if they do."""
    with clock.stage("Scoring beliefs", len(fits)) as advance:
        tables = dict(zip(fits, crew(_table, map(PortableFit, fits.values()), test, advance), strict=True))
        classes = class_scores(tables, settings.seed, resamples=settings.resamples)
    draw_ahead(partial(draw, classes, grid) for draw in (figures.class_scores, figures.class_differences))
    table = next(iter(tables.values()))
    with clock.stage("Playing trials", planned(len(tables), grid, settings.trials, settings.resamples)) as advance:
        played = play_models(
            tables,
            grid,
            settings.thresholds,
            settings.trials,
            settings.seed,
            play=settings.play,
            resamples=settings.resamples,
            progress=advance,
        )
    curves, equal = decision_curves(played), at_equal_taps(played)
    drawn = partial(figures_decisions.decision_curves, curves, grid), partial(figures.decision_differences, equal, grid)
    draw_ahead((*drawn, partial(figures_decisions.miscalibration, curves)))
    return classes, curves, equal, sessions_in_words(table) if len(table.pool.count) == 1 else ""


def _check_predictions(
    fits: dict[str, Fitted], train: TapSet, grid: ClassGrid, settings: CompareSettings, clock: StageClock, crew: Crew
) -> tuple[xr.Dataset | None, str]:
    """Predictive checks, or why there are none."""
    if not settings.draws:
        return None, ""
    if np.isnan(train.taps).any():
        return None, "Predictive checks are left out, because training taps have missing samples."
    known = known_taps(train, grid, np.all([f.model.trained for f in fits.values()], axis=0))
    with clock.stage("Predictive checks", len(fits) * settings.replicates) as advance:
        return predictive_checks(fits, known, settings.seed, settings.replicates, advance, crew), ""


def _table(made: PortableFit, test: TapSet) -> TapTable:
    return tap_table(made.fitted.model, test)


class _SingleTaps(NamedTuple):
    """Training taps that are left out one by one, how many draws are taken, and their seed."""

    taps: TapSet
    draws: int
    seed: int


def _leave_out_taps_of(made: PortableFit, given: _SingleTaps) -> xr.Dataset:
    return leave_one_tap_out(made.fitted, given.taps, given.draws, given.seed)


def _leave_out_taps(
    fits: dict[str, Fitted], train: TapSet, settings: CompareSettings, clock: StageClock, crew: Crew
) -> xr.Dataset | None:
    with_posterior = {name: fitted for name, fitted in fits.items() if fitted.posterior is not None}
    if not settings.draws or not with_posterior:
        return None
    known = known_taps(
        train, next(iter(fits.values())).model.grid, np.all([f.model.trained for f in fits.values()], axis=0)
    )
    given = _SingleTaps(known, settings.draws, settings.seed)
    with clock.stage("Leaving out taps", len(with_posterior)) as advance:
        parts = list(crew(_leave_out_taps_of, map(PortableFit, with_posterior.values()), given, advance))
    names = xr.DataArray(np.array(list(with_posterior), dtype=np.str_), dims="model", name="model")
    return xr.concat(parts, dim=names, join="outer", data_vars="all").assign_attrs(draws=settings.draws)
