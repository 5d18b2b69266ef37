"""Batched moves of beliefs on grids with holes, that is, untrained classes, which belief must not enter.

The rule is that of `reference.shift`; here it is written for arrays.
"""

import numpy as np
from numpy.typing import NDArray

from ...models.grid import nearest_trained
from ..reference import Border

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]
type Mask = NDArray[np.bool_]


def holes(trained: Mask | None) -> Mask | None:
    """Mask of trained classes (L, M), or `None` if all are trained."""
    return None if trained is None or trained.all() else trained


def landing(trained: Mask, delta: int, border: Border) -> Integers:
    """New position of the belief in each class, shape (L, M); -1 if it is lost, and for untrained classes."""
    L = len(trained)
    target = np.arange(L) + delta
    place = target % L if border == "circular" else target.clip(0, L - 1)
    if border == "clamp":
        return np.where(trained, nearest_trained(trained)[place], -1)
    inside = np.full(L, True) if border == "circular" else place == target
    lands = np.where(trained & trained[place] & inside[:, np.newaxis], place[:, np.newaxis], -1)
    if border == "circular":
        for m, column in enumerate(lands.T):
            lost = np.flatnonzero(trained[:, m] & (column < 0))
            column[lost] = np.setdiff1d(np.flatnonzero(trained[:, m]), column)
    return lands


def moved(beliefs: Floats, delta: int, border: Border, trained: Mask, add: np.ufunc) -> Floats:
    """Beliefs (n, L, M) after one move, Eq. 9; with border `prior` they are not normalised.

    Args:
        beliefs: Probabilities or their logarithms, 0 or -inf in untrained classes.
        delta: Move in positions.
        border: As in `reference.shift`.
        trained: Mask of the trained classes, shape (L, M).
        add: `np.add` for probabilities, `np.logaddexp` for logarithms.
    """
    L, M = trained.shape
    logs = add is np.logaddexp
    lands = landing(trained, delta, border)
    after = np.full(beliefs.shape, -np.inf if logs else 0.0)
    vacated = trained.copy()
    for l in range(L):
        (kept,) = np.nonzero(lands[l] >= 0)
        target = lands[l, kept]
        after[:, target, kept] = add(after[:, target, kept], beliefs[:, l, kept])
        vacated[target, kept] = False
    places, objects = np.nonzero(vacated)
    if not len(places) or border in ("clamp", "circular"):
        return after
    if border == "prior":
        share = 1.0 / trained.sum()
        after[:, places, objects] = np.log(share) if logs else share
        return after
    lost = add.reduce(np.where(trained & (lands < 0), beliefs, -np.inf if logs else 0.0), axis=1)
    if border == "uniform":
        lost, room = np.broadcast_to(add.reduce(lost, axis=1, keepdims=True), lost.shape), np.full(M, len(places))
    else:
        room = np.maximum(vacated.sum(axis=0), 1)
    filling = lost - np.log(room) if logs else lost / room
    after[:, places, objects] = filling[:, objects]
    return after
