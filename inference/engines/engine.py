"""Interface of all engines, which compute the posterior, and the engine in plain NumPy.

An engine turns taps into log beliefs; it makes no decisions and no moves. All engines use the normalised log belief of
shape (L, H) without a floor, so sequences may have any length. H is the number of hypotheses: objects, or objects in
states (see `models.measurement.states`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.errors import InputError
from ...models.io.model_file import ModelSource, model_of
from ...models.measurement.histogram import HistogramModel
from ...models.measurement.model import TapModel
from .. import reference
from .. import reference_models as plain
from ..reference import Border


@runtime_checkable
class Engine(Protocol):
    """Bayes' rule over taps and moves."""

    @property
    def name(self) -> str:
        """Name of the engine."""
        ...

    @property
    def model(self) -> TapModel:
        """Fitted measurement model, with the belief before the first tap, `log_prior`."""
        ...

    def update(self, log_belief: NDArray[np.float64], tap: ArrayLike) -> tuple[NDArray[np.float64], float]:
        """Log belief after a tap, shape (L, H), and the log evidence of the tap given the earlier ones; Eq. 3 and 4.

        Args:
            log_belief: Log belief before the tap, shape (L, H).
            tap: Preprocessed samples, shape (J, K).

        Raises:
            InputError: The tap differs in shape from the training taps, or a sample is NaN or infinite.
            ZeroEvidenceError: The tap is impossible under every class.
        """
        ...

    def shift(self, log_belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Log belief after a move by `delta` positions, shape (L, H), separately for each state; Eq. 9."""
        ...


@dataclass(frozen=True)
class NumpyEngine:
    """The reference equations, one by one.

    Attributes:
        model: The fitted measurement model.
        border: Reading of Eq. 9 at the ends of the range.

    Raises:
        InputError: The border is `prior` and the model carries a state.
    """

    model: TapModel
    border: Border = "uniform"
    name: str = "numpy"

    def __post_init__(self) -> None:
        """Checks the border."""
        if self.border == "prior" and self._states > 1:
            raise InputError("border 'prior' does not support models that carry a state; use 'uniform'.")

    @cached_property
    def log_prob(self) -> NDArray[np.float64]:
        """Eq. 2 from the counts of a histogram without states, shape (L, M, K, B); -inf for untrained classes."""
        model = self.model
        if not isinstance(model, HistogramModel):
            raise TypeError(f"A {type(model).__name__} has no counts.")
        return reference.log_histograms(model.counts, model.pseudocount)

    def update(self, log_belief: NDArray[np.float64], tap: ArrayLike) -> tuple[NDArray[np.float64], float]:
        """Eq. 1, 3 and 4."""
        tap = np.asarray(tap)
        self.model.check_samples(tap)
        return reference.update_log(log_belief, self._log_likelihood(tap))

    def shift(self, log_belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Eq. 9; moves do not change the belief over states."""
        if self._states == 1:
            return reference.shift_log(log_belief, delta, self.border, self.model.trained)
        parts = np.split(log_belief, self._states, axis=1)
        return np.concatenate([self._shift_state(part, delta) for part in parts], axis=1)

    @property
    def _states(self) -> int:
        return len(self.model.states.gain)

    def _log_likelihood(self, tap: NDArray[np.floating]) -> NDArray[np.float64]:
        """Eq. 1 under the model's assumptions, shape (L, H)."""
        model = self.model
        if isinstance(model, HistogramModel) and model.form is model.plain_form:
            return plain.table_log_likelihood(tap, self.log_prob, model.edges, model.exponent)
        log_likelihood = plain.log_likelihood(tap, model.form, model.edges, model.exponent)
        return np.where(np.isneginf(model.log_prior), -np.inf, log_likelihood)

    def _shift_state(self, part: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Log belief in one state, shape (L, M), after a move."""
        mass = np.logaddexp.reduce(part.ravel())
        if np.isneginf(mass):
            return part
        return reference.shift_log(part - mass, delta, self.border, self.model.trained) + mass


def make_engine(name: str, model: ModelSource, border: Border = "uniform") -> Engine:
    """Engine by name.

    >>> import solidtouch as st
    >>> engine = make_engine("numpy", st.fit(st.simulate("paper", seed=4)), border="clamp")
    >>> engine.name, engine.model.grid.shape
    ('numpy', (16, 5))

    Args:
        name: `"numpy"` (the reference equations), `"numpyro"` (the enumerated NumPyro model) or `"filter"` (the
            compiled update of the Monte Carlo trials).
        model: The fitted measurement model or its file.
        border: Interpretation of Eq. 9 at the ends of the range.

    Raises:
        InputError: The engine or border is unknown, or the engine does not support the border.
    """
    if border not in reference.BORDERS:
        raise InputError(f"border must be one of {', '.join(reference.BORDERS)}, got {border!r}.")
    model = model_of(model)
    if name == "numpy":
        return NumpyEngine(model, border)
    if name == "numpyro":
        from .enumeration import NumpyroEngine  # noqa: PLC0415 - NumPyro takes seconds to import

        return NumpyroEngine(model, border)
    if name == "filter":
        from .compiled import FilterEngine  # noqa: PLC0415

        return FilterEngine(model, border)
    raise InputError(f"engine must be numpy, numpyro or filter, got {name!r}.")
