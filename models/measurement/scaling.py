"""Scaling of samples to common units for all taxels, so that one prior suits any sensor."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

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
        moments, (_, J, K) = Moments.of(taps), taps.samples.shape
        freedom = np.maximum(np.broadcast_to(moments.samples, moments.mean.shape) - 1, 0).sum(axis=(0, 1, 2))
        within = moments.square.sum(axis=(0, 1, 2)) / np.maximum(freedom, 1.0)
        present = ~np.isnan(taps.samples)
        number = present.sum(axis=(0, 1))
        centre = np.where(present, taps.samples, 0.0).mean(axis=(0, 1)) * (
            len(taps.samples) * J / np.maximum(number, 1)
        )
        return cls(centre, np.maximum(np.sqrt(within), least_deviation(edges, K)))

    def scaled(self, taps: Taps) -> Taps:
        """Taps in scaled units."""
        return taps._replace(samples=(taps.samples - self.centre) / self.unit)


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
        residual: Deviation of each tap from the mean of its class, shape (N, J, K).
    """

    taps: NDArray[np.float64]
    samples: NDArray[np.float64]
    mean: NDArray[np.float64]
    square: NDArray[np.float64]
    residual: NDArray[np.float64]

    @classmethod
    def of(cls, taps: Taps) -> Self:
        """Moments of taps of known class."""
        (L, M), (_, J, K) = taps.shape, taps.samples.shape
        own = taps.where * M + taps.what
        number = np.bincount(own, minlength=L * M).astype(np.float64)
        present = ~np.isnan(taps.samples)
        whole = present.all()
        count = number[:, None, None] if whole else sum_by(own, present.astype(np.float64), L * M)
        mean = sum_by(own, taps.samples if whole else np.where(present, taps.samples, 0.0), L * M) / np.maximum(
            count, 1
        )
        residual = taps.samples - mean[own]
        square = sum_by(own, residual**2 if whole else np.where(present, residual, 0.0) ** 2, L * M)
        return cls(
            number.reshape(L, M),
            count.reshape(L, M, *count.shape[1:]),
            mean.reshape(L, M, J, K),
            square.reshape(L, M, J, K),
            residual,
        )

    def pooled(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Number, mean and sum of squares of the samples of all times, broadcast over (L, M, 1, K)."""
        count = np.broadcast_to(self.samples, self.mean.shape)
        number = count.sum(axis=2, keepdims=True)
        whole = self.samples.shape[2] == 1
        weighted = self.mean.mean if whole else (count * self.mean / np.maximum(number, 1)).sum
        mean = weighted(axis=2, keepdims=True)
        return number, mean, (self.square + count * (self.mean - mean) ** 2).sum(axis=2, keepdims=True)

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
        total[present] = np.add.reduceat(values[order], first, axis=0)
    return total
