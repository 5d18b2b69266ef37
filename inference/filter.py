"""The belief of one episode, tap by tap and move by move, for programs that have a loop of their own."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.measurement.model import TapModel
from ..models.measurement.states import log_fold
from . import reference
from .engines.engine import Engine, make_engine
from .reference import Border
from .saturation import share, temper

if TYPE_CHECKING:
    import xarray as xr


def engine_of(model: TapModel | Engine, border: Border = "uniform") -> Engine:
    """The compiled engine of a model; an engine is what it is.

    Raises:
        InputError: As `make_engine`.
    """
    return make_engine("filter", model, border) if isinstance(model, TapModel) else model


class Filter:
    """Where the finger is and what it touches, as far as the taps so far tell; Eq. 1 to 6 and 9.

    What is carried from tap to tap is the belief over all hypotheses of the model; what is read is that belief after
    `saturation`, summed over the states of the episode.

    Args:
        model: A fitted model, or an engine of `make_engine`.
        border: Reading of Eq. 9 at the ends of the range; an engine has its own.
        stop: Threshold theta_W of `decision`.

    Attributes:
        engine: What computes beliefs.
        stop: Threshold theta_W.
        taps: How many taps there were.

    Raises:
        InputError: There is no such border, or it does not go with the model.
    """

    def __init__(self, model: TapModel | Engine, *, border: Border = "uniform", stop: float = 0.95) -> None:
        self.engine = engine_of(model, border)
        self.stop = stop
        self.reset()

    def reset(self) -> None:
        """Forgets all taps: a new episode begins."""
        self._carried, self.taps = self.engine.model.log_prior, 0

    def update(self, tap: ArrayLike) -> float:
        """Takes one more tap in.

        Args:
            tap: Prepared samples, shape (J, K).

        Returns:
            Log evidence of the tap given those before, Eq. 4.

        Raises:
            InputError: The tap has not the size of the training taps, or a sample is NaN.
            ZeroEvidenceError: The tap is impossible under every class. The belief is as before.
        """
        self._carried, log_evidence = self.engine.update(self._carried, tap)
        self.taps += 1
        return log_evidence

    def move(self, delta: int) -> None:
        """Shifts the belief by a commanded move of so many where classes; Eq. 9."""
        self._carried = self.engine.shift(self._carried, delta)

    @property
    def log_hypotheses(self) -> NDArray[np.float64]:
        """Log belief in every hypothesis as it is read, shape (L, H)."""
        return temper(self._carried, share(self.taps, self.engine.model.saturation))

    @property
    def log_belief(self) -> NDArray[np.float64]:
        """Log belief in every class, shape (L, M)."""
        return log_fold(self.log_hypotheses, self.engine.model.grid.M)

    @property
    def log_states(self) -> NDArray[np.float64]:
        """Log belief in the states of the episode, shape (S,); one zero for a model without."""
        log_belief, M = self.log_hypotheses, self.engine.model.grid.M
        L, H = log_belief.shape
        return np.zeros(1) if H == M else np.logaddexp.reduce(log_belief.reshape(L, H // M, M), axis=(0, 2))

    @property
    def belief(self) -> "xr.DataArray":
        """Belief in every class, dims (where, what), which sums to one."""
        import xarray as xr  # noqa: PLC0415

        return xr.DataArray(np.exp(self.log_belief), self.engine.model.grid.coords(), ("where", "what"), name="belief")

    @property
    def decision(self) -> str | None:
        """The object in which the belief exceeds the threshold, Eq. 7; `None` where there is none yet."""
        what = reference.what_marginal(np.exp(self.log_belief))
        sure = what.max() > self.stop and self.stop < 1
        return self.engine.model.grid.what_name[int(what.argmax())] if sure else None

    def __repr__(self) -> str:
        grid, belief = self.engine.model.grid, np.exp(self.log_belief)
        l, m = np.unravel_index(belief.argmax(), belief.shape)
        taps = f"{self.taps} tap{'s' * (self.taps != 1)}"
        return f"<Filter after {taps}: {grid.what_name[m]} at {grid.where_label(int(l))}, belief {belief[l, m]:.3g}>"
