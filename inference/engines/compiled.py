"""Conversion of beliefs and likelihoods for the compiled kernel, and the kernel as an engine.

Arrays have one number per position and hypothesis, (L, S M), see `models.measurement.states`; without states these
are the L x M classes.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.compiled import compiled
from ...models.errors import InputError
from ...models.grid import nearest_trained
from ...models.measurement.model import TapModel
from ..reference import BORDERS, Border, ZeroEvidenceError
from ..trials import scaled
from ..trials.records import Classes, Likelihoods, ScaledBelief

_LINE = 64  # bytes of a cache line
_UNIT = float(scaled.UNIT * np.log(2.0))


def classes(trained: NDArray[np.bool_]) -> Classes:
    """Classes for the kernel from the mask of trained ones, shape (L, M)."""
    nearest = nearest_trained(trained).T
    return Classes(not trained.all(), np.ascontiguousarray(trained.T), np.ascontiguousarray(nearest, np.int64))


def likelihoods(log_likelihood: ArrayLike) -> Likelihoods:
    """Table for the kernel from log-likelihoods of shape (N, L, S M)."""
    z, k, least, wide = _scaled(np.asarray(log_likelihood, dtype=np.float64))
    if not wide.any():
        return Likelihoods(z, z, least, wide, k[:0])
    plain, least = _aligned(*z.shape), np.ones(len(z))
    _unscale(z.reshape(len(z), -1), k.reshape(len(z), -1), plain.reshape(len(z), -1), least)
    return Likelihoods(z, plain, least, wide, k)


def scaled_belief(log_belief: ArrayLike) -> ScaledBelief:
    """Belief for the kernel from a log belief of shape (L, S M)."""
    z, k, _, _ = _scaled(np.asarray(log_belief, dtype=np.float64)[np.newaxis])
    return ScaledBelief(z[0], k[0])


def border_number(border: Border) -> int:
    """Number of a border in the compiled loops."""
    return BORDERS.index(border)


def refuse_border(border: int, hypotheses: int, M: int) -> None:
    """Refuses the border `prior` for models with states, as it gives vacated positions 1/(L M) regardless of the state.

    Args:
        border: Number of the border.
        hypotheses: Number of hypotheses, S M.
        M: Number of objects.

    Raises:
        InputError: The border is `prior` and there are more hypotheses than objects.
    """
    if border == scaled.PRIOR and hypotheses > M:
        raise InputError("border 'prior' does not support models that carry a state; use 'uniform'.")


def _aligned(*shape: int) -> NDArray[np.float64]:
    """An array without values that starts on a cache line, so that no load of a vector register crosses two."""
    size = math.prod(shape)
    room = np.empty(size + _LINE // 8)
    first = -room.ctypes.data % _LINE // 8
    return room[first : first + size].reshape(shape)


def _scaled(
    log_values: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
    """Numbers z in (2^-256, 1] and k, both (N, S M, L), of values (N, L, S M) over the largest of each.

    Also the smallest z above 0, where no k is above 0, and whether one is, each of shape (N,).
    """
    N, L, hypotheses = log_values.shape
    z, k = _aligned(N, hypotheses, L), np.zeros((N, hypotheses, L), dtype=np.int64)
    least, wide = np.empty(N), np.zeros(N, dtype=np.bool_)
    _scale(log_values, z, k, least, wide)
    np.exp(z, out=z)
    return z, k, np.exp(least), wide


@compiled
def _scale(
    log_values: NDArray[np.float64],
    depth: NDArray[np.float64],
    k: NDArray[np.int64],
    least: NDArray[np.float64],
    wide: NDArray[np.bool_],
) -> None:
    """Logarithms of z, k, and the rest of `_scaled`."""
    N, L, hypotheses = log_values.shape
    for n in range(N):
        top = -np.inf
        for l in range(L):
            for m in range(hypotheses):
                top = max(top, log_values[n, l, m])
        least[n] = 0.0
        for l in range(L):
            for m in range(hypotheses):
                value = log_values[n, l, m]
                if value > -np.inf:
                    value -= top
                    if value < -_UNIT:
                        k[n, m, l] = math.floor(-value / _UNIT)
                        value += k[n, m, l] * _UNIT
                        wide[n] = True
                    least[n] = min(least[n], value)
                depth[n, m, l] = value


@dataclass(frozen=True)
class FilterEngine:
    """Kernel of the Monte Carlo trials as an engine.

    Attributes:
        model: The fitted measurement model.
        border: Interpretation of Eq. 9 at the ends of the range.

    Raises:
        InputError: The border is `prior` and the model carries a state.
    """

    model: TapModel
    border: Border = "uniform"
    name: str = "filter"

    def __post_init__(self) -> None:
        if self.border == "prior":
            refuse_border(scaled.PRIOR, self.model.log_prior.shape[1], self.model.grid.M)

    @cached_property
    def _classes(self) -> Classes:
        return classes(self.model.trained)

    def update(self, log_belief: NDArray[np.float64], tap: ArrayLike) -> tuple[NDArray[np.float64], float]:
        """Eq. 1 as a product of counts with log tables, then compiled Eq. 3 and 4.

        Raises:
            ZeroEvidenceError: The tap is impossible under every class.
        """
        log_likelihood = self.model.log_likelihood(np.asarray(tap)[np.newaxis])[0]
        belief, row = _Working(log_belief), scaled_belief(log_likelihood)
        belief.multiply(row.z)
        belief.k += row.k
        if not belief.settle():
            raise ZeroEvidenceError("The tap is impossible under every class with nonzero belief.")
        posterior = belief.log()
        # Bayes' rule solved for the evidence at the most probable class.
        best = np.unravel_index(posterior.argmax(), posterior.shape)
        return posterior, float(log_belief[best] + log_likelihood[best] - posterior[best])

    def shift(self, log_belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Eq. 9 compiled."""
        if delta == 0:
            return log_belief
        belief = _Working(log_belief)
        belief.shift(delta, border_number(self.border), self._classes)
        belief.settle()
        return belief.log()


class _Working:
    """A belief in the kernel's arrays."""

    def __init__(self, log_belief: NDArray[np.float64]) -> None:
        self.z, self.k = scaled_belief(log_belief)
        hypotheses, L = self.z.shape
        self.on = (self.k == 0).astype(np.float64)
        self.where, self.hypothesis = np.empty(L), np.empty(hypotheses)

    def multiply(self, row: NDArray[np.float64]) -> float:
        return scaled.multiply(self.z, self.on, row, self.where, self.hypothesis)

    def settle(self) -> bool:
        """Whether any class has nonzero belief."""
        return scaled.settle(self.z, self.k, self.on) > 0

    def shift(self, delta: int, border: int, classes: Classes) -> None:
        total = self.multiply(np.ones_like(self.z))
        belief, room = (self.z, self.k, self.on), (np.empty(len(self.where)), np.empty(len(self.where), np.int64))
        if classes.holes:
            scaled.shift_around(*belief, delta, border, classes.trained, classes.nearest, total, *room)
        else:
            scaled.shift(*belief, delta, border, len(classes.trained), total, *room)

    def log(self) -> NDArray[np.float64]:
        """Normalised log belief, shape (L, S M)."""
        total = self.multiply(np.ones_like(self.z))
        with np.errstate(divide="ignore"):
            return np.ascontiguousarray((np.log(self.z) - self.k * _UNIT - np.log(total)).T)


@compiled
def _unscale(
    z: NDArray[np.float64], k: NDArray[np.int64], plain: NDArray[np.float64], least: NDArray[np.float64]
) -> None:
    """Numbers z 2^(-UNIT k), 0 where k is above 1, and the smallest above 0 of each row, at most 1."""
    for n in range(len(z)):
        for c in range(z.shape[1]):
            value = 0.0 if k[n, c] > 1 else math.ldexp(z[n, c], -scaled.UNIT * k[n, c])
            plain[n, c] = value
            if 0.0 < value < least[n]:
                least[n] = value
