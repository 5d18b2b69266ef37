"""Scaling of samples to common units for all taxels, so that one prior suits any sensor."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..blocks import ScaledSamples
from .fits.priors import Taps


class Scaling(NamedTuple):
    """Origin and unit of each taxel.

    Attributes:
        centre: Mean of all training samples of a taxel, shape (K,).
        unit: Standard deviation within classes and times, at least that of a uniform draw from a bin, shape (K,).
    """

    centre: NDArray[np.float64]
    unit: NDArray[np.float64]

    @classmethod
    def of(cls, taps: Taps, edges: NDArray[np.float64]) -> Self:
        """Scaling of training taps, in their own unit."""
        moments, (N, J, K) = Moments.of(taps), taps.samples.shape
        freedom = np.maximum(np.broadcast_to(moments.samples, moments.mean.shape) - 1, 0).sum(axis=(0, 1, 2))
        within = moments.square.sum(axis=(0, 1, 2)) / np.maximum(freedom, 1.0)
        total, number = np.zeros(K), np.zeros(K)
        for added, present in taps.over_blocks(_totals):
            total, number = total + added, number + present
        centre = total / (N * J) * (N * J / np.maximum(number, 1))
        return cls(centre, np.maximum(np.sqrt(within), least_deviation(edges, K)))

    def scaled(self, taps: Taps) -> Taps:
        """Taps in scaled units."""
        samples: Any = taps.samples
        if isinstance(samples, ScaledSamples):
            return taps._replace(samples=replace(samples, centre=self.centre, unit=self.unit))
        return taps._replace(samples=(samples - self.centre) / self.unit)


def least_deviation(edges: NDArray[np.float64], K: int) -> NDArray[np.float64]:
    """Lower bound of standard deviations: that of a uniform draw from a bin, shape (K,).

    A taxel that always rested on one value in training would otherwise rule out every class once it moves a little.
    """
    return np.diff(np.broadcast_to(edges, (K, edges.shape[-1])), axis=-1).mean(axis=-1) / np.sqrt(12.0)


class Moments(NamedTuple):
    """Number, mean and sum of squares of the taps of each class; samples that are NaN do not count.

    Attributes:
        taps: How many, shape (L, M).
        samples: How many samples, shape (L, M, J, K), or (L, M, 1, 1) where none is missing.
        mean: Shape (L, M, J, K), 0 for a class without a tap.
        square: Sum of squared deviations from the mean, shape (L, M, J, K).
    """

    taps: NDArray[np.float64]
    samples: NDArray[np.float64]
    mean: NDArray[np.float64]
    square: NDArray[np.float64]

    @classmethod
    def of(cls, taps: Taps) -> Self:
        """Moments of taps of known class."""
        L, M = taps.shape
        number = np.bincount(taps.where * M + taps.what, minlength=L * M).reshape(L, M).astype(np.float64)
        count, total = number[..., None, None], class_sums(taps, lambda block, _: block)
        if not (whole := not np.isnan(total).any()):
            count = class_sums(taps, lambda block, _: ~np.isnan(block))
            total = class_sums(taps, lambda block, _: np.where(np.isnan(block), 0.0, block))
        moments = cls(number, count, total / np.maximum(count, 1), total)

        def squares(block: NDArray[np.float64], which: Any) -> NDArray[np.float64]:
            residual = block - moments.mean[taps.where[which], taps.what[which]]
            return residual**2 if whole else np.where(np.isnan(residual), 0.0, residual) ** 2

        return moments._replace(square=class_sums(taps, squares))

    def residual(self, taps: Taps, block: NDArray[np.float64], which: slice) -> NDArray[np.float64]:
        """Deviations of a block of taps from the means of their classes, shape (n, J, K)."""
        return block - self.mean[taps.where[which], taps.what[which]]

    def pooled(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Number, mean and sum of squares of the samples of all times, broadcast over (L, M, 1, K)."""
        count = np.broadcast_to(self.samples, self.mean.shape)
        number = count.sum(axis=2, keepdims=True)
        whole = self.samples.shape[2] == 1
        weighted = self.mean.mean if whole else (count * self.mean / np.maximum(number, 1)).sum
        mean = weighted(axis=2, keepdims=True)
        return number, mean, (self.square + count * (self.mean - mean) ** 2).sum(axis=2, keepdims=True)

    def without(self, part: "Moments") -> Self:
        """Moments of the other taps."""
        count = self.samples - part.samples
        mean = (self.samples * self.mean - part.samples * part.mean) / np.maximum(count, 1)
        between = part.samples * count / np.maximum(self.samples, 1) * (part.mean - mean) ** 2
        square = np.maximum(self.square - part.square - between, 0)
        return type(self)(self.taps - part.taps, count, np.where(count > 0, mean, 0.0), square)

    @property
    def freedom(self) -> float:
        """Degrees of freedom within classes."""
        return float(np.maximum(self.taps - 1, 0).sum())


def sum_by(group: NDArray[np.intp], values: NDArray[np.float64], groups: int) -> NDArray[np.float64]:
    """Sums of values (N, ...) over the members of each group, shape (groups, ...)."""
    order = np.argsort(group, kind="stable")
    present, first = np.unique(group[order], return_index=True)
    total = np.zeros((groups, *values.shape[1:]))
    if len(order):
        total[present] = np.add.reduceat(values[order], first, axis=0, dtype=np.float64)
    return total


def class_sums(taps: Taps, of: Callable[[NDArray[np.float64], Any], NDArray[Any]]) -> NDArray[np.float64]:
    """Sums over the taps of each class, shape (L, M, J, K), in the order of the taps.

    Args:
        taps: Taps of known class.
        of: From a block of samples, and the slice of its taps, to the values that are summed, of the same shape.
    """
    from .likelihood.counting import add_rows

    (L, M), (_, J, K) = taps.shape, taps.samples.shape
    own, total = taps.where * M + taps.what, np.zeros((L * M, J * K))
    for which, values in taps.over_blocks(lambda block, which: (which, of(block, which))):
        add_rows(values.reshape(len(values), J * K).astype(np.float64, copy=False), own[which], total)
    return total.reshape(L, M, J, K)


def _totals(samples: NDArray[np.float64], _: slice) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Sum and number of the samples of each taxel that are there, shape (K,) both."""
    total, number = samples.sum(axis=(0, 1)), np.full(samples.shape[2], samples.shape[0] * samples.shape[1])
    if not np.isnan(total).any():
        return total, number
    present = ~np.isnan(samples)
    return np.where(present, samples, 0.0).sum(axis=(0, 1)), present.sum(axis=(0, 1))
