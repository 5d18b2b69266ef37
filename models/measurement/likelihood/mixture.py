"""A form that is the mean of others, such as those of draws from a posterior."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...threads import cores, in_order
from .any_form import Form, Prepared
from .forms import AT_ONCE, PreparedGaussian, bin_gaps


class MixtureForm(NamedTuple):
    """Equal mixture of D forms: a tap has the mean of the probabilities that they give to it as a whole.

    Attributes:
        parts: The forms, of one shape.
    """

    parts: tuple[Form, ...]

    @property
    def exchangeable(self) -> bool:
        """Whether a tap may have any number of samples."""
        return self.parts[0].exchangeable

    @property
    def independent(self) -> bool:
        """Whether samples are independent under a hypothesis of a part."""
        return self.parts[0].independent

    def in_state(self, gain: float, offset: float, edges: NDArray[np.float64]) -> Self:
        """Form of `gain` times a tap plus `offset`."""
        return self._replace(parts=tuple(part.in_state(gain, offset, edges) for part in self.parts))

    @staticmethod
    def joined(parts: Sequence["MixtureForm"]) -> "MixtureForm":
        """Form over the hypotheses of several mixtures with as many parts, one after another."""
        each = zip(*(mixture.parts for mixture in parts), strict=True)
        return MixtureForm(tuple(of_one[0].joined(of_one) for of_one in each))

    @property
    def shape(self) -> tuple[int, int]:
        """(L, H)."""
        return self.parts[0].shape

    def prepare(self, impossible: NDArray[np.bool_]) -> "PreparedMixture":
        """Precomputed form; hypotheses in the mask `impossible`, shape (L, H), have likelihood 0."""
        return PreparedMixture(tuple(part.prepare(impossible) for part in self.parts))

    def own(
        self, taps: NDArray[np.floating], edges: NDArray[np.float64], where: NDArray[np.intp], what: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Log probability of the bins of taps (N, J, K) under their own hypotheses, shape (N,)."""
        each = [part.own(taps, edges, where, what) for part in self.parts]
        return np.logaddexp.reduce(each, axis=0) - np.log(len(each))

    def sample(
        self,
        where: NDArray[np.intp],
        what: NDArray[np.intp],
        edges: NDArray[np.float64],
        J: int,
        generator: np.random.Generator,
    ) -> NDArray[np.float64]:
        """Taps under hypotheses (N,), each of a part drawn for it, shape (N, J, K)."""
        chosen = generator.integers(len(self.parts), size=len(where))
        taps = None
        for number in np.unique(chosen):
            rows = chosen == number
            made = self.parts[number].sample(where[rows], what[rows], edges, J, generator)
            taps = np.empty((len(where), *made.shape[1:])) if taps is None else taps
            taps[rows] = made
        return np.empty((0, J, 0)) if taps is None else taps


def mean_form(parts: Sequence[Form]) -> Form:
    """Equal mixture of forms, or the only one."""
    return parts[0] if len(parts) == 1 else MixtureForm(tuple(parts))


class PreparedMixture(NamedTuple):
    """Precomputed `MixtureForm`.

    Attributes:
        parts: The precomputed forms.
    """

    parts: tuple[Prepared, ...]

    def log_likelihood(
        self, taps: NDArray[np.floating], edges: NDArray[np.float64], exponent: float, out: NDArray[np.float64]
    ) -> None:
        """Writes `exponent` times the log probability of the bins of taps (N, J, K) to `out`, shape (N, L, H)."""
        few = len(taps) <= AT_ONCE  # of which a part makes no threads of its own
        workers = min(cores(None), len(self.parts)) if few else 1
        first = self.parts[0]
        gaps = bin_gaps(taps, edges, first.independent) if few and isinstance(first, PreparedGaussian) else None

        def summed(parts: Sequence[Prepared]) -> NDArray[np.float64]:
            total, one = np.full(out.shape, -np.inf), np.empty(out.shape)
            for part in parts:
                if gaps is not None and isinstance(part, PreparedGaussian):
                    one[...] = part.of_gaps(gaps)
                else:
                    part.log_likelihood(taps, edges, 1.0, one)
                np.logaddexp(total, one, out=total)
            return total

        tasks = (partial(summed, self.parts[i::workers]) for i in range(workers))
        total = np.logaddexp.reduce(list(in_order(tasks, workers)), axis=0)
        out[...] = exponent * (total - np.log(len(self.parts)))
