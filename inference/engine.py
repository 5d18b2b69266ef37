"""One interface to every way of computing the posterior, and the plain NumPy one behind it.

An engine turns taps into log beliefs; what to decide and where to move is not its business. All engines carry the
normalised log belief of shape (L, M) without any floor, so sequences may be of any length.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.errors import InputError
from ..models.histogram import HistogramModel
from . import reference
from .reference import Border


class Engine(Protocol):
    """Bayes' rule over taps and moves."""

    @property
    def name(self) -> str:
        """How the engine is called on the command line."""
        ...

    @property
    def model(self) -> HistogramModel:
        """The measurement model behind it, which holds the belief before the first tap, `log_prior`."""
        ...

    def update(self, log_belief: NDArray[np.float64], tap: ArrayLike) -> tuple[NDArray[np.float64], float]:
        """Log belief after one more tap, and the log evidence of that tap given those before; Eq. 3 and 4.

        Args:
            log_belief: Shape (L, M).
            tap: Prepared samples, shape (J, K).

        Raises:
            InputError: The tap has not the size of the training taps, or a sample is NaN.
            ZeroEvidenceError: The tap is impossible under every class.
        """
        ...

    def shift(self, log_belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Log belief after a move by `delta` where classes; Eq. 9."""
        ...


@dataclass(frozen=True)
class NumpyEngine:
    """The reference equations, one after the other.

    Attributes:
        model: The fitted measurement model.
        border: Reading of Eq. 9 at the ends of the range.
    """

    model: HistogramModel
    border: Border = "uniform"
    name: str = "numpy"

    @cached_property
    def log_prob(self) -> NDArray[np.float64]:
        """Eq. 2 from the model's counts; -inf throughout for untrained classes."""
        model = self.model
        log_prob = np.full(model.counts.shape, -np.inf)
        with np.errstate(divide="ignore"):
            log_prob[model.trained] = np.log(
                reference.histogram_probabilities(model.counts[model.trained], model.pseudocount)
            )
        return log_prob

    def update(self, log_belief: NDArray[np.float64], tap: ArrayLike) -> tuple[NDArray[np.float64], float]:
        """Eq. 1, 3 and 4."""
        tap = np.asarray(tap)
        self.model.check_samples(tap)
        log_likelihood = reference.tap_log_likelihood(self._bins(tap), self.log_prob, self.model.exponent)
        return reference.update_log(log_belief, log_likelihood)

    def shift(self, log_belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Eq. 9."""
        return reference.shift_log(log_belief, delta, self.border)

    def _bins(self, tap: NDArray[np.float64]) -> NDArray[np.intp]:
        edges = self.model.edges
        if edges.ndim == 1:
            return reference.bin_index(tap, edges)
        return np.stack([reference.bin_index(tap[:, k], edges[k]) for k in range(len(edges))], axis=1)


def make_engine(name: str, model: HistogramModel, border: Border = "uniform") -> Engine:
    """The engine of this name.

    Args:
        name: `"numpy"` (the reference equations), `"numpyro"` (the enumerated NumPyro model) or `"filter"` (the
            compiled update of the Monte Carlo).
        model: The fitted measurement model.
        border: Reading of Eq. 9.

    Raises:
        InputError: There is no such engine or border, or the border is no kernel and the engine needs one.
    """
    if border not in reference.BORDERS:
        raise InputError(f"The border must be one of {', '.join(reference.BORDERS)}, got {border!r}.")
    if name == "numpy":
        return NumpyEngine(model, border)
    if name == "numpyro":
        from .enumeration import NumpyroEngine  # noqa: PLC0415 - NumPyro takes seconds to import

        return NumpyroEngine(model, border)
    if name == "filter":
        from .filter import FilterEngine  # noqa: PLC0415

        return FilterEngine(model, border)
    raise InputError(f"The engine must be numpy, numpyro or filter, got {name!r}.")
