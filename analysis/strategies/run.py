"""Control strategies under stopping rules, all on the same trials and taps."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from functools import partial
from threading import Event
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
from ...inference.trials.records import plan_trials, tap_table
from ...inference.trials.resampling import spread
from ...models.measurement.model import TapModel
from ...models.progress import Progress
from ...models.seeds import data_set_seed
from ...models.threads import cores, in_order, one_blas_thread
from ..experiment.settings import SHOWN_THETA
from ..page.figure_style import short_unit
from ..stats.jackknife import Means
from ..stats.resampled_units import resampled_tables, units_of
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


@dataclass(frozen=True)
class StrategySettings:
    """What changes the numbers.

    Attributes:
        trials: Of each data set or fold, strategy and root.
        deadline: Taps of a trial.
        pool: About how many training taps strategies enumerate.
        seed: Of every random draw.
        strategies: What is compared; `BASE` is among them.
        workers: Data sets at a time; `None` for as many as there are cores. Changes the speed only.
    """

    trials: int = 100
    deadline: int = 20
    pool: int = 400
    seed: int = 0
    strategies: tuple[str, ...] = STRATEGIES
    workers: int | None = None


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


def strategy_study(bench: StrategyData, settings: StrategySettings, progress: Progress) -> StrategyStudy:
    """Plays every strategy.

    Raises:
        InputError: A strategy cannot be played on these data.
    """
    names = [(power, playable(bench, settings.strategies, i == 0)) for i, power in enumerate(bench.powers)]
    advance = progress(bench.name, bench.folds * sum(len(chosen) for _, chosen in names))
    unwanted = Event()

    def go_on(_: int = 0) -> None:
        if unwanted.is_set():
            raise CancelledError

    def done(number: int) -> None:
        go_on()
        advance(number)

    tasks = [partial(_play_fold, bench, number, names, settings, done, go_on) for number in range(bench.folds)]
    with one_blas_thread():
        folds = list(in_order(tasks, cores(settings.workers), unwanted))
    return StrategyStudy(bench, tuple(_joined([fold[i] for fold in folds]) for i in range(len(names))))


def playable(bench: StrategyData, strategies: Sequence[str], everything: bool) -> tuple[str, ...]:
    """The strategies that these data allow: those per millimetre and second need places in millimetres."""
    in_mm = short_unit(bench.grid.where_unit) == "mm"
    chosen = [name for name in strategies if everything or name in TRUSTED]
    return tuple(name for name in chosen if in_mm or not parse_strategy(name).per)


def _joined(parts: Sequence[PlayedStrategies]) -> PlayedStrategies:
    first = parts[0]
    return first._replace(
        means={key: np.concatenate([one.means[key] for one in parts]) for key in first.means},
        nats={name: np.concatenate([one.nats[name] for one in parts]) for name in first.nats},
        exponents=float(np.mean([one.exponents for one in parts])),
    )


def _play_fold(
    bench: StrategyData,
    number: int,
    names: Sequence[tuple[str, Sequence[str]]],
    settings: StrategySettings,
    advance: Callable[[int], None],
    go_on: Callable[[int], None],
) -> list[PlayedStrategies]:
    unit = bench.load(number)
    return [_play_power(bench, unit, number, power, chosen, settings, advance, go_on) for power, chosen in names]


def _play_power(
    bench: StrategyData,
    unit: Unit,
    number: int,
    power: str,
    strategies: Sequence[str],
    settings: StrategySettings,
    advance: Callable[[int], None],
    go_on: Callable[[int], None],
) -> PlayedStrategies:
    seed = data_set_seed(settings.seed, number)
    model = unit.model(power, bench.grid, seed)
    table, outcomes = tap_table(model, model.usable(unit.test)), pool_of(model, unit.train, settings.pool)
    tables, how = resampled_tables(table, bench.resamples, seed), spread(table)
    n = settings.trials
    plans = [plan_trials(one.pool, n, seed, first_stream=i * n) for i, one in enumerate(tables)]
    rules = families(model, default_fixation(bench.grid.L), settings.deadline)
    watch = _watch(model, outcomes, bench.border)
    means, told, paths = {}, {}, {}
    common = {"border": bench.border, "deadline": settings.deadline, "seed": seed, "watch": watch, "progress": go_on}
    for name in strategies:
        policy = _policy(name, bench, unit, model, outcomes, seed)
        tasks = (partial(play, one, plan, policy, **common) for one, plan in zip(tables, plans, strict=True))
        sums, expected = [], []
        for number_of_table, record in enumerate(in_order(tasks, cores(settings.workers) if len(tables) > 1 else 1)):
            sums.append([decided_sums(record, family, bench.grid).mean(axis=0) for family in rules])
            expected.append(nats(record).mean(axis=0))
            if number_of_table == 0:
                paths[name] = _paths(record)
        for family, values in zip(rules, zip(*sums, strict=True), strict=True):
            means[name, family.name] = units_of(values, how)
        told[name] = units_of(expected, how)
        advance(1)
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
