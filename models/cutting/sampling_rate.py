"""Sampling rate by times that are rounded, jitter, pause, or lack samples."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import check_numbers
from .sessions import breaks

_AT_MOST = 2**20
_AROUND = 9  # samples on either side of a long step that tell whether one is lost there
_LOST = 0.7  # of a period by which all later times shift if a sample is lost
_MANY = 0.12  # share of long steps from which a coarse clock makes them, rather than lost samples
_LONG = 1.5  # median steps from which a step may be over lost samples
_EVEN = 0.2  # standard deviation of even steps at most, in proportion
_UNEVEN = 0.66  # of a period between 5% and 95% of steps, as of a standard deviation of `_EVEN`
_ON_GRID = 0.01  # of the unit of a clock by which its times may miss the multiples of it
_TRIES = 3  # as lost samples shorten the period, and a shorter one finds more
_CLOCKS = 2e-4  # by which two good clocks may differ in proportion
_ERRORS = 2.0  # standard errors within which a rate may be a rounder one
_MOST = 0.02  # by which a rate is rounded at most, in proportion


class Pace(NamedTuple):
    """Straight line through the times of samples, of one slope in all stretches without a gap.

    Attributes:
        period_s: Its slope, time from sample to sample.
        spread: Sum of squares of the numbers of samples about the mean of their stretch.
        misfit: Sum of squares of the differences of times from the line, in s².
        samples: Number of times.
        stretches: Number of stretches.
        starts: Their first times, each once: stretches that all begin at 0 are rounded alike.
        uneven: Steps between samples in seconds where they vary widely: 5% are shorter than the first, 5% longer than
            the second; `None` where they do not, or a coarse clock makes them.
    """

    period_s: float
    spread: float
    misfit: float
    samples: int
    stretches: int
    starts: frozenset[float]
    uneven: tuple[float, float] | None = None

    def error(self, noise_s: float) -> float:
        """Standard error of the period in proportion, if differences from the line last as long as a stretch.

        Args:
            noise_s: Standard deviation of times.
        """
        samples = self.samples / self.stretches / len(self.starts)
        return float(noise_s * np.sqrt(samples / self.spread) / self.period_s)


def pace(time: ArrayLike, broken: ArrayLike) -> Pace | None:
    """Pace of samples; `None` if no two of them follow one another.

    Steps of more than `sessions.GAP_STEPS` median ones, and back, are gaps. A step of two or more periods that delays
    all later times is one over lost samples, which count. Of more than a million times the first ones tell.

    Args:
        time: Time of each sample in seconds, shape (S,); NaN if unknown.
        broken: Whether a sample does not follow the one before it, as at the begin of a tap, shape (S,).
    """
    time, known = check_numbers(time, "time")[:_AT_MOST], np.asarray(broken, dtype=bool)[:_AT_MOST]
    there = ~np.isnan(time)
    stretch, number = np.cumsum(known)[there], np.flatnonzero(there)
    time = time[there].astype(np.float64)
    begins = np.append(True, stretch[1:] != stretch[:-1])[: len(time)]
    begins |= breaks(time, begins)
    inside = ~begins
    if not inside.any():
        return None
    steps, samples = np.diff(time, prepend=0.0)[inside], np.diff(number, prepend=0)[inside]
    whole = _line(time, number, begins)
    if whole is None:
        return None
    period = whole.period_s
    unit = _coarse_unit(steps, period)
    if not (unit and (_regular(steps, unit) or _within(1.2 * unit, time - period * number, begins))):
        period, unit = _even(steps / samples, period), 0.0
    lost = np.zeros(len(time), dtype=np.intp)
    for _ in range(_TRIES):
        lost = _lost(time, number, begins, period, unit)
        better = float(steps.sum() / (samples + lost[inside]).sum())
        if better == period:
            break
        period = better
    found = _line(time, number + np.cumsum(lost), begins)
    return found if found is None or unit else found._replace(uneven=_uneven(steps / samples, period))


def common_rate(paces: Sequence[Pace]) -> tuple[float, NDArray[np.float64]]:
    """Rate in hertz of several paces of one sensor, and by how much each may differ from it by chance, in proportion.

    The rate is the one of fewest digits within two standard errors, or within 0.02% if that is more; it is rounded by
    2% at most.

    Args:
        paces: At least one.
    """
    spread, misfit = sum(each.spread for each in paces), sum(each.misfit for each in paces)
    samples, stretches = sum(each.samples for each in paces), sum(each.stretches for each in paces)
    noise = float(np.sqrt(misfit / max(1, samples - stretches - len(paces))))
    period = sum(each.spread * each.period_s for each in paces) / spread
    whole = Pace(period, spread, misfit, samples, stretches, frozenset[float]().union(*(each.starts for each in paces)))
    near = max(_CLOCKS, min(_MOST, _ERRORS * whole.error(noise)))
    return _rounded(1 / period, near), np.array([_ERRORS * each.error(noise) for each in paces])


def _uneven(steps: NDArray[np.float64], period: float) -> tuple[float, float] | None:
    """Nearly the shortest and longest step, if these differ widely."""
    short, long = np.quantile(steps, (0.05, 0.95)).tolist()
    return (short, long) if long - short > _UNEVEN * period else None


def _rounded(rate: float, part: float) -> float:
    """The number of fewest digits, six at most, within a part of the rate."""
    digits = (float(f"{rate:.{more}e}") for more in range(6))
    return next((each for each in digits if abs(each - rate) <= part * rate), float(f"{rate:.6g}"))


def _even(steps: NDArray[np.float64], mean: float) -> float:
    """Mean step, where steps are even without those over lost samples."""
    even = steps[steps < _LONG * np.median(steps)]
    return float(even.mean()) if len(even) and even.std() < _EVEN * mean else mean


def _coarse_unit(steps: NDArray[np.float64], period: float) -> float:
    """Unit of a clock that is about a period or longer, so that it makes steps of 0, 1 and 2 units; else 0."""
    rising = steps[steps > 0]
    unit = float(rising.min()) if len(rising) else np.inf
    on_grid = (abs(steps / unit - np.rint(steps / unit)) < _ON_GRID).all()
    return unit if period < 2.1 * unit < np.inf and on_grid else 0.0


def _regular(steps: NDArray[np.float64], unit: float) -> bool:
    """Whether a clock of that unit makes steps of two units so often and evenly as lost samples would not be."""
    middle = np.median(steps)
    apart = np.diff(np.flatnonzero(steps > _LONG * middle))
    return bool(middle > _LONG * unit or (len(apart) > _MANY * len(steps) and apart.std() < apart.mean() / 2))


def _within(most: float, delay: NDArray[np.float64], begins: NDArray[np.bool_]) -> bool:
    """Whether the times of each stretch are that near a line."""
    starts = np.flatnonzero(begins)
    return bool((np.maximum.reduceat(delay, starts) - np.minimum.reduceat(delay, starts) < most).all())


def _lost(
    time: NDArray[np.float64], number: NDArray[np.intp], begins: NDArray[np.bool_], period: float, unit: float
) -> NDArray[np.intp]:
    """Number of samples that are lost before each one, shape (S,); with the unit of a coarse clock as few as can be."""
    lost, delay = np.zeros(len(time), dtype=np.intp), time - period * number
    long = np.flatnonzero(~begins & (np.diff(delay, prepend=0.0) > period / 2))
    if unit:
        late = np.diff(time, prepend=0.0)[long] - unit
        lost[long] = np.maximum(0, np.ceil(late / period - _ON_GRID) - 1)
        return lost
    bounds = np.union1d(np.append(np.flatnonzero(begins), len(time)), long)
    which = np.searchsorted(bounds, long)
    for at, first, end in zip(long.tolist(), bounds[which - 1].tolist(), bounds[which + 1].tolist(), strict=True):
        before, after = delay[max(first, at - _AROUND) : at], delay[at : min(end, at + _AROUND)]
        lost[at] = max(0, int((np.median(after) - np.median(before)) / period + 1 - _LOST))
    return lost


def _line(time: NDArray[np.float64], number: NDArray[np.intp], begins: NDArray[np.bool_]) -> Pace | None:
    starts = np.flatnonzero(begins)
    lengths = np.diff(starts, append=len(time))

    def from_mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return values - np.repeat(np.add.reduceat(values, starts) / lengths, lengths)

    x = from_mean((number - np.repeat(number[starts], lengths)).astype(np.float64))
    y = from_mean(time - np.repeat(time[starts], lengths))
    spread = float(x @ x)
    slope = float(x @ y) / spread
    if not slope > 0:
        return None
    apart = y - slope * x
    several = lengths > 1
    first = frozenset(time[starts[several]].tolist())
    return Pace(slope, spread, float(apart @ apart), int(lengths[several].sum()), int(several.sum()), first)
