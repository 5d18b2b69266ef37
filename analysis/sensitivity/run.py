"""Sensitivity study: the same trials on the same data under each option, and under pairs of options."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...inference.trials.records import TapTable, TrialPlan, Trials, plan_trials, tap_table
from ...inference.trials.resampling import spread
from ...inference.trials.run import THRESHOLDS, run_trials
from ...models.grid import ClassGrid
from ...models.measurement.histogram import HistogramModel
from ...models.measurement.model import TapModel
from ...models.progress import Progress
from ...models.seeds import data_set_seed
from ...models.settings import PlaySettings
from ...models.splits import Fold
from ...models.taps import TapSet
from ...models.threads import check_wanted, one_blas_thread
from ..experiment.settings import SHOWN_THETA
from ..experiment.sources import Source
from ..stats.jackknife import Interval, Means
from ..stats.resampled_units import left_out_units, resampled_tables, units_of
from ..tasks.crew import THREADS, Crew
from ..tasks.kept import Kept
from .choices import CHOICES, Catalogue, Choice, Option, Reading, applicable, changed
from .effects import Effect, Scale, absolute, effect, interaction, intervals_of
from .model import histograms, impossible_share, with_reading
from .trials import OpenTrials, play_open

type Options = tuple[Option, ...]


@dataclass(frozen=True)
class SensitivitySettings:
    """Settings of a sensitivity study, see `report.sensitivity`; `choices` are tried."""

    trials: int = 1000
    seed: int = 0
    strongest: int = 5
    choices: tuple[Choice, ...] = CHOICES


class Pair(NamedTuple):
    """Two options of different choices together."""

    first: tuple[Choice, Option]
    second: tuple[Choice, Option]
    beyond: Interval
    together: Interval


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Results for one source of data.

    Attributes:
        source: The data.
        catalogue: What was tried.
        scale: Thresholds, policies and number of intervals.
        default: `QUANTITIES` of each policy under the defaults.
        reference: The effect of the default against itself, which holds its advantages.
        shares: Mean of `SUMS` at `SHOWN_THETA`, under the defaults and each option, shape (policy, `SUMS`).
        effects: One for each of `catalogue.options`.
        impossible: Share of test taps that are impossible under their own class, one for each option.
        pairs: Of the strongest options.
    """

    source: Source
    catalogue: Catalogue
    scale: Scale
    default: dict[tuple[str, str], Interval]
    reference: Effect
    shares: tuple[NDArray[np.float64], ...]
    effects: tuple[Effect, ...]
    impossible: tuple[float, ...]
    pairs: tuple[Pair, ...]

    def strength(self, index: int) -> float:
        """How much an option changes the object error of the last policy, by which choices are ranked."""
        return abs(self.effects[index].change[self.scale.policies[-1], "what_error"].value)

    def strongest_first(self) -> list[tuple[Choice, int]]:
        """Choices, each with the number of its strongest option, by the strength of that."""
        return _strongest(self.catalogue, [self.strength(i) for i in range(len(self.effects))])


def sensitivity_study(
    source: Source, settings: SensitivitySettings, progress: Progress, crew: Crew = THREADS
) -> Sensitivity:
    """Runs every option, then all pairs of the strongest, on the threads or the cluster given.

    Raises:
        InputError: The data cannot be used.
    """
    catalogue = applicable(source.grid, source.samples, simulated=source.simulated, choices=settings.choices)
    pairs_expected = settings.strongest * (settings.strongest - 1) // 2
    scale = Scale(
        np.array(THRESHOLDS),
        source.policies,
        intervals_of(source.policies) * len(catalogue.options) + 2 * pairs_expected,
    )
    single: list[Options] = [(), *((option,) for _, option in catalogue.options)]
    means, impossible = _run(source, single, settings, progress, crew, f"{source.name}: options")
    base = Reading()
    readings = [changed(options) for options in single]
    effects = [effect(means[0], m, r, base, scale) for m, r in zip(means, readings, strict=True)]
    at = THRESHOLDS.index(SHOWN_THETA)
    strength = [abs(one.change[scale.policies[-1], "what_error"].value) for one in effects[1:]]
    strongest = [index for _, index in _strongest(catalogue, strength)[: settings.strongest]]
    return Sensitivity(
        source,
        catalogue,
        scale,
        absolute(means[0], base, scale),
        effects[0],
        tuple(m.mean(axis=0)[:, at] for m in means),
        tuple(effects[1:]),
        tuple(impossible[1:]),
        tuple(_pairs(source, catalogue, strongest, means, scale, settings, progress, crew)),
    )


def play_reading(
    reading: Reading,
    table: TapTable,
    test: TapSet,
    grid: ClassGrid,
    theta_x: float,
    trials: int,
    seed: int,
    first_stream: int = 0,
) -> NDArray[np.float64]:
    """`SUMS` of every trial at every threshold under a reading, shape (trials, theta, `SUMS`).

    Args:
        reading: How the paper is read.
        table: The test taps.
        test: The same taps.
        grid: The classes.
        theta_x: Threshold for a move.
        trials: How many.
        seed: Of starts and taps.
        first_stream: Random stream of the first trial; the others follow.
    """
    plan = plan_trials(table.pool, trials, seed, reading.fixation_index(grid.L), first_stream=first_stream)
    if reading.start == "in turn":
        cells = np.argwhere(table.pool.count > 0)
        session, where, what = cells[np.arange(trials) % len(cells)].T
        plan = plan._replace(where=where, what=what, session=session)
    if _compiled(reading):
        played = run_trials(
            table,
            plan,
            THRESHOLDS,
            play=PlaySettings(theta_x=theta_x, border=reading.border, deadline=reading.deadline),
            seed=seed,
            workers=1,
        )
        where_error = grid.where_error(played.where, played.true_where)
        return _sums(reading, played, plan, where_error, grid, np.zeros(trials, np.bool_))
    done = play_open(table, plan, THRESHOLDS, reading, theta_x, seed)
    return _sums(reading, done.trials, plan, _where_error(reading, done, plan, test, grid), grid, done.impossible)


def _compiled(reading: Reading) -> bool:
    """Whether the compiled trials know a reading."""
    return (
        (reading.clamping, reading.order, reading.where_error) == ("command", "before", "class")
        and reading.replacement
        and reading.pseudocount > 0
    )


def _where_error(
    reading: Reading, done: OpenTrials, plan: TrialPlan, test: TapSet, grid: ClassGrid
) -> NDArray[np.float64]:
    trials = done.trials
    if reading.where_error == "tap":
        if grid.where_place is not None:
            return grid.where_error(trials.where, grid.where_index(test.where[done.tap]))
        return np.abs(grid.where_value[trials.where] - test.where[done.tap])
    if reading.where_error == "start":
        first = np.clip(trials.where - done.shifted, 0, grid.L - 1)
        return grid.where_error(first, np.broadcast_to(plan.where[:, np.newaxis], first.shape))
    return grid.where_error(trials.where, trials.true_where)


def _sums(
    reading: Reading,
    trials: Trials,
    plan: TrialPlan,
    where_error: NDArray[np.float64],
    grid: ClassGrid,
    impossible: NDArray[np.bool_],
) -> NDArray[np.float64]:
    what = plan.what[:, np.newaxis]
    counted = trials.stopped if reading.at_deadline == "left out" else np.ones_like(trials.stopped)
    values = (
        np.ones(what.shape),
        grid.what_error(trials.what, what),
        where_error,
        trials.taps,
        trials.what != what,
        np.maximum(1.0 - trials.belief, 0.0),
    )
    every = (trials.stopped, trials.clamped > 0, np.broadcast_to(impossible[:, np.newaxis], trials.stopped.shape))
    return np.stack([*(value * counted for value in values), *every], axis=-1).astype(np.float64)


class _Bench:
    """One fold with the tables of its test taps, which many readings share."""

    def __init__(self, source: Source, number: int) -> None:
        self._source, self._number = source, number
        self._folds: Kept[Fold] = Kept()
        self._histograms: Kept[HistogramModel] = Kept()
        self._tables: Kept[tuple[TapModel, TapSet, TapTable]] = Kept()

    def table(self, reading: Reading) -> tuple[TapModel, TapSet, TapTable]:
        """The model, the usable test taps and their log-likelihoods."""
        hz = reading.highpass_hz
        bins = hz, reading.bins, reading.value_range
        key = (*bins, reading.power, reading.pseudocount, reading.added, reading.outside)

        def made() -> tuple[TapModel, TapSet, TapTable]:
            fold = self._folds(hz, lambda: self._source.load(self._number, hz))
            counts = self._histograms(bins, lambda: histograms(reading, fold.train, self._source.grid))
            model = with_reading(reading, counts)
            test = model.usable(fold.test)
            return model, test, tap_table(model, test)

        return self._tables(key, made)


class _Tried(NamedTuple):
    """What all tasks of a source need: readings by number, and the fold that tasks in one process are at."""

    source: Source
    readings: Sequence[Reading]
    settings: SensitivitySettings
    benches: Kept[_Bench]


def _play_fold(item: tuple[int, Sequence[int]], tried: _Tried) -> list[tuple[Means, float]]:
    """Means of the units of a fold (batch, policy, theta, `SUMS`) and the share of impossible taps under readings."""
    (number, chosen), source = item, tried.source
    bench = tried.benches(number, lambda: _Bench(source, number))
    trials, seed = tried.settings.trials, data_set_seed(tried.settings.seed, number)
    played = []
    for reading in (tried.readings[i] for i in chosen):
        check_wanted()
        model, test, table = bench.table(reading)
        play = partial(_play_policies, source, reading, test, trials, seed)
        means = [play(one, i * trials) for i, one in enumerate(resampled_tables(table, source.resamples, seed))]
        impossible = impossible_share(model, test) if reading.pseudocount == 0 else 0.0
        played.append((units_of(means, spread(table)), impossible))
    return played


def _play_policies(
    source: Source, reading: Reading, test: TapSet, trials: int, seed: int, table: TapTable, first_stream: int
) -> NDArray[np.float64]:
    """Mean `SUMS` of the trials of each policy, shape (policy, theta, `SUMS`)."""
    theta_x = [1.0 if policy == "passive" else reading.theta_x for policy in source.policies]
    played = (play_reading(reading, table, test, source.grid, x, trials, seed, first_stream) for x in theta_x)
    return np.stack([sums.mean(axis=0) for sums in played])


def _run(
    source: Source, tried: Sequence[Options], settings: SensitivitySettings, progress: Progress, crew: Crew, name: str
) -> tuple[list[Means], list[float]]:
    """Means of all units and mean shares of impossible taps, for each of the combinations of options.

    A task is a fold or, where there is one only, a combination.
    """
    every, together = range(len(tried)), source.folds > 1
    items = [(i, every) for i in range(source.folds)] if together else [(0, [i]) for i in every]
    shared = _Tried(source, [changed(options) for options in tried], settings, Kept(1))
    with one_blas_thread():
        played = list(crew(_play_fold, items, shared, progress(name, len(items))))
    units = zip(*played, strict=True) if together else played
    means, impossible = zip(*(zip(*of, strict=True) for of in units), strict=True)
    joined = [left_out_units(one) if source.left_out else one for one in map(np.concatenate, means)]
    return joined, np.mean([*zip(*impossible, strict=True)], axis=0).tolist()


def _strongest(catalogue: Catalogue, strength: Sequence[float]) -> list[tuple[Choice, int]]:
    best: dict[str, tuple[Choice, int]] = {}
    for index, (choice, _) in enumerate(catalogue.options):
        if choice.name not in best or strength[index] > strength[best[choice.name][1]]:
            best[choice.name] = choice, index
    return sorted(best.values(), key=lambda pair: -strength[pair[1]])


def _pairs(
    source: Source,
    catalogue: Catalogue,
    strongest: Sequence[int],
    means: Sequence[Means],
    scale: Scale,
    settings: SensitivitySettings,
    progress: Progress,
    crew: Crew,
) -> Iterator[Pair]:
    both = list(combinations(strongest, 2))
    if not both:
        return
    options = catalogue.options
    tried = [(options[i][1], options[j][1]) for i, j in both]
    joint, _ = _run(source, tried, settings, progress, crew, f"{source.name}: pairs")
    for (i, j), pair, together in zip(both, tried, joint, strict=True):
        readings = [Reading(), changed(pair[:1]), changed(pair[1:]), changed(pair)]
        beyond = interaction([means[0], means[1 + i], means[1 + j], together], readings, scale)
        whole = effect(means[0], together, readings[3], readings[0], scale)
        yield Pair(options[i], options[j], beyond, whole.change[scale.policies[-1], "what_error"])
