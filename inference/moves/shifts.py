"""Eq. 9 for many beliefs and moves at once, in probabilities or their logarithms.

`reference.shift` says it for one; here it is written for arrays, see `holes` for grids with untrained classes.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ...models.compiled import compiled
from ..reference import BORDERS, Border
from ..trials.scaled import CIRCULAR, CLAMP, PRIOR, UNIFORM
from .holes import Mask, holes, moved

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]


def shift_all(
    beliefs: Floats, deltas: Integers, border: Border, trained: Mask | None = None, *, logs: bool = False
) -> Floats:
    """Beliefs after each of several moves, shape (S, D, L, M); those of border `prior` have to be normalised.

    Args:
        beliefs: Probabilities, shape (S, L, M).
        deltas: Where classes moved, shape (S, D).
        border: As in `reference.shift`.
        trained: Which classes belief may be in, shape (L, M); default all.
        logs: Whether beliefs are logarithms of probabilities.
    """
    trained = holes(trained)
    if trained is not None:
        return _around(beliefs, deltas, border, trained, logs)
    after = np.empty((*deltas.shape, *beliefs.shape[1:]))
    before, moved = (np.require(array, requirements=["C", "W"]) for array in (beliefs, deltas))  # as compiled
    _shift(before, moved, BORDERS.index(border), logs, after)
    return after


@compiled
def _shift(beliefs, deltas, border, logs, after):
    _, L, M = beliefs.shape
    lost = np.empty((M, 2))[:, 0]  # of the layout of a column, so that `_total` is compiled once
    nothing = -np.inf if logs else 0.0
    for s in range(len(beliefs)):
        for d in range(deltas.shape[1]):
            delta = deltas[s, d]
            out = min(abs(delta), L)
            first, objects = L - out if delta > 0 else 0, 1.0
            for m in range(M):
                lost[m] = _total(beliefs[s, first : first + out, m], logs)
            if border == UNIFORM:
                lost[:], objects = _total(lost, logs), M
            for l in range(L):
                source = (l - delta) % L if border == CIRCULAR else l - delta
                kept = 0 <= source < L
                for m in range(M):
                    if kept:
                        new = beliefs[s, source, m]
                    elif border == CLAMP:
                        new = nothing
                    elif border == PRIOR:
                        new = -np.log(L * M) if logs else 1 / (L * M)
                    else:
                        new = lost[m] - np.log(out * objects) if logs else lost[m] / objects / out
                    after[s, d, l, m] = new
            if border == CLAMP and out > 0:
                end = L - 1 if delta > 0 else 0
                for m in range(M):
                    after[s, d, end, m] = _sum(after[s, d, end, m], lost[m], logs)


@compiled
def _total(values, logs):
    """Sum of probabilities, or the logarithm of it; `log_sum` of a loop."""
    if not logs:
        return values.sum()
    top = -np.inf
    for value in values:
        top = max(top, value)
    if top == -np.inf:
        return top
    total = 0.0
    for value in values:
        total += math.exp(value - top)
    return math.log(total) + top


@compiled
def _sum(a, b, logs):
    if not logs:
        return a + b
    top = max(a, b)
    return top if top == -np.inf else top + math.log1p(math.exp(min(a, b) - top))


def _around(beliefs: Floats, deltas: Integers, border: Border, trained: Mask, logs: bool) -> Floats:
    """As `shift_all`, on a grid with holes."""
    after = np.empty((*deltas.shape, *trained.shape))
    for delta in np.unique(deltas):
        row, move = np.nonzero(deltas == delta)
        after[row, move] = moved(beliefs[row], int(delta), border, trained, np.logaddexp if logs else np.add)
    return after


def log_sum(log_values: Floats, axes: tuple[int, ...]) -> Floats:
    """Log of the sum over some axes, which are kept; -inf of nothing."""
    top = log_values.max(axis=axes, keepdims=True)
    top = np.where(np.isneginf(top), 0.0, top)
    with np.errstate(divide="ignore"):
        return np.log(np.exp(log_values - top).sum(axis=axes, keepdims=True)) + top
