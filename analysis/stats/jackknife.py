"""Functions of means over units, with intervals.

Means of units have the unit as their first axis; units are data sets, sessions or resamples of test taps, see
`resampled_units`. Intervals are t-intervals of the jackknife over units, which for a plain mean is the usual t-interval
and for a paired difference that of the differences.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from .metrics import CONFIDENCE

FEWEST_UNITS = 5
"""Below it nothing is called sure: the tails of t-intervals of so few units rest on a distribution nobody can see."""

type Means = NDArray[np.float64]


class Interval(NamedTuple):
    """A number with its 95% interval, and one that holds together with all others of the same source."""

    value: float
    low: float
    high: float
    least: float
    most: float

    @property
    def sure(self) -> bool:
        """Whether zero lies outside the simultaneous interval."""
        return self.least > 0 or self.most < 0

    def within(self, limit: float) -> bool:
        """Whether the whole simultaneous interval is closer to zero than a limit."""
        return max(abs(self.least), abs(self.most)) <= limit


def jackknife(
    samples: Sequence[Means], statistic: Callable[..., NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A function of means over units and its standard error.

    Args:
        samples: Arrays whose first axis is the same n units.
        statistic: Takes the mean of each array over units, gives an array.

    Returns:
        Its value and standard error; NaN for fewer than two units.
    """
    n = len(samples[0])
    means = [values.mean(axis=0) for values in samples]
    value = np.asarray(statistic(*means), dtype=np.float64)
    if n < 2:
        return value, np.full_like(value, np.nan)
    others = np.array(
        [
            statistic(*(mean + (mean - values[i]) / (n - 1) for mean, values in zip(means, samples, strict=True)))
            for i in range(n)
        ]
    )
    spread = others - others.mean(axis=0)
    return value, np.sqrt((n - 1) / n * (spread**2).sum(axis=0))


def shared_training(F: int) -> float:
    """By how much a t-interval over F sessions is too narrow if each is tested with the model of the others.

    These models share most of their training taps, and a session's taps also make the models that test the others. So
    results of sessions depend on each other, and differ less than independent ones would: the variance of their mean is
    taken as 1 / F + 1 / (F - 1) times theirs instead of 1 / F (Nadeau and Bengio 2003).
    """
    return math.sqrt(1 + F / (F - 1))


def interval(value: float, error: float, units: int, intervals: int) -> Interval:
    """The intervals of a number with this standard error; the simultaneous one is infinite below `FEWEST_UNITS`."""
    tail = (1 - CONFIDENCE) / 2
    half, wide = (_quantile(1 - share, max(units - 1, 1)) * error for share in (tail, tail / intervals))
    if units < FEWEST_UNITS:
        wide = np.inf
    return Interval(*map(float, (value, value - half, value + half, value - wide, value + wide)))


@cache
def _quantile(share: float, freedom: int) -> float:
    return float(stdtrit(freedom, share))


def as_factor(value: Interval) -> Interval:
    """The interval of a factor from that of its logarithm; infinite where a float cannot hold it."""
    with np.errstate(over="ignore"):
        return Interval(*np.exp(value).tolist())


def as_numbers(value: Interval, name: str = "value") -> dict[str, float | None]:
    """The five numbers under names that pages know; `None` where there is none."""
    ends = ("", "_low", "_high", "_least", "_most")
    return {f"{name}{end}": x if math.isfinite(x) else None for end, x in zip(ends, value, strict=True)}
