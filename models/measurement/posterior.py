"""What is known of a model's parameters after training; and that of the histogram model, which is exact."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .fits.convergence import EXACT, Convergence
from .histogram import HistogramModel
from .likelihood.bins import find_bins
from .likelihood.shapes import Parameters


class Posterior(Protocol):
    """The distribution of a model's parameters given the training taps."""

    def point(self) -> Parameters:
        """One value of each parameter, with which the model decides."""
        ...

    def draw(self, generator: np.random.Generator) -> Parameters:
        """Parameters from the posterior."""
        ...

    def convergence(self) -> Convergence:
        """How it was found."""
        ...


class HistogramPosterior(NamedTuple):
    """Dirichlet posterior of the histograms; exact.

    Attributes:
        concentration: Of every bin, shape (L, M, K, B).
    """

    concentration: NDArray[np.float64]

    @classmethod
    def of(cls, model: HistogramModel) -> "HistogramPosterior":
        """That of a fitted histogram model; without a pseudocount it is improper.

        Raises:
            InputError: There is no pseudocount.
        """
        if model.pseudocount == 0:
            raise InputError("Without a pseudocount the histogram model has no posterior: its prior is improper.")
        return cls(model.counts.astype(np.float64) + model.pseudocount)

    def point(self) -> Parameters:
        """Eq. 2."""
        total = self.concentration.sum(axis=-1, keepdims=True)
        return {"log_prob": np.log(self.concentration / total)}

    def draw(self, generator: np.random.Generator) -> Parameters:
        """Log probabilities of the bins; many lie far below the range of plain numbers."""
        alpha = self.concentration
        log_gamma = np.log(generator.standard_gamma(alpha + 1)) - generator.standard_exponential(alpha.shape) / alpha
        return {"log_prob": log_gamma - np.logaddexp.reduce(log_gamma, axis=-1, keepdims=True)}

    def convergence(self) -> Convergence:
        """Exact."""
        return EXACT

    def leave_out(self, taps: NDArray[np.floating], edges: NDArray[np.float64], own: NDArray[np.intp]) -> "LeftOut":
        """Log probability of each training tap given all others of its class; counts of the tap are subtracted.

        Args:
            taps: The training taps, shape (N, J, K).
            edges: Of the bins.
            own: Class l M + m of each, shape (N,).
        """
        from scipy.special import gammaln  # noqa: PLC0415

        K, B = self.concentration.shape[2:]
        rows = self.concentration.reshape(-1, K, B)
        bins = find_bins(taps, edges)
        integrated, plug_in = np.empty(len(taps)), np.empty(len(taps))
        taxel = np.repeat(np.arange(K)[None], taps.shape[1], axis=0)
        for n, c in enumerate(own):
            counts = np.zeros((K, B))
            np.add.at(counts, (taxel, bins[n]), 1.0)
            rest = np.maximum(rows[c] - counts, np.finfo(float).tiny)
            total, hit = rest.sum(axis=1), counts > 0
            integrated[n] = (gammaln(total) - gammaln(total + taps.shape[1])).sum() + (
                gammaln(rest[hit] + counts[hit]) - gammaln(rest[hit])
            ).sum()
            plug_in[n] = (counts * np.log(rest / total[:, None])).sum()
        return LeftOut(integrated, plug_in)


class LeftOut(NamedTuple):
    """Log probability of each tap given all others, shape (N,) both.

    Attributes:
        integrated: Over the posterior.
        plug_in: At its mean.
    """

    integrated: NDArray[np.float64]
    plug_in: NDArray[np.float64]
