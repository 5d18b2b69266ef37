"""What remedies buy on taps that neither trained nor tuned them.

Two currencies. Beliefs: the mean log belief in the true object (or place, where there is one object) after a fixed
number of taps, a proper score, on the same sequences for every remedy. Decisions: the error at the mean reaction time
that the setting as it is needs at its threshold, in the same trials. A gain in the first divided by the number of taps
is what a remedy buys per tap.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..hardware.pool import TapPool, tap_pool
from ..inference.montecarlo import THRESHOLDS
from ..inference.saturation import share, temper
from ..inference.trial_plan import TapTable, tap_table
from ..models.classes import ClassGrid
from ..models.errors import InputError
from ..models.setting import Setting
from ..models.taps import TapSet
from .compare_decisions import at_equal_taps, play_models
from .compare_pairing import RESAMPLES
from .metrics import CONFIDENCE
from .reliability import CONTACTS, EVERYTHING, after_contacts, headline, plain, reliability, replayed
from .remedies import Remedy
from .study import can_act

_SEQUENCES = 20  # of each class
_RESAMPLES = 400
_MOST_REPLAY = 2.0  # up to which trials at stopping say something about beliefs


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
        factor: Miscalibration of decisions at the threshold.
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


class Judged(NamedTuple):
    """By what the beliefs of the setting as it is are called right or wrong.

    At stopping, unless trials would repeat their few taps there: after as many taps as classes have, passive, then.

    Attributes:
        factor: Miscalibration with its interval.
        wrong: Fraction of wrong decisions.
        replay: By how much trials repeat their taps, see `reliability.replayed`.
        taps: After how many taps; `None` at stopping.
    """

    factor: tuple[float | None, float | None, float | None]
    wrong: float | None
    replay: float
    taps: int | None


class Measured(NamedTuple):
    """All remedies on the measuring taps.

    Attributes:
        scores: Of each, the setting as it is first.
        n: Taps of the sequences by which beliefs are scored.
        taps: Reaction time at which errors are compared.
        policy: `"active"` or `"passive"`.
        judged: The setting as it is.
        played: Of the remedies with the classes of the setting as it is, see `compare_decisions.play_models`.
        table: Test taps as the setting as it is sees them.
    """

    scores: list[Scored]
    n: int
    taps: float
    policy: str
    judged: Judged
    played: xr.Dataset
    table: TapTable


def measure(
    remedies: Sequence[Remedy],
    taps: TapSet,
    n: int,
    trials: int,
    seed: int,
    advance: Callable[[int], None],
) -> Measured:
    """Measures remedies; the first is the setting as it is.

    Args:
        remedies: From `make_remedies`.
        taps: Measuring taps.
        n: Taps of the sequences by which beliefs are scored, at most as many as classes have.
        trials: Of each remedy.
        seed: Of every random draw.
        advance: Told of every remedy.
    """
    base = remedies[0]
    shared = _known_to_all(remedies, taps)
    where, what = shared.indices(base.grid)
    n = min(n, taps_per_class(tap_pool(where, what, base.grid.shape)))
    tables: dict[str, TapTable] = {}
    for remedy in remedies:
        tables[remedy.name] = tap_table(remedy.model, shared)
        advance(1)
    policy = "active" if can_act(base.grid) and not base.setting.passive else "passive"
    alike = {remedy.name: tables[remedy.name] for remedy in remedies if remedy.grid is base.grid}
    played = _play(alike, base.grid, base.setting, trials, seed)
    time = float(played["taps"].sel(model=base.name, policy=policy, theta=base.setting.threshold)[0])
    at_time = at_equal_taps(played, [time]).sel(policy=policy).isel(taps=0)
    scores = []
    for remedy in remedies:
        if remedy.grid is base.grid:
            errors = at_time.sel(model=remedy.name)
        else:
            finer = _play({remedy.name: tables[remedy.name]}, remedy.grid, remedy.setting, trials, seed)
            errors = _against(at_time.sel(model=base.name), finer, policy, time)
        where, what = shared.indices(remedy.grid)
        drawn = _sequences(where * remedy.grid.M + what, n, seed)
        beliefs = [_log_belief(tables[one.name], one, base.grid, shared, drawn) for one in (remedy, base)]
        found = headline(_reliability(tables[remedy.name], remedy, (), trials, seed), policy, remedy.setting.threshold)
        scores.append(
            Scored(
                remedy.name,
                *_gains(beliefs, drawn.unit, len(remedies) - 1, seed, is_base=remedy is base),
                _triple(errors, "what_error"),
                None if remedy is base else _triple(errors, "what_error_difference"),
                None if remedy is base else _triple(errors, "where_error_difference"),
                found["all trials"]["taps"][0],
                tuple(found["factor"]),
                found["stopped"],
            )
        )
        advance(1)
    judged = _judged(tables[base.name], base, policy, trials, seed)
    return Measured(scores, n, time, policy, judged, played, tables[base.name])


def count_measurements(remedies: Sequence[Remedy]) -> int:
    """How often `measure` reports progress."""
    return 2 * len(remedies)


def lost(measured: Measured) -> dict[str, Any]:
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


class _Sequences(NamedTuple):
    """Sequences of n taps of one class.

    Attributes:
        taps: Shape (Q, n).
        unit: Class of each, shape (Q,).
    """

    taps: NDArray[np.intp]
    unit: NDArray[np.intp]


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


def _play(tables: Mapping[str, TapTable], grid: ClassGrid, setting: Setting, trials: int, seed: int) -> xr.Dataset:
    return play_models(
        tables,
        grid,
        sorted({*THRESHOLDS, setting.threshold}),
        trials,
        seed,
        fixation=setting.fixation,
        border=setting.border,
        deadline=setting.deadline,
        theta_x=setting.theta_x,
        resamples=_RESAMPLES,
    )


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


def _sequences(own: NDArray[np.intp], n: int, seed: int) -> _Sequences:
    """Some of each class, with replacement where it has fewer than n taps."""
    generator = np.random.default_rng([seed, 7])
    taps, unit = [], []
    for c in np.unique(own):
        members = np.flatnonzero(own == c)
        for _ in range(_SEQUENCES):
            taps.append(generator.choice(members, size=n, replace=len(members) < n))
            unit.append(c)
    return _Sequences(np.array(taps), np.array(unit))


def _log_belief(
    table: TapTable, remedy: Remedy, grid: ClassGrid, taps: TapSet, drawn: _Sequences
) -> NDArray[np.float64]:
    """Log belief in the true object, or where there is one in the true place of `grid`, after each sequence, (Q,)."""
    where, what = taps.indices(grid)
    M = remedy.grid.M
    total = np.stack([table.log_likelihood[sequence].sum(axis=0) for sequence in drawn.taps]) + table.log_prior
    n = drawn.taps.shape[1]
    log_belief = temper(total, share(n, remedy.model.saturation)).copy()
    log_belief -= _log_sum(log_belief.reshape(len(total), -1))[:, None, None]
    first = drawn.taps[:, 0]
    if M > 1:
        each = log_belief.reshape(len(total), remedy.grid.L, -1, M)[np.arange(len(total)), :, :, what[first]]
    else:
        within = grid.where_index(remedy.grid.where_value) == where[first][:, None]
        each = np.where(within[:, :, None], log_belief, -np.inf)
    return _log_sum(each.reshape(len(total), -1))


def _log_sum(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Logs of sums over the last axis."""
    return np.logaddexp.reduce(values, axis=-1)


def _gains(
    beliefs: list[NDArray[np.float64]], unit: NDArray[np.intp], remedies: int, seed: int, *, is_base: bool
) -> tuple[tuple[float, float, float], tuple[float, float, float] | None, float | None]:
    """Mean log belief and its gain, with intervals over classes, and the end of the latter that holds for all."""
    _, index = np.unique(unit, return_inverse=True)
    C = int(index.max()) + 1
    means = np.stack(
        [np.bincount(index, value) / np.bincount(index) for value in (beliefs[0], beliefs[0] - beliefs[1])]
    )
    weights = np.random.default_rng([seed, 8]).multinomial(C, np.full(C, 1 / C), size=RESAMPLES) / C
    samples = weights @ means.T
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(samples, [tail, 1 - tail], axis=0)
    score, gain = ((float(means[i].mean()), float(low[i]), float(high[i])) for i in (0, 1))
    if is_base:
        return score, None, None
    return score, gain, float(np.quantile(samples[:, 1], tail / remedies))


def _reliability(table: TapTable, remedy: Remedy, contacts: Sequence[int], trials: int, seed: int) -> xr.Dataset:
    """Of trials at the setting's threshold, and after numbers of taps."""
    setting = remedy.setting
    return reliability(
        table,
        remedy.grid,
        [setting.threshold],
        seed,
        trials=trials,
        contacts=contacts,
        border=setting.border,
        deadline=setting.deadline,
        fixation=setting.fixation,
        theta_x=setting.theta_x,
    )


def _judged(table: TapTable, base: Remedy, policy: str, trials: int, seed: int) -> Judged:
    """By what the beliefs of the setting as it is are judged."""
    n = max(contact for contact in (1, *CONTACTS) if contact <= taps_per_class(table.pool))
    data = _reliability(table, base, (n,), trials, seed)
    found = headline(data, policy, base.setting.threshold)
    replay = replayed(table.pool, None, found["all trials"]["taps"][0] or 1.0)
    if replay <= _MOST_REPLAY:
        return Judged(tuple(found["factor"]), found["wrong"][0], replay, None)
    at = after_contacts(data).sel(what=EVERYTHING).isel(contacts=0)
    factor = plain(float(at["factor"])), plain(float(at["factor_low"])), plain(float(at["factor_high"]))
    return Judged(factor, plain(float(at["wrong"])), replayed(table.pool, None, n), n)


def taps_per_class(pool: TapPool) -> int:
    """Taps of a class, the median over those that have some."""
    return max(1, int(np.median(pool.count[pool.count > 0])))
