"""Arguments of generative models: taps and priors."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...blocks import ScaledSamples, over_blocks


class Taps(NamedTuple):
    """Taps of known class.

    Attributes:
        samples: Scaled, shape (N, J, K); of a large recording perhaps `blocks.ScaledSamples`.
        where: Where class of each tap, shape (N,).
        what: What class of each tap, shape (N,).
        shape: (L, M).
        place: Position of each tap, shape (N,).
        least: Standard deviation below which none counts, broadcast over (K,).
    """

    samples: NDArray[np.float64]
    where: NDArray[np.intp]
    what: NDArray[np.intp]
    shape: tuple[int, int]
    place: NDArray[np.float64] = np.zeros(0)
    least: Any = 0.0

    def under(self, story: Callable[..., None], **arguments: Any) -> Callable[[], None]:
        """Generative model in the contract of `generic.contract`, of these taps."""
        told, data = self.apart(story, **arguments)
        return lambda: told(*data)

    def apart(self, story: Callable[..., None], **arguments: Any) -> tuple[Callable[..., None], tuple[Any, Any, Any]]:
        """As `under`, but of any taps of these sizes that lack the same samples, and `where`, `what` and samples."""
        from .present import Present

        (L, M), (_, J, K) = self.shape, self.samples.shape
        samples, present = filled(self.samples)
        taken: Any = story if present is None else Present(story, "taps", present)
        return partial(taken, L=L, M=M, J=J, K=K, **arguments), (self.where, self.what, samples)

    def over_blocks[T](self, work: Callable[[NDArray[np.float64], slice], T]) -> Iterator[T]:
        """As `blocks.over_blocks`; an array is one block, so sums over it are rounded in one way."""
        if isinstance(self.samples, ScaledSamples):
            return over_blocks(self.samples, work)
        return iter((work(self.samples, slice(0, len(self.samples))),))

    def first(self) -> "Taps":
        """The first tap."""
        return self._replace(samples=self.samples[:1], where=self.where[:1], what=self.what[:1], place=self.place[:1])


class CellPrior(NamedTuple):
    """Normal-inverse-gamma prior of the level and variance of a cell: a class, time and taxel.

    Attributes:
        level: Expected level, broadcast over (L, M, J, K).
        strength: How many samples that expectation is worth; 0 for a flat prior.
        a: Shape of the inverse gamma distribution of the variance, broadcast likewise.
        b: Its rate.
    """

    level: Any
    strength: Any
    a: Any
    b: Any


def filled(samples: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_] | None]:
    """Samples (N, J, K) with one that occurs in the place of missing ones, and the mask of those that are there.

    The mask is `None` if all are.
    """
    samples = np.asarray(samples)
    present = ~np.isnan(samples)
    if present.all():
        return samples, None
    rows, there = samples.reshape(-1, samples.shape[2]), present.reshape(-1, samples.shape[2])
    some = rows[there.argmax(axis=0), np.arange(rows.shape[1])]
    some = np.where(np.isnan(some), rows[there][0] if there.any() else 0.0, some)  # of a taxel without samples
    return np.where(present, samples, some), present
