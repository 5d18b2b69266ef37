"""What all forms of the likelihood of a tap's bins have in common.

The axis H holds hypotheses, the objects or objects in states, see `states`.
"""

from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray


class Form(Protocol):
    """Likelihood of a tap's bins under every hypothesis; a `TableForm`, a `GaussianForm`, or a further one."""

    @property
    def exchangeable(self) -> bool:
        """Whether a tap may have any number of samples."""
        ...

    @property
    def independent(self) -> bool:
        """Whether samples are independent under a hypothesis, so that those that are NaN are left out."""
        ...

    @property
    def shape(self) -> tuple[int, int]:
        """(L, H)."""
        ...

    def in_state(self, gain: float, offset: float, edges: NDArray[np.float64], /) -> Self:
        """Form of `gain` times a tap plus `offset`."""
        ...

    @staticmethod
    def joined(parts: Any, /) -> Any:
        """Form over the hypotheses of several forms of this kind, one after another."""
        ...

    def prepare(self, impossible: NDArray[np.bool_], /) -> "Prepared":
        """Precomputed form; hypotheses in the mask `impossible`, shape (L, H), have likelihood 0."""
        ...

    def own(
        self,
        taps: NDArray[np.floating],
        edges: NDArray[np.float64],
        where: NDArray[np.intp],
        what: NDArray[np.intp],
        /,
    ) -> NDArray[np.float64]:
        """Log probability of the bins of taps (N, J, K) under their own hypotheses, shape (N,)."""
        ...

    def sample(
        self,
        where: NDArray[np.intp],
        what: NDArray[np.intp],
        edges: NDArray[np.float64],
        J: int,
        generator: np.random.Generator,
        /,
    ) -> NDArray[np.float64]:
        """Taps under hypotheses (N,), shape (N, J, K)."""
        ...


class Prepared(Protocol):
    """A form with what its likelihoods have in common."""

    def log_likelihood(
        self, taps: NDArray[np.floating], edges: NDArray[np.float64], exponent: float, out: NDArray[np.float64], /
    ) -> None:
        """Writes `exponent` times the log probability of the bins of taps (N, J, K) to `out`, shape (N, L, H)."""
        ...
