"""Belief of one episode, tap by tap and move by move, for custom loops.

Taps of one episode share unknowns such as the gain of the sensor that day, so n taps carry less evidence than n
independent ones. Bayes' rule over taps and moves treats them as independent; decisions and displays after n taps use
that belief to the power min(1, n0 / n), normalised. In logs this is the mean evidence of the taps so far, counted n0
times. The order of the classes stays, so the power delays decisions; answers change only through moves and through the
sums of marginals. `kernel.temper` and `trials.gpu.temper` are the same, compiled.

Models with states carry a belief over hypotheses, shape (L, H) with H = S M, see `models.measurement.states`; decisions
use its sum over the states.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..hardware.sensor import check_move
from ..models.errors import InputError, check_numbers
from ..models.io.model_file import ModelSource, model_of
from . import reference
from .engines.engine import Engine, make_engine
from .reference import Border
from .stopping.stopping import check_threshold

if TYPE_CHECKING:
    import xarray as xr


def share(taps: int, saturation: float) -> float:
    """The power of a belief after some taps, 1 up to `saturation` of them."""
    return 1.0 if taps <= saturation else saturation / taps


def temper(log_belief: NDArray[np.float64], power: float) -> NDArray[np.float64]:
    """Beliefs to a power, normalised over the classes or hypotheses; at power 1 the very same array.

    Args:
        log_belief: Shape (..., L, H), with something above log 0 in each.
        power: Above 0.
    """
    if power == 1:
        return log_belief
    raised = power * log_belief
    top = raised.max(axis=(-2, -1), keepdims=True)
    return raised - (top + np.log(np.exp(raised - top).sum(axis=(-2, -1), keepdims=True)))


def fold(belief: NDArray[np.float64], M: int) -> NDArray[np.float64]:
    """The belief in where and what, shape (..., L, M), from one over hypotheses, shape (..., L, S M)."""
    H = belief.shape[-1]
    return belief if H == M else belief.reshape(*belief.shape[:-1], H // M, M).sum(axis=-2)


def log_fold(log_belief: NDArray[np.float64], M: int) -> NDArray[np.float64]:
    """`fold` in logs."""
    H = log_belief.shape[-1]
    if H == M:
        return log_belief
    return np.logaddexp.reduce(log_belief.reshape(*log_belief.shape[:-1], H // M, M), axis=-2)


def engine_of(model: ModelSource | Engine, border: Border | None = None) -> Engine:
    """Compiled engine of a model, by default with border `uniform`; an engine is returned unchanged.

    Raises:
        InputError: As `make_engine`; or a border is given with an engine.
    """
    if not isinstance(model, Engine):
        return make_engine("filter", model_of(model), border or "uniform")
    if border is not None:
        raise InputError("border cannot be set for an existing engine; pass it to make_engine.")
    return model


class Filter:
    """Belief about position and object from the taps so far; Eq. 1 to 6 and 9.

    What is carried from tap to tap is the belief over all hypotheses of the model; what is read is that belief after
    `saturation`, summed over the states of the episode.

    >>> import solidtouch as st
    >>> train, test = st.simulate("paper", sessions=2, seed=4)
    >>> belief = st.Filter(st.fit(train), stop=0.5)
    >>> for tap in test.taps[160:170]:
    ...     _ = belief.update(tap)
    >>> belief.taps, belief.decision, belief.belief.dims
    (10, 0, ('where', 'what'))
    >>> belief.move(+1)

    Args:
        model: A fitted model or its file, or an engine of `make_engine`.
        border: Reading of Eq. 9 at the ends of the range, by default `uniform`; an engine has its own.
        stop: Threshold theta_W of `decision`.

    Attributes:
        engine: What computes beliefs.
        stop: Threshold theta_W.
        taps: How many taps there were.

    Raises:
        InputError: The border is unknown, not supported by the model, or set for an engine; the threshold is no number
            from 0 to 1; or as `load_model`.
    """

    def __init__(self, model: ModelSource | Engine, *, border: Border | None = None, stop: float = 0.95) -> None:
        check_threshold(stop)
        self.engine, self.stop = engine_of(model, border), stop
        self._M = self.engine.model.grid.M
        self.reset()

    def reset(self) -> None:
        """Discards all taps and starts a new episode."""
        self._carried, self._what, self.taps = self.engine.model.log_prior, None, 0

    def update(self, tap: ArrayLike) -> float:
        """Updates the belief with a tap.

        Args:
            tap: Prepared samples, shape (J, K).

        Returns:
            Log evidence of the tap given those before, Eq. 4.

        Raises:
            InputError: The tap does not have the size of the training taps, or a sample is NaN or infinite.
            ZeroEvidenceError: The tap is impossible under every class. The belief is as before.
        """
        tap, shape = check_numbers(tap, "A tap"), self.engine.model.tap_shape
        if tap.shape != shape:
            raise InputError(f"A tap must have shape {shape}, got {tap.shape}.")
        self._carried, log_evidence = self.engine.update(self._carried, tap)
        self.taps += 1
        self._what = reference.what_marginal(np.exp(self.log_belief))
        return log_evidence

    def move(self, delta: int) -> None:
        """Shifts the belief by a commanded move in positions; Eq. 9.

        The end of the range does not cut it short; what lies beyond is left to the border.

        Raises:
            InputError: It is no whole number.
        """
        self._carried = self.engine.shift(self._carried, check_move(delta))

    @property
    def log_hypotheses(self) -> NDArray[np.float64]:
        """Log belief in every hypothesis after the saturation, shape (L, H)."""
        return np.array(temper(self._carried, share(self.taps, self.engine.model.saturation)))

    @property
    def log_belief(self) -> NDArray[np.float64]:
        """Log belief in every class, shape (L, M)."""
        return log_fold(self.log_hypotheses, self._M)

    @property
    def log_states(self) -> NDArray[np.float64]:
        """Log belief in the states of the episode, shape (S,); one zero for a model without states."""
        hypotheses, M = self.log_hypotheses, self._M
        L, H = hypotheses.shape
        return np.zeros(1) if H == M else np.logaddexp.reduce(hypotheses.reshape(L, H // M, M), axis=(0, 2))

    @property
    def belief(self) -> "xr.DataArray":
        """Belief in every class, dims (where, what), normalised."""
        import xarray as xr  # noqa: PLC0415

        return xr.DataArray(np.exp(self.log_belief), self.engine.model.grid.coords(), ("where", "what"), name="belief")

    @property
    def decision(self) -> int | None:
        """Index of the object whose belief exceeded the threshold at the last tap, Eq. 7; `None` if there is none.

        The index 0 is a decision, so compare with `None`; `grid.what_name` of the model has the names. Moves do not
        change the decision: the stop test comes before the move.
        """
        if self._what is None or not self._what.max() > self.stop or self.stop >= 1:
            return None
        return int(self._what.argmax())

    def __repr__(self) -> str:
        grid, belief = self.engine.model.grid, np.exp(self.log_belief)
        l, m = np.unravel_index(belief.argmax(), belief.shape)
        taps = f"{self.taps} tap{'s' * (self.taps != 1)}"
        return f"<Filter after {taps}: {grid.what_name[m]} at {grid.where_label(int(l))}, belief {belief[l, m]:.3g}>"
