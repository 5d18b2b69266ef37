"""Two engines at once, each carrying its own belief, that must agree after every tap."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..reference import ZeroEvidenceError

if TYPE_CHECKING:
    from ...models.measurement.model import TapModel
    from .engine import Engine

TOLERANCE = 1e-9


class EnginesDisagree(Exception):
    """Two engines came to different posteriors; the message says after which tap, for which class, and both values."""


class ShadowEngine:
    """An engine that answers what the first one says, while the second follows and is compared.

    The second goes on from its own beliefs, so that small differences add up as they would without the first.

    Args:
        first: Whose beliefs count.
        second: Of the same model.
    """

    def __init__(self, first: "Engine", second: "Engine") -> None:
        self._first = first
        self._second = second
        self._answered: NDArray[np.float64] | None = None
        self._followed: NDArray[np.float64] | None = None
        self._taps = 0

    @property
    def name(self) -> str:
        """Both names."""
        return f"{self._first.name} shadowed by {self._second.name}"

    @property
    def model(self) -> "TapModel":
        """That of the first."""
        return self._first.model

    def update(self, log_belief: NDArray[np.float64], tap: ArrayLike) -> tuple[NDArray[np.float64], float]:
        """Eq. 3 and 4 twice.

        Raises:
            EnginesDisagree: A posterior differs by more than 1e-9, or one engine holds the tap for impossible.
            ZeroEvidenceError: Both do.
        """
        followed = self._follow(log_belief)
        self._taps += 1
        first = self._posterior(self._first, log_belief, tap)
        second = self._posterior(self._second, followed, tap)
        if first is None and second is None:
            raise ZeroEvidenceError("The tap is impossible under every class that is still believed in.")
        if first is None or second is None:
            holds, other = (self._first, self._second) if first is None else (self._second, self._first)
            raise EnginesDisagree(f"Engine {holds.name} holds tap {self._taps} for impossible, {other.name} does not.")
        return self._agreed(first[0], second[0], "after"), first[1]

    def shift(self, log_belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Eq. 9 twice.

        Raises:
            EnginesDisagree: A belief differs by more than 1e-9.
        """
        other = self._second.shift(self._follow(log_belief), delta)
        return self._agreed(self._first.shift(log_belief, delta), other, "after the move that follows")

    @staticmethod
    def _posterior(
        engine: "Engine", log_belief: NDArray[np.float64], tap: ArrayLike
    ) -> tuple[NDArray[np.float64], float] | None:
        """The update of one engine, `None` after a tap that is impossible under every class."""
        try:
            return engine.update(log_belief, tap)
        except ZeroEvidenceError:
            return None

    def _follow(self, log_belief: NDArray[np.float64]) -> NDArray[np.float64]:
        """The second engine's version of a belief; a belief that did not come from here starts an episode."""
        if log_belief is self._answered and self._followed is not None:
            return self._followed
        self._taps = 0
        return log_belief

    def _agreed(self, answer: NDArray[np.float64], other: NDArray[np.float64], when: str) -> NDArray[np.float64]:
        first, second = np.exp(answer), np.exp(other)
        difference = np.abs(first - second)
        if not (difference <= TOLERANCE).all():
            l, h = np.unravel_index(np.argmax(np.nan_to_num(difference, nan=np.inf)), difference.shape)
            grid = self.model.grid
            raise EnginesDisagree(
                f"The engines disagree {when} tap {self._taps}: belief in {grid.what_name[h % grid.M]} at "
                f"{grid.where_label(int(l))} is {float(first[l, h])!r} by {self._first.name} and "
                f"{float(second[l, h])!r} by {self._second.name}."
            )
        self._answered, self._followed = answer, other
        return answer
