"""Two engines in parallel, each with its own belief, which must agree after every tap."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..reference import ZeroEvidenceError

if TYPE_CHECKING:
    from ...models.measurement.model import TapModel
    from .engine import Engine

TOLERANCE = 1e-9


class EnginesDisagree(Exception):
    """Two engines gave different posteriors; the message names tap, class and both values."""


class ShadowEngine:
    """An engine that returns the results of a first engine and compares them with a second one.

    The second continues from its own beliefs, so that small differences accumulate as they would without the first.

    Args:
        first: Engine whose results are returned.
        second: Engine to compare, of the same model.
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
        """Model of the first engine."""
        return self._first.model

    def update(self, log_belief: NDArray[np.float64], tap: ArrayLike) -> tuple[NDArray[np.float64], float]:
        """Eq. 3 and 4 twice.

        Raises:
            EnginesDisagree: A posterior differs by more than 1e-9, or the tap is impossible for one engine only.
            ZeroEvidenceError: The tap is impossible for both.
        """
        followed = self._follow(log_belief)
        self._taps += 1
        first = self._posterior(self._first, log_belief, tap)
        second = self._posterior(self._second, followed, tap)
        if first is None and second is None:
            raise ZeroEvidenceError("The tap is impossible under every class with nonzero belief.")
        if first is None or second is None:
            holds, other = (self._first, self._second) if first is None else (self._second, self._first)
            raise EnginesDisagree(f"Tap {self._taps} is impossible for engine {holds.name}, but not for {other.name}.")
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
        """Update of one engine, `None` after a tap that is impossible under every class."""
        try:
            return engine.update(log_belief, tap)
        except ZeroEvidenceError:
            return None

    def _follow(self, log_belief: NDArray[np.float64]) -> NDArray[np.float64]:
        """Belief of the second engine for one of the first; an unknown belief starts a new episode."""
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
