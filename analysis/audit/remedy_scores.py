"""Effect of the remedies on taps that neither trained nor tuned them.

Two currencies. Beliefs: the mean log belief in the true object (or place, where there is one object) after a fixed
number of taps, a proper score, on the same sequences for every remedy. Decisions: the error at the mean reaction time
that the setting as it is needs at its threshold, or at the highest one below at which its trials do not use up the test
taps, in the same trials. A gain in the first divided by the number of taps is what a remedy buys per tap. All remedies
share the resamples of the taps, see `inference.trials.resampling`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...inference.filter import share
from ...inference.trials.judged_sequences import Sequences, log_beliefs, sum_taps, without_replacement
from ...inference.trials.records import TapTable, tap_table
from ...inference.trials.resampling import (
    CONFIDENCE,
    RESAMPLE_TRIALS,
    RESAMPLES,
    USED_UP_SELECTED,
    Spread,
    spread,
    taps_per_class,
)
from ...inference.trials.run import THRESHOLDS
from ...inference.trials.selections import sessions_drawn, thinned_pools
from ...models import seeds
from ...models.errors import InputError
from ...models.grid import ClassGrid, TapPool, can_act
from ...models.measurement.model import TapModel
from ...models.setting_file import Setting
from ...models.taps import TapSet
from ...models.threads import cores, in_order
from ..page.ahead import draw_ahead, later
from ..page.page import Row
from ..stats.decisions import at_equal_taps, play_models, spread_of
from ..stats.reliability import THETAS, headline, reliability
from ..stats.right_model import SIMULATIONS, Beside, compare, exact, reference_factors
from .remedies import Remedy

if TYPE_CHECKING:
    from . import figures_reliability
else:  # it loads matplotlib
    (figures_reliability,) = later(__package__, "figures_reliability")

_SEQUENCES, _RESAMPLE_SEQUENCES = 20, 6  # of each class, at least; the latter even, for halves
_ROUGH_RESAMPLES, _ROUGH_TRIALS = 20, 200
_FACTOR_TRIALS = 500  # on each resample, for the factors of remedies, which are told to two digits


class Scored(NamedTuple):
    """What a remedy was measured to do, each estimate with its interval (value, low, high), `None` where there is none.

    Attributes:
        name: Of the remedy.
        log_score: Mean log belief in what is true after n taps, in nats.
        gain: The same less that of the setting as it is, on the same sequences.
        sure_gain: Lower end of the gain at a level that holds for all remedies together.
        error: Error at the reaction time of the setting as it is.
        error_change: The same less that of the setting as it is.
        where_error_change: Change of the position error likewise.
        taps: Mean reaction time at its own threshold.
        factor: Miscalibration of decisions at the threshold, infinite as in `BeliefEvidence`.
        stopped: Fraction of trials that cross it before the deadline.
    """

    name: str
    log_score: tuple[float, float, float]
    gain: tuple[float, float, float] | None
    sure_gain: float | None
    error: tuple[float, float, float] | None
    error_change: tuple[float, float, float] | None
    where_error_change: tuple[float, float, float] | None
    taps: float | None
    factor: tuple[float | None, float | None, float | None]
    stopped: float | None = None


class BeliefEvidence(NamedTuple):
    """By what the beliefs of the setting as it is are called right or wrong: all decisions at its threshold.

    Attributes:
        factor: Miscalibration with its interval; all infinite where decisions are wrong and none leaves a doubt.
        wrong: Fraction of wrong decisions.
        beside: The factor beside what a right model gives on as many taps.
        exact: Whether beliefs are right in that reference, see `right_model.exact`.
        each: The factor of each object with its interval, and beside what a right model gives.
        taps: Of a class, the median.
        few: Why intervals may be off, see `resampling.Spread`.
    """

    factor: tuple[float | None, float | None, float | None]
    wrong: float | None
    beside: Beside
    exact: bool
    each: dict[str, tuple[tuple[float | None, float | None, float | None], Beside]]
    taps: int
    few: str = ""


class Measured(NamedTuple):
    """All remedies on the measuring taps.

    Attributes:
        scores: Of each, the setting as it is first.
        n: Taps of the sequences by which beliefs are scored.
        taps: Reaction time at which errors are compared.
        theta: The threshold at which the setting as it is has it.
        policy: `"active"` or `"passive"`.
        judged: The setting as it is.
        reliability: Of its decisions, at `THETAS` too.
        played: Of the remedies with the classes of the setting as it is, see `stats.decisions.play_models`.
        table: Test taps as the setting as it is sees them.
    """

    scores: list[Scored]
    n: int
    taps: float
    theta: float
    policy: str
    judged: BeliefEvidence
    reliability: xr.Dataset
    played: xr.Dataset
    table: TapTable


def measure(
    remedies: Sequence[Remedy],
    taps: TapSet,
    n: int,
    trials: int,
    seed: int,
    advance: Callable[[int], None],
    *,
    resamples: int = RESAMPLES,
    simulations: int = SIMULATIONS,
    scored: Callable[[list[Scored], int, float, xr.Dataset], object] | None = None,
) -> Measured:
    """Measures remedies; the first is the setting as it is.

    Args:
        remedies: From `make_remedies`.
        taps: Measuring taps.
        n: Taps of the sequences by which beliefs are scored, at most as many as classes have.
        trials: Of each remedy.
        seed: Of every random draw.
        advance: Told how much of `count_measurements` is done.
        resamples: Of the taps, for intervals.
        simulations: Of a correct model, with which beliefs are compared.
        scored: Called with `scores`, `n`, `taps` and `played` of the result as soon as they are known.
    """
    base = remedies[0]
    shared = _known_to_all(remedies, taps)
    tables: dict[str, TapTable] = {}
    for remedy in remedies:
        tables[remedy.name] = tap_table(remedy.model, shared)
        advance(1)
    n = min(n, taps_per_class(tables[base.name].pool))
    policy = policy_of(base)
    alike = {remedy.name: tables[remedy.name] for remedy in remedies if remedy.grid is base.grid}
    options = {"policy": policy, "trials": trials, "seed": seed}
    rough = _rough(alike, base, **options)
    theta = _comparable(rough, base.name, base.setting.play.threshold)
    time = float(rough["taps"].sel(model=base.name, theta=theta)[0])
    in_full: dict[str, Any] = {**options, "resamples": resamples}
    played = _play(alike, base, highest=_needed(rough, time), **in_full)
    at_time = at_equal_taps(played, [time]).sel(policy=policy).isel(taps=0)
    thetas = sorted({*THETAS, base.setting.play.threshold})
    reliable = decisions(
        tables[base.name], base.grid, base.setting, thetas, trials=trials, seed=seed, resamples=resamples
    )
    draw_ahead(_figures(reliable, base))
    as_it_is = headline(reliable, policy, base.setting.play.threshold)
    beliefs_of = partial(_log_beliefs, grid=base.grid, taps=shared, n=n, seed=seed, resamples=resamples)
    seen = [(alike[remedy.name], remedy) for remedy in remedies if remedy.name in alike]
    beliefs = dict(zip(alike, beliefs_of(seen, tables[base.name]), strict=True))
    scores = []
    for remedy in remedies:
        table = tables[remedy.name]
        if remedy.grid is base.grid:
            errors = at_time.sel(model=remedy.name)
            as_is, own = beliefs[base.name], beliefs[remedy.name]
        else:
            alone = {remedy.name: table}
            finer = _play(alone, remedy, highest=_needed(_rough(alone, remedy, **options), time), **in_full)
            errors = _against(at_time.sel(model=base.name), finer, policy, time)
            as_is, own = beliefs_of([(tables[base.name], base), (table, remedy)], table)
        rounding = _rounding((table, tables[base.name]), n * shared.taps[0].size)
        how = spread(table, noise=_RESAMPLE_SEQUENCES / _SEQUENCES, thinned=True)
        if remedy is base:
            found = as_it_is
        else:
            found = headline(_factors(table, remedy, **in_full), policy, remedy.setting.play.threshold)
        scores.append(
            Scored(
                remedy.name,
                *_gains(own, as_is, rounding, how, len(remedies) - 1, is_base=remedy is base),
                _triple(errors, "what_error"),
                None if remedy is base else _triple(errors, "what_error_difference"),
                None if remedy is base else _triple(errors, "where_error_difference"),
                found["all trials"]["taps"][0],
                factor_of(found["all trials"]),
                found["stopped"],
            )
        )
        advance(1)
    if scored is not None:
        scored(scores, n, time, played)
    own_table = tables[base.name]
    reference = reference_factors(base.model, own_table, base.setting, policy, trials // 2, seed, simulations, advance)
    judged = judge(as_it_is, base.model, own_table.pool, reference)
    return Measured(scores, n, time, theta, policy, judged, reliable, played, own_table)


def _figures(reliable: xr.Dataset, base: Remedy) -> Iterator[partial[Any]]:
    """Figures of the setting as it is."""
    yield partial(figures_reliability.reliability_after_taps, reliable)
    yield partial(figures_reliability.reliability_at_stopping, reliable)
    if base.grid.M > 1:
        yield partial(figures_reliability.confusions, reliable, base.grid, base.setting.play.threshold)


def policy_of(remedy: Remedy) -> str:
    """The policy of a remedy's setting, passive where the finger cannot move."""
    return "active" if can_act(remedy.grid) and not remedy.setting.play.passive else "passive"


def count_measurements(remedies: Sequence[Remedy], simulations: int = SIMULATIONS) -> int:
    """How often `measure` reports progress."""
    return 2 * len(remedies) + simulations


def lost(measured: Measured) -> Row:
    """Error and reaction time that the setting as it is loses against the best model at the same reaction time.

    Returns:
        `model`, the best of those with the same classes, or `None` where none is better; `error` with `low` and `high`,
        by which its error is smaller; `taps`, by how many its mean reaction time is shorter where it errs as often as
        the setting as it is, `None` where it never does.
    """
    base = measured.scores[0].error
    alike = measured.played["model"].values
    changes = {
        score.name: score.error_change
        for score in measured.scores[1:]
        if score.error_change is not None and score.error_change[2] < 0 and score.name in alike
    }
    if base is None or not changes:
        return {"model": None, "error": 0.0, "low": None, "high": None, "taps": None}
    name, (change, low, high) = min(changes.items(), key=lambda item: item[1][0])
    curve = measured.played.sel(model=name, policy=measured.policy).isel(resample=0)
    reached = curve["taps"].values[curve["what_error"].values <= base[0]]
    taps = measured.taps - float(reached.min()) if len(reached) else None
    return {"model": name, "error": -change, "low": -high, "high": -low, "taps": taps}


def _known_to_all(remedies: Sequence[Remedy], taps: TapSet) -> TapSet:
    """The taps of classes that every remedy was trained with.

    Raises:
        InputError: There is none, or they were prepared otherwise.
    """
    remedies[0].model.check_taps(taps.preprocessing)
    known = np.ones(len(taps), dtype=bool)
    for remedy in remedies:
        where, what = taps.indices(remedy.grid)
        known &= (where >= 0) & (what >= 0)
        known[known] = remedy.model.trained[where[known], what[known]]
    if not known.any():
        raise InputError("No measuring tap belongs to a class that all remedies were trained with.")
    return taps.select(known)


def _play(
    tables: Mapping[str, TapTable],
    remedy: Remedy,
    *,
    policy: str,
    trials: int,
    seed: int,
    resamples: int = RESAMPLES,
    resample_trials: int = RESAMPLE_TRIALS,
    highest: Mapping[str, float] | None = None,
) -> xr.Dataset:
    """Trials by several tables with the classes and the setting of a remedy."""
    setting = remedy.setting
    return play_models(
        tables,
        remedy.grid,
        sorted({*THRESHOLDS, setting.play.threshold}),
        trials,
        seed,
        play=setting.play,
        resamples=resamples,
        resample_trials=resample_trials,
        only=policy,
        highest=highest,
    )


def _rough(tables: Mapping[str, TapTable], remedy: Remedy, **options: Any) -> xr.Dataset:
    """`_play` at all thresholds, with few trials on few selections, or without each session once."""
    resamples = max(_ROUGH_RESAMPLES, *(sessions_drawn(table) for table in tables.values()))
    return _play(tables, remedy, resamples=resamples, resample_trials=_ROUGH_TRIALS, **options).isel(policy=0)


def _comparable(rough: xr.Dataset, base: str, threshold: float) -> float:
    """The highest threshold up to the one in use at which there are enough test taps; that one if there is none."""
    thetas = rough["theta"].values
    used_up = spread_of(rough).center(rough["used_up"].sel(model=base).values)
    return float(thetas[(thetas <= threshold) & (used_up <= USED_UP_SELECTED)].max(initial=0.0) or threshold)


def _needed(rough: xr.Dataset, time: float) -> dict[str, float]:
    """For each model the threshold behind the first at which it takes so long on all selections."""
    thetas, found = rough["theta"].values, {}
    for name in rough["model"].values:
        times = rough["taps"].sel(model=name).values
        fastest = np.minimum(times[:, 0], spread_of(rough).whole(times).min(axis=-1))
        first = int(np.append(np.flatnonzero(fastest >= time), len(thetas))[0])
        found[str(name)] = float(thetas[min(first + 1, len(thetas) - 1)])
    return found


def _against(base: xr.Dataset, played: xr.Dataset, policy: str, time: float) -> xr.Dataset:
    """Errors at a reaction time with classes of their own; the trials of the two settings are independent."""
    own = at_equal_taps(played, [time]).sel(policy=policy).isel(model=0, taps=0)
    result = xr.Dataset()
    for name in ("what_error", "where_error"):
        change = float(own[name] - base[name])
        sides = [
            float(np.hypot(own[name] - own[f"{name}_{a}"], base[name] - base[f"{name}_{b}"]))
            for a, b in (("low", "high"), ("high", "low"))
        ]
        result = result.assign(
            {
                name: own[name],
                f"{name}_low": own[f"{name}_low"],
                f"{name}_high": own[f"{name}_high"],
                f"{name}_difference": change,
                f"{name}_difference_low": change - sides[0],
                f"{name}_difference_high": change + sides[1],
            }
        )
    return result


def _triple(data: xr.Dataset, name: str) -> tuple[float, float, float] | None:
    """Estimate and interval; `None` where there is none."""
    values = float(data[name]), float(data[f"{name}_low"]), float(data[f"{name}_high"])
    return values if np.isfinite(values).all() else None


def _sequences(
    pool: TapPool, n: int, each: int, generator: np.random.Generator
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Sequences of n taps of a class, with replacement where it has fewer, shape (Q, n), and their weights, (Q,).

    There are at least so many of each class, which all weigh the same.
    """
    taps = []
    for first, count in zip(pool.first[pool.count > 0], pool.count[pool.count > 0], strict=True):
        own = pool.order[first : first + count]
        enough = count >= n
        taps.append(without_replacement(own, n, each, generator) if enough else generator.choice(own, (each, n)))
    return np.concatenate(taps), np.concatenate([np.full(len(one), 1 / len(one) / len(taps)) for one in taps])


def _log_beliefs(
    seen: Sequence[tuple[TapTable, Remedy]],
    pool_of: TapTable,
    *,
    grid: ClassGrid,
    taps: TapSet,
    n: int,
    seed: int,
    resamples: int = RESAMPLES,
) -> NDArray[np.float64]:
    """Mean log belief of P remedies in what is true after the same n taps; a row is as `Spread.interval` takes it."""
    generator = seeds.generator(seed, seeds.Purpose.REMEDY_SCORES)
    classes = taps.indices(grid)

    def halves(drawn: NDArray[np.intp], weight: NDArray[np.float64]) -> list[tuple[float, float]]:
        values = [weight * _log_belief(table, remedy, grid, classes, drawn) for table, remedy in seen]
        return [(2 * one[::2].sum(), 2 * one[1::2].sum()) for one in values]

    pools = enumerate(thinned_pools(pool_of, resamples, seed))
    drawn = (_sequences(pool, n, _RESAMPLE_SEQUENCES if i else _SEQUENCES, generator) for i, pool in pools)
    tasks = (partial(halves, *sequences) for sequences in drawn)
    found = np.array(list(in_order(tasks, cores(None)))).transpose(1, 0, 2)
    return np.concatenate([found.mean(axis=2), found[:, 1:, 0], found[:, 1:, 1]], axis=1)


def _log_belief(
    table: TapTable,
    remedy: Remedy,
    grid: ClassGrid,
    classes: tuple[NDArray[np.intp], NDArray[np.intp]],
    drawn: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Log belief in the true object, or where there is one in the true place of `grid`, after each sequence, (Q,)."""
    where, what = classes
    (Q, n), (L, H), M = drawn.shape, table.log_prior.shape, remedy.grid.M
    sums = sum_taps(table.log_likelihood.reshape(-1, L * H), drawn)
    if M > 1:
        group, true = np.tile(np.arange(H) % M, L), what
    else:
        group, true = np.repeat(grid.where_index(remedy.grid.where_value), H), where
    power = np.full(Q, share(n, remedy.model.saturation))
    return log_beliefs(Sequences(sums, group, true[drawn[:, 0]], np.ones(Q), power, table.log_prior.ravel()))


def _gains(
    beliefs: NDArray[np.float64],
    base: NDArray[np.float64],
    rounding: float,
    how: Spread,
    remedies: int,
    *,
    is_base: bool,
) -> tuple[tuple[float, float, float], tuple[float, float, float] | None, float | None]:
    """Mean log belief and its gain, with intervals, and the end of the latter that holds for all remedies."""
    score = _with_ends(beliefs, how)
    if is_base:
        return score, None, None
    gains = beliefs - base
    gains[np.abs(gains) <= rounding] = 0.0
    gain = _with_ends(gains, how)
    sure = gains[0] - how.margin(gains, (1 - CONFIDENCE) / 2 / remedies)
    return score, gain, float(np.minimum(sure, gain[1]))


def _rounding(tables: Sequence[TapTable], terms: int) -> float:
    """The largest error of a log belief by rounding: that of a sum of so many terms of one sign, in each table."""
    known = [table.log_likelihood[np.isfinite(table.log_likelihood)] for table in tables]
    return len(tables) * terms * float(np.finfo(np.float64).eps) * max(np.abs(one).max(initial=0.0) for one in known)


def _with_ends(samples: NDArray[np.float64], how: Spread) -> tuple[float, float, float]:
    low, high = how.interval(samples)
    return float(samples[0]), float(low), float(high)


def decisions(
    table: TapTable, grid: ClassGrid, setting: Setting, thresholds: Sequence[float], **options: Any
) -> xr.Dataset:
    """`reliability` of trials that move and stop by a setting, but at these thresholds; the rest are its options."""
    return reliability(
        table,
        grid,
        thresholds,
        play=setting.play,
        **options,
    )


def _factors(table: TapTable, remedy: Remedy, policy: str, trials: int, seed: int, resamples: int) -> xr.Dataset:
    """Of a remedy at its threshold, of which no more than the factor is told."""
    return decisions(
        table,
        remedy.grid,
        remedy.setting,
        [remedy.setting.play.threshold],
        only=policy,
        trials=trials,
        seed=seed,
        contacts=(),
        resamples=resamples,
        resample_trials=_FACTOR_TRIALS,
    )


def factor_of(found: Row) -> tuple[float | None, float | None, float | None]:
    """The factor of a part of `headline` with its interval, each `None` where there is none.

    A mistake that leaves no doubt refutes beliefs by itself, so an infinite factor has an infinite interval. So has one
    an infinite end that trials which were cut short might have come to.
    """
    if found["doubt"][0] == 0 and (found["wrong"][0] or 0.0) > 0:
        return np.inf, np.inf, np.inf
    value, low, high = found["factor"]
    return value, low, np.inf if high is None and low is not None else high


def judge(found: Row, model: TapModel, pool: TapPool, reference: NDArray[np.float64]) -> BeliefEvidence:
    """Compares beliefs with outcomes, and with those of a right model on as many taps.

    Args:
        found: `headline` of its decisions.
        model: In use.
        pool: The measuring taps.
        reference: Factors of a right model on as many taps, shape (S, 1 + M), as of `reference_factors`.
    """

    def beside(value: float | None, column: int) -> Beside:
        return compare(np.nan if value is None else value, reference[:, column])

    every = found["all trials"]
    factor, *factors = (factor_of(one) for one in (every, *found["each"].values()))
    return BeliefEvidence(
        factor,
        every["wrong"][0],
        beside(factor[0], 0),
        exact(model),
        {name: (own, beside(own[0], 1 + m)) for m, (name, own) in enumerate(zip(found["each"], factors, strict=True))},
        taps_per_class(pool),
        found["few"],
    )
