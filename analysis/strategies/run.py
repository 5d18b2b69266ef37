"""Control strategies under stopping rules, all on the same trials and taps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...inference.information import TapOutcomes, information_of_moves
from ...inference.moves.control import MovePolicy, default_fixation
from ...inference.moves.expected_gain import gain_watch
from ...inference.moves.strategies import make_policy, parse_strategy
from ...inference.moves.table import learn_table
from ...inference.reference import Border
from ...inference.stopping.recorded import stops
from ...inference.stopping.rules import error_loss
from ...inference.stopping.stopping import Watch, what_above
from ...inference.trials.lockstep import Record, play
from ...inference.trials.records import TapTable, TrialPlan, plan_trials, tap_table
from ...inference.trials.resampling import Spread, spread
from ...models.measurement.model import TapModel
from ...models.progress import Progress
from ...models.seeds import data_set_seed
from ...models.threads import check_wanted, one_blas_thread
from ..experiment.settings import SHOWN_THETA
from ..page.figure_style import unit_name
from ..stats.jackknife import Means
from ..stats.resampled_units import left_out_units, resampled_tables, units_of
from ..tasks.crew import THREADS, Crew
from ..tasks.kept import Kept
from .curves import Family, decided_sums, families, nats
from .data import StrategyData, Unit, pool_of

BASE = "fixation"
STRATEGIES = (
    "passive",
    "random",
    "step",
    BASE,
    "fixation:0.8",
    "info-what",
    "info-where",
    "info-joint",
    "info-what-per-mm",
    "info-what-per-s",
    "table",
)
"""What is compared; the names are those of `inference.moves.strategies`."""
TRUSTED = ("passive", "random", BASE, "info-what", "info-joint")
"""Those that are compared under other roots of the likelihood too."""
PATHS = 40
"""Trials whose trajectories are kept."""
_TABLE_TRIALS = 500
_KEPT = 8  # folds that tasks are at


@dataclass(frozen=True)
class StrategySettings:
    """What changes the numbers.

    Attributes:
        trials: Of each data set or fold, strategy and root.
        deadline: Taps of a trial.
        pool: About how many training taps strategies enumerate.
        seed: Of every random draw.
        strategies: What is compared; `BASE` is among them.
    """

    trials: int = 100
    deadline: int = 20
    pool: int = 400
    seed: int = 0
    strategies: tuple[str, ...] = STRATEGIES


class PlayedStrategies(NamedTuple):
    """What strategies came to under one root of the likelihood.

    Attributes:
        power: The root.
        families: The stopping rules.
        means: Means of units (unit, level, `SUMS`), by strategy and name of the rule.
        nats: Means of what taps were expected to tell and told, by strategy, shape (unit, T, 2).
        paths: Where class at each tap of some trials up to their decision at `SHOWN_THETA`, -1 after it, by strategy,
            shape (trials, T).
        exponents: Of the likelihood, mean over the folds.
    """

    power: str
    families: tuple[Family, ...]
    means: dict[tuple[str, str], Means]
    nats: dict[str, NDArray[np.float64]]
    paths: dict[str, NDArray[np.int64]]
    exponents: float


@dataclass(frozen=True, eq=False)
class StrategyStudy:
    """What came out for one kind of data."""

    bench: StrategyData
    played: tuple[PlayedStrategies, ...]


def strategy_study(
    bench: StrategyData, settings: StrategySettings, progress: Progress, crew: Crew = THREADS
) -> StrategyStudy:
    """Plays every strategy, on the threads or the cluster given.

    A task is a root of the likelihood in a fold or, where there is one fold only, a strategy under one.

    Raises:
        InputError: A strategy cannot be played on these data.
    """
    names = {power: playable(bench, settings.strategies, i == 0) for i, power in enumerate(bench.powers)}
    together = bench.folds > 1
    chosen = [(power, part) for power, of in names.items() for part in ([of] if together else [(one,) for one in of])]
    items = [(number, power, part) for number in range(bench.folds) for power, part in chosen]
    shared = _Shared(bench, settings, Kept(_KEPT), Kept(_KEPT))
    with one_blas_thread():
        played = list(crew(_play_strategies, items, shared, progress(bench.name, len(items))))
    return StrategyStudy(bench, tuple(_joined([one for one in played if one.power == power], bench) for power in names))


def playable(bench: StrategyData, strategies: Sequence[str], everything: bool) -> tuple[str, ...]:
    """The strategies that these data allow: those per millimetre and second need places in millimetres."""
    in_mm = unit_name(bench.grid.where_unit) == "mm"
    chosen = [name for name in strategies if everything or name in TRUSTED]
    return tuple(name for name in chosen if in_mm or not parse_strategy(name).per)


def _joined(parts: Sequence[PlayedStrategies], bench: StrategyData) -> PlayedStrategies:
    """Parts under the same root: folds, or strategies of a single one."""

    def joined[Key](of: Sequence[Mapping[Key, Means]]) -> dict[Key, Means]:
        units = {key: np.concatenate([one[key] for one in of if key in one]) for part in of for key in part}
        return {key: left_out_units(values) for key, values in units.items()} if bench.left_out else units

    return parts[0]._replace(
        means=joined([one.means for one in parts]),
        nats=joined([one.nats for one in parts]),
        paths={name: path for part in reversed(parts) for name, path in part.paths.items()},
        exponents=float(np.mean([one.exponents for one in parts[: bench.folds]])),
    )


class _Perceived(NamedTuple):
    """A fold under one root of the likelihood, with trials on its test taps and on resamples of them."""

    model: TapModel
    outcomes: TapOutcomes
    tables: list[TapTable]
    spread: Spread
    plans: list[TrialPlan]


class _Shared(NamedTuple):
    """What all tasks need, and what those in one process share."""

    bench: StrategyData
    settings: StrategySettings
    units: Kept[Unit]
    perceived: Kept[_Perceived]

    def unit(self, number: int) -> Unit:
        """A data set or fold."""
        return self.units(number, partial(self.bench.load, number))

    def fold(self, number: int, power: str) -> _Perceived:
        """The same under a root of the likelihood."""
        return self.perceived((number, power), partial(self._perceive, number, power))

    def _perceive(self, number: int, power: str) -> _Perceived:
        unit, seed, n = self.unit(number), data_set_seed(self.settings.seed, number), self.settings.trials
        model = unit.model(power, self.bench.grid, seed)
        table, outcomes = tap_table(model, model.usable(unit.test)), pool_of(model, unit.train, self.settings.pool)
        tables = resampled_tables(table, self.bench.resamples, seed)
        plans = [plan_trials(one.pool, n, seed, first_stream=i * n) for i, one in enumerate(tables)]
        return _Perceived(model, outcomes, tables, spread(table), plans)


def _play_strategies(item: tuple[int, str, Sequence[str]], shared: _Shared) -> PlayedStrategies:
    (number, power, strategies), (bench, settings, *_) = item, shared
    seed = data_set_seed(settings.seed, number)
    model, outcomes, tables, how, plans = shared.fold(number, power)
    rules = families(model, default_fixation(bench.grid.L), settings.deadline)
    watch = _watch(model, outcomes, bench.border)
    common = {"border": bench.border, "deadline": settings.deadline, "seed": seed, "watch": watch}
    means, told, paths = {}, {}, {}
    for name in strategies:
        policy = _policy(name, bench, shared.unit(number), model, outcomes, seed)
        sums, expected = [], []
        for table, plan in zip(tables, plans, strict=True):
            record = play(table, plan, policy, progress=check_wanted, **common)
            sums.append([decided_sums(record, family, bench.grid).mean(axis=0) for family in rules])
            expected.append(nats(record).mean(axis=0))
            if name not in paths:
                paths[name] = _paths(record)
        for family, values in zip(rules, zip(*sums, strict=True), strict=True):
            means[name, family.name] = units_of(values, how)
        told[name] = units_of(expected, how)
    return PlayedStrategies(power, rules, means, told, paths, model.exponent)


def _policy(
    name: str, bench: StrategyData, unit: Unit, model: TapModel, outcomes: TapOutcomes, seed: int
) -> MovePolicy:
    grid, border = bench.grid, bench.border
    if name == "table":
        tables = unit.held_out(model, grid)
        learned = learn_table(tables, grid, border=border, trials=_TABLE_TRIALS, seed=seed)
        return make_policy(name, grid, table=learned)
    return make_policy(name, grid, border=border, outcomes=outcomes)


def _watch(model: TapModel, outcomes: TapOutcomes, border: Border) -> Watch:
    """Records what the next tap is expected to tell of the object, and to save of the loss of the decision."""
    gain = gain_watch(outcomes, error_loss(model.grid), border=border)

    def watch(beliefs: NDArray[np.float64], moves: NDArray[np.int64]) -> Mapping[str, NDArray[np.float64]]:
        expected = information_of_moves(outcomes, beliefs, moves[:, np.newaxis], border, "what")[:, 0]
        return {**gain(beliefs, moves), "expected": expected}

    return watch


def _paths(record: Record) -> NDArray[np.int64]:
    """Trajectories up to the decision."""
    shown = stops(what_above(SHOWN_THETA), record).taps[:PATHS, np.newaxis]
    at = record.at[:PATHS]
    return np.where(np.arange(at.shape[1]) < shown, at, -1)
