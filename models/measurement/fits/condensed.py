"""Few weighted samples in place of many, for fits that go through all samples at every step.

The samples of a class and taxel are sorted into bins, each of which becomes two samples of equal weight with its
number, mean and variance (Gauss's quadrature). The width of a bin is an eighth of its distance from the mean, or, near
the mean, of a small part of the standard deviation, because that may be large against the scale where tails are heavy.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiled import compiled
from ..scaling import Moments
from .priors import Taps

_BINS = 160  # of a class and taxel; they reach to 344 standard deviations from the mean
_PER_DISTANCE = 8.0
_NEAR = 1 / 32  # of a standard deviation
_SIZES = 32  # numbers of samples are multiples of it, so that programs compiled for one fit serve others
_ONE_VALUE = 1e-6  # a spread that rounding may be, in units and relative to the distance from the mean


class Condensed(NamedTuple):
    """Weighted samples that stand for those of taps.

    Attributes:
        taps: A tap for each class that has one, of as many samples as any taxel of any class needs.
        weight: How many samples each stands for, shape (C, J', K); 0 for those that only fill the array.
    """

    taps: Taps
    weight: NDArray[np.float64]


def condensed(taps: Taps, moments: Moments) -> Condensed:
    """Weighted samples with the number, mean and variance of the samples in each bin of each class and taxel.

    Args:
        taps: Taps of known class; samples may be missing.
        moments: Theirs.
    """
    classes, own = np.unique(taps.where * taps.shape[1] + taps.what, return_inverse=True)
    where, what = np.divmod(classes, taps.shape[1])
    count, level, square = (array[where, what, 0] for array in moments.pooled())
    unit = _NEAR * np.sqrt(square / np.maximum(count, 1))
    unit = np.where(unit > 0, unit, 1.0)
    sums = np.zeros((*level.shape, _BINS, 3))
    for block, which in taps.over_blocks(lambda block, which: (block, which)):
        _add(block, own[which], level, unit, sums)
    parts = [_two_of_each(one) for one in sums]
    longest = max(values.shape[-1] for values, _ in parts)
    samples = np.zeros((len(parts), -(-longest // _SIZES) * _SIZES, level.shape[1]))
    weight = np.zeros_like(samples)
    for c, (values, times) in enumerate(parts):
        samples[c, : values.shape[1]], weight[c, : values.shape[1]] = values.T, times.T
    samples = level[:, None] + unit[:, None] * samples
    return Condensed(taps._replace(samples=samples, where=where, what=what, place=np.zeros(len(where))), weight)


def _two_of_each(sums: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values and weights of a class, shape (K, J') both, from the sums of powers in its bins (K, B, 3)."""
    number, total, square = np.moveaxis(sums, -1, 0)
    mean = total / np.maximum(number, 1)
    spread = np.sqrt(np.maximum(square / np.maximum(number, 1) - mean**2, 0.0))
    one = spread < _ONE_VALUE * (1 + np.abs(mean))
    values = np.concatenate([np.where(one, mean, mean - spread), mean + spread], axis=-1)
    weight = np.concatenate([np.where(one, number, number / 2), np.where(one, 0.0, number / 2)], axis=-1)
    longest = (weight > 0).sum(axis=-1).max()
    first = np.argsort(weight == 0, axis=-1, kind="stable")[:, :longest]
    return np.take_along_axis(values, first, axis=-1), np.take_along_axis(weight, first, axis=-1)


@compiled
def _add(block, own, level, unit, sums):
    """Adds the number, sum and sum of squares of samples to those of their bins, from the mean of their class.

    Args:
        block: Samples (n, J, K); NaN for one that is missing.
        own: Row of each tap's class in the other arrays, shape (n,).
        level: Means (C, K).
        unit: Units (C, K).
        sums: Changed in place, shape (C, K, B, 3).
    """
    B = sums.shape[2]
    for i in range(len(block)):
        c = own[i]
        for j in range(block.shape[1]):
            for k in range(block.shape[2]):
                value = (block[i, j, k] - level[c, k]) / unit[c, k]
                if np.isnan(value):
                    continue
                b = np.floor(np.arcsinh(value) * _PER_DISTANCE) + B // 2
                row = sums[c, k, np.int64(min(max(b, 0.0), B - 1.0))]
                row[0] += 1
                row[1] += value
                row[2] += value * value
