"""Moves as Markov kernels on grids with holes, that is, untrained classes, which no move may enter.

On a full grid the transition of the position does not depend on the object, see `touch.move_kernel`; here it does.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class HoleKernel(NamedTuple):
    """Eq. 9 as a transition p(where', what' | where, what) for one commanded move on a grid with holes.

    Attributes:
        where: p(where' | where, what) of classes that keep their object, shape (L, M, L); rows sum to one. Untrained
            classes, which hold no belief, move to the trained ones of their object.
        redrawn: Mask of classes whose belief moves to the vacated classes of all objects instead, shape (L, M).
        vacated: p(where', what') of these, shape (L, M); all zero if there are none.
    """

    where: NDArray[np.float64]
    redrawn: NDArray[np.bool_]
    vacated: NDArray[np.float64]

    def what_kernel(self) -> NDArray[np.float64]:
        """p(what' | where, what), shape (L, M, M)."""
        return np.where(self.redrawn[..., np.newaxis], self.vacated.sum(axis=0), np.eye(len(self.vacated[0])))

    def where_kernel(self) -> NDArray[np.float64]:
        """p(where' | where, what, what'), shape (L, M, M, L); for impossible what', that of the same object."""
        room = self.vacated.sum(axis=0)
        kernel = np.repeat(self.where[:, :, np.newaxis], len(room), axis=2)
        for m in np.flatnonzero(room):
            kernel[self.redrawn, m] = self.vacated[:, m] / room[m]
        return kernel


def hole_kernel(trained: NDArray[np.bool_], delta: int, border: str) -> HoleKernel:
    """Kernel of a move by `delta` positions.

    Args:
        trained: Mask of the trained classes, shape (L, M).
        delta: Move in positions.
        border: Border that is a kernel, as in `inference.reference.shift`.
    """
    L, M = trained.shape
    where = np.repeat(np.where(trained.any(axis=0), trained, True).T[np.newaxis].astype(np.float64), L, axis=0)
    where /= where.sum(axis=2, keepdims=True)
    redrawn, vacated = np.zeros((L, M), dtype=bool), np.zeros((L, M))
    for m in range(M):
        known = np.flatnonzero(trained[:, m])
        target = known + delta
        if border == "circular":
            target %= L
        if border == "clamp" and len(known):
            distance = np.abs(known - np.clip(target, 0, L - 1)[:, np.newaxis])
            target = known[distance.argmin(axis=1)]
        lands = np.isin(target, known)
        free = np.setdiff1d(known, target)
        where[known[lands], m] = np.eye(L)[target[lands]]
        lost = known[~lands]
        if border == "circular":
            where[lost, m] = np.eye(L)[free]
        elif border == "uniform_what" and len(lost):
            where[lost, m] = np.isin(np.arange(L), free) / len(free)
        elif border == "uniform":
            redrawn[lost, m] = True
            vacated[free, m] = 1.0
    return HoleKernel(where, redrawn, vacated / max(vacated.sum(), 1.0))
