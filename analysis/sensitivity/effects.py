"""Effect of an option relative to the default: paired differences with intervals, and the verdict.

Means of units have the axes (unit, policy, theta, `SUMS`). Every quantity is a function of their mean over units;
`stats.jackknife` gives its intervals.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.grid import ClassGrid
from ..stats.jackknife import Interval, Means, interval, jackknife
from .choices import Reading

SUMS = ("counted", "what_error", "where_error", "taps", "wrong", "doubt", "stopped", "clamped", "impossible")
"""Means over all trials of a unit; the errors, taps and beliefs of trials that are left out are 0."""
QUANTITIES = ("what_error", "where_error", "taps", "factor")
"""What options are judged by, for each policy; `factor` is the log of P(wrong) over the mean of 1 - belief."""
ADVANTAGES = ("what_error", "where_error", "taps")
"""Of these the paper concludes that passive less active is above zero."""
RELEVANT = 0.1
"""Change in relation to the default's value below which a quantity is taken for unchanged."""
CLASS_FLOOR, TAPS_FLOOR = 0.01, 0.5
FACTOR_LIMIT = float(np.log(1.25))


class Effect(NamedTuple):
    """Difference of an option from the default.

    Attributes:
        change: By policy and quantity.
        equal_taps: Change of the object error at the default's mean reaction time, by policy; NaN where no threshold
            leads there.
        advantage: Passive less active under the option, by quantity; empty where nothing can move.
        advantage_change: The same less that of the default.
    """

    change: dict[tuple[str, str], Interval]
    equal_taps: dict[str, Interval]
    advantage: dict[str, Interval]
    advantage_change: dict[str, Interval]


class Scale(NamedTuple):
    """How many intervals there are, and at what thresholds their values stand.

    Attributes:
        thresholds: theta_W, increasing, shape (H,).
        policies: As on the policy axis.
        intervals: That hold together with 95%, by Bonferroni's inequality.
    """

    thresholds: NDArray[np.float64]
    policies: tuple[str, ...]
    intervals: int


def intervals_of(policies: Sequence[str]) -> int:
    """How many intervals an option has."""
    return (len(QUANTITIES) + 1) * len(policies) + (2 * len(ADVANTAGES) if len(policies) > 1 else 0)


def quantities(mean: Means, reading: Reading, thresholds: NDArray[np.float64]) -> NDArray[np.float64]:
    """`QUANTITIES` at the threshold where a reading reads them.

    Args:
        mean: Over units, shape (policy, theta, `SUMS`).
        reading: Says where.
        thresholds: Shape (theta,).

    Returns:
        Shape (policy, `QUANTITIES`).
    """
    return _quantities(_read(mean, reading, thresholds))


def absolute(means: Means, reading: Reading, scale: Scale) -> dict[tuple[str, str], Interval]:
    """`QUANTITIES` of each policy with intervals.

    Args:
        means: Of units.
        reading: Says where thresholds are read.
        scale: Thresholds, policies and number of intervals.
    """
    values, errors = jackknife([means], lambda mean: quantities(mean, reading, scale.thresholds))
    return {
        (p, q): interval(values[i, j], errors[i, j], len(means), scale.intervals)
        for i, p in enumerate(scale.policies)
        for j, q in enumerate(QUANTITIES)
    }


def effect(default: Means, option: Means, reading: Reading, base: Reading, scale: Scale) -> Effect:
    """Changes by an option, with intervals.

    Args:
        default: Means of units under the defaults.
        option: Means of the same units under the option.
        reading: Of the option.
        base: Of the defaults.
        scale: Thresholds, policies and number of intervals.
    """
    n, P, Q = len(default), len(scale.policies), len(QUANTITIES)

    def statistic(old: Means, new: Means) -> NDArray[np.float64]:
        before, after = quantities(old, base, scale.thresholds), quantities(new, reading, scale.thresholds)
        equal = _at_taps(new, before[:, 2]) - before[:, 0]
        advantage = (after[0] - after[-1], (after[0] - after[-1]) - (before[0] - before[-1]))
        return np.concatenate([(after - before).ravel(), equal, *advantage])

    values, errors = jackknife([default, option], statistic)
    found = [interval(value, error, n, scale.intervals) for value, error in zip(values, errors, strict=True)]
    change = {(p, q): found[i * Q + j] for i, p in enumerate(scale.policies) for j, q in enumerate(QUANTITIES)}
    equal = dict(zip(scale.policies, found[P * Q : P * Q + P], strict=True))
    if P == 1:
        return Effect(change, equal, {}, {})
    rest = found[P * Q + P :]
    return Effect(
        change,
        equal,
        {name: rest[QUANTITIES.index(name)] for name in ADVANTAGES},
        {name: rest[Q + QUANTITIES.index(name)] for name in ADVANTAGES},
    )


def interaction(four: Sequence[Means], readings: Sequence[Reading], scale: Scale) -> Interval:
    """Change of the object error by two options together, beyond the sum of their single changes.

    Args:
        four: Means under the defaults, each option alone, and both.
        readings: The same four.
        scale: Its last policy counts.
    """

    def statistic(*means: Means) -> NDArray[np.float64]:
        errors = [quantities(m, r, scale.thresholds)[-1, 0] for m, r in zip(means, readings, strict=True)]
        return np.array([errors[3] - errors[1] - errors[2] + errors[0]])

    (value,), (error,) = jackknife(four, statistic)
    return interval(value, error, len(four[0]), scale.intervals)


def limits(default: Mapping[tuple[str, str], Interval], grid: ClassGrid) -> dict[tuple[str, str], float]:
    """Relevance limits: a tenth of the default's value, at least a hundredth of a class step or half a tap.

    A factor of calibration may change by a quarter.

    Args:
        default: From `absolute`.
        grid: The classes.
    """
    what = np.arange(grid.M)
    floor = {
        "what_error": CLASS_FLOOR * _step(grid.what_error(what[1:], what[:-1])),
        "where_error": CLASS_FLOOR * _step(np.diff(grid.where_value)),
        "taps": TAPS_FLOOR,
    }
    return {
        (p, q): FACTOR_LIMIT if q == "factor" else max(RELEVANT * value.value, floor[q])
        for (p, q), value in default.items()
    }


def verdict(
    found: Effect, default_advantage: Mapping[str, Interval], limit: Mapping[tuple[str, str], float]
) -> tuple[str, list[str]]:
    """Verdict on an option, and the quantities behind it.

    Args:
        found: The effect.
        default_advantage: Passive less active under the defaults.
        limit: Of each policy and quantity.

    Returns:
        `"conclusion"` where an advantage of active perception that is sure under the defaults is not so under the
        option, and surely smaller; else `"numbers"` where a quantity surely changes by more than its limit;
        `"nothing"` where all surely change by less; `"not decided"` otherwise. Then the quantities.
    """
    lost = [
        name
        for name, before in default_advantage.items()
        if before.least > 0 and not found.advantage[name].least > 0 and found.advantage_change[name].most < 0
    ]
    if lost:
        return "conclusion", [f"{name} reversed" if found.advantage[name].most < 0 else name for name in lost]
    known = {key: change for key, change in found.change.items() if not np.isnan(change.least)}
    moved = [f"{p} {q}" for (p, q), change in known.items() if change.sure and abs(change.value) > limit[p, q]]
    if moved:
        return "numbers", moved
    within = all(change.within(limit[key]) for key, change in known.items())
    return ("nothing" if within and known else "not decided"), []


def _read(mean: Means, reading: Reading, thresholds: NDArray[np.float64]) -> NDArray[np.float64]:
    """The sums at the threshold that is read, shape (policy, `SUMS`)."""
    if isinstance(reading.read_at, float | int):
        return mean[:, _index(thresholds, reading.read_at)]
    grid = [_index(thresholds, theta) for theta in reading.read_at]
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = mean[:, grid, 1] / mean[:, grid, 0]
    best = np.take(grid, np.where(np.isnan(errors), np.inf, errors).argmin(axis=1))
    return mean[np.arange(len(mean)), best]


def _index(thresholds: NDArray[np.float64], theta: float) -> int:
    return int(np.flatnonzero(np.isclose(thresholds, theta, rtol=0, atol=1e-12))[0])


def _step(distances: NDArray[np.float64]) -> float:
    return float(np.median(distances)) if len(distances) else 0.0


def _quantities(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(divide="ignore", invalid="ignore"):
        means = sums[..., 1:4] / sums[..., :1]
        factor = np.log(sums[..., 4:5] / sums[..., 5:6])
    return np.concatenate([means, np.where(np.isfinite(factor), factor, np.nan)], axis=-1)


def _at_taps(mean: Means, taps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Object errors of a curve over thresholds at mean reaction times, shape (policy,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        errors, times = mean[..., 1] / mean[..., 0], mean[..., 3] / mean[..., 0]
    found = np.full(len(mean), np.nan)
    for p in range(len(mean)):
        known = np.isfinite(times[p])
        if known.any():
            order = np.argsort(times[p, known], kind="stable")
            found[p] = np.interp(taps[p], times[p, known][order], errors[p, known][order], np.nan, np.nan)
    return found
