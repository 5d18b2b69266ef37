"""Error against taps and distance travelled, for strategies under stopping rules: means of units with intervals.

A rule with a parameter, such as a threshold, makes a curve: one point for each level. Means of units (data sets,
sessions or resamples of test taps) have the axes (unit, level, `SUMS`). Points between two levels are interpolated:
what one reaches by throwing a coin for each trial which of the two to use. Nothing is extrapolated.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...inference.stopping.recorded import stops
from ...inference.stopping.rules import error_loss
from ...inference.stopping.stopping import (
    DECIDE,
    GIVE_UP,
    StopRule,
    after,
    both_above,
    divergences,
    lookahead,
    msprt,
    or_give_up,
    what_above,
    where_above,
)
from ...inference.trials.lockstep import Record
from ...inference.trials.run import THRESHOLDS
from ...models.grid import ClassGrid
from ...models.measurement.model import TapModel
from ..stats.jackknife import Interval, Means, interval, jackknife

SUMS = ("answered", "what_error", "where_error", "taps", "way", "wrong", "doubt", "given_up", "unstopped")
"""Of each trial; errors, wrong and doubt are 0 where it gave up, taps and way count always."""
QUANTITIES = ("what_error", "where_error", "taps", "way", "wrong", "given_up", "unstopped", "factor")
"""Errors, wrong decisions and their factor over 1 - belief are of the trials that answer, all else of all."""
AT_TAPS = ("what_error", "where_error", "way", "given_up")
"""What curves are compared by at equal mean numbers of taps."""
COSTS = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001, 3e-4, 1e-4)
"""Of a tap, in relation to that of a wrong decision."""
_LEAST = 1e-300  # of a belief that is no longer a number


class Family(NamedTuple):
    """A stopping rule with the levels of its parameter.

    Attributes:
        name: For print.
        parameter: What the levels are.
        levels: Of the parameter.
        rule: The rule at a level.
    """

    name: str
    parameter: str
    levels: tuple[float, ...]
    rule: Callable[[float], StopRule]


def families(model: TapModel, at: int, deadline: int) -> tuple[Family, ...]:
    """The stopping rules that are compared; the first is the paper's.

    Args:
        model: Of histograms, from which `msprt` takes how far apart objects are.
        at: Where class at which it does.
        deadline: Of a trial.
    """
    theta = "theta"
    loss = float(error_loss(model.grid).max(initial=0.0))
    apart = np.maximum(divergences(model, at), _LEAST)
    half = deadline // 2
    return (
        Family("what", theta, THRESHOLDS, what_above),
        Family("where", theta, THRESHOLDS, where_above),
        Family("both", theta, THRESHOLDS, lambda level: both_above(level, level)),
        Family("number of taps", "taps", tuple(range(1, deadline + 1)), lambda level: after(int(level))),
        Family("msprt", "cost", COSTS, lambda level: msprt(apart, level)),
        Family("lookahead", "cost", COSTS, lambda level: lookahead(level * loss)),
        Family(f"what, at {half} taps decide", theta, THRESHOLDS, lambda level: or_give_up(what_above(level), half)),
        Family(
            f"what, at {half} taps give up", theta, THRESHOLDS, lambda level: or_give_up(what_above(level), half, 1.0)
        ),
    )


def decided_sums(record: Record, family: Family, grid: ClassGrid) -> NDArray[np.float64]:
    """`SUMS` of every trial at every level, shape (trials, levels, `SUMS`)."""
    stopped = [stops(family.rule(level), record) for level in family.levels]
    taps, answer = (np.stack(parts, axis=1) for parts in zip(*stopped, strict=True))
    last = np.arange(len(taps))[:, np.newaxis], taps - 1
    what, held, answers = record.what[last], record.held[:, np.newaxis], answer != GIVE_UP
    values = (
        answers,
        answers * grid.what_error(what, held),
        answers * grid.where_error(record.where[last], record.at[last]),
        taps,
        travelled(record, grid)[last],
        answers & (what != held),
        answers * np.maximum(1.0 - record.what_belief[last], 0.0),
        ~answers,
        answers & (answer != DECIDE),
    )
    return np.stack(values, axis=-1).astype(np.float64)


def travelled(record: Record, grid: ClassGrid) -> NDArray[np.float64]:
    """Distance actually travelled before each tap, in the unit of the positions, shape (n, T)."""
    before = np.concatenate([record.at[:, :1], record.at[:, :-1]], axis=1)
    return np.cumsum(grid.where_error(record.at, before), axis=1)


def nats(record: Record) -> NDArray[np.float64]:
    """Expected and gained information about the object from the taps after the first, up to each tap, in nats.

    The expectation is the sum of the information that the record's watch calls `"expected"`; told is the growth of the
    log belief in the true object, whose mean the expectation is where the model is right.

    Returns:
        Shape (n, T, 2).
    """
    expected = np.cumsum(record.watched["expected"], axis=1)
    held = record.held[:, np.newaxis, np.newaxis]
    log_belief = np.log(np.maximum(np.take_along_axis(record.what_marginal, held, axis=2)[:, :, 0], _LEAST))
    before = np.concatenate([np.zeros((len(expected), 1)), expected[:, :-1]], axis=1)
    return np.stack([before, log_belief - log_belief[:, :1]], axis=-1)


def quantities(mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """`QUANTITIES` of means (..., `SUMS`); NaN where nobody answers, or nobody is wrong or doubts."""
    answered, what, where, taps, way, wrong, doubt, given_up, unstopped = np.moveaxis(mean, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where((wrong > 0) & (doubt > 0), wrong / doubt, np.nan)
        of_answers = [values / answered for values in (what, where)]
        return np.stack([*of_answers, taps, way, wrong / answered, given_up, unstopped, factor], axis=-1)


def curve(means: Means) -> list[list[Interval]]:
    """`QUANTITIES` at every level with intervals."""
    values, errors = jackknife([means], quantities)
    n = len(means)
    return [[interval(v, e, n, 1) for v, e in zip(*row, strict=True)] for row in zip(values, errors, strict=True)]


def at_taps(mean: NDArray[np.float64], taps: Sequence[float]) -> NDArray[np.float64]:
    """`AT_TAPS` of a curve (level, `SUMS`) at mean numbers of taps, shape (points, `AT_TAPS`); NaN beyond its ends."""
    found = quantities(mean)
    known = np.isfinite(found[:, 0])
    if not known.any():
        return np.full((len(taps), len(AT_TAPS)), np.nan)
    order = np.flatnonzero(known)[np.argsort(found[known, 2], kind="stable")]
    times, points = found[order, 2], np.asarray(taps, dtype=np.float64)
    columns = [found[order, QUANTITIES.index(name)] for name in AT_TAPS]
    return np.stack([np.interp(points, times, column, np.nan, np.nan) for column in columns], axis=-1)


def differences(means: Means, base: Means, taps: Sequence[float], intervals: int) -> list[list[Interval]]:
    """`AT_TAPS` less those of another curve at equal mean numbers of taps.

    Args:
        means: Of units.
        base: Of the same units, the other.
        taps: At these.
        intervals: That are to hold together.

    Returns:
        For each number of taps as many intervals, NaN where one of the curves does not come there.
    """
    values, errors = jackknife([means, base], lambda new, old: at_taps(new, taps) - at_taps(old, taps))
    n = len(means)
    return [
        [interval(v, e, n, intervals) for v, e in zip(*row, strict=True)] for row in zip(values, errors, strict=True)
    ]
