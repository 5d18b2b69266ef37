"""Eq. 9 for many beliefs and moves at once, in probabilities or their logarithms.

`reference.shift` says it for one; here it is written for arrays, see `holes` for grids with untrained classes.
"""

import numpy as np
from numpy.typing import NDArray

from ..reference import Border
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
    _, L, M = beliefs.shape
    deltas = deltas[..., np.newaxis]
    source, target = np.arange(L) - deltas, np.arange(L) + deltas
    rows = np.arange(len(beliefs))[:, np.newaxis, np.newaxis]
    if border == "circular":
        return beliefs[rows, source % L]
    kept = ((source >= 0) & (source < L))[..., np.newaxis]
    staying = beliefs[rows, source.clip(0, L - 1)]
    lost = _lost(beliefs, (target < 0) | (target >= L), logs)
    if border == "clamp":
        staying = np.where(kept, staying, -np.inf if logs else 0.0)
        end = np.where(deltas > 0, L - 1, 0)[..., np.newaxis]
        kept_there = np.take_along_axis(staying, end, axis=2)
        np.put_along_axis(staying, end, np.logaddexp(kept_there, lost) if logs else kept_there + lost, axis=2)
        return staying
    vacated = np.minimum(np.abs(deltas), L).clip(1)[..., np.newaxis]
    if border == "prior":
        return np.where(kept, staying, -np.log(L * M) if logs else 1 / (L * M))
    objects = 1
    if border == "uniform":
        every = log_sum(lost, (-1,)) if logs else lost.sum(axis=-1, keepdims=True)
        lost, objects = np.broadcast_to(every, lost.shape), M
    return np.where(kept, staying, lost - np.log(vacated * objects) if logs else lost / objects / vacated)


def _lost(beliefs: Floats, leaves: NDArray[np.bool_], logs: bool) -> Floats:
    """Belief in each object that leaves the range, shape (S, D, 1, M)."""
    if logs:
        return log_sum(np.where(leaves[..., np.newaxis], beliefs[:, np.newaxis], -np.inf), (2,))
    return (leaves.astype(np.float64) @ beliefs)[:, :, np.newaxis]


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
