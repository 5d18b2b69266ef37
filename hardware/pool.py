"""Recorded taps sorted by class, so that one uniform number selects a tap of a class."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.errors import InputError


class TapPool(NamedTuple):
    """Tap indices by class.

    The taps of class (l, m) are `order[first[l, m] : first[l, m] + count[l, m]]`, in the order of the file.

    Attributes:
        order: Tap indices, class by class, shape (taps inside the grid,).
        first: Index in `order` of the first tap of each class, shape (L, M).
        count: Number of taps of each class, shape (L, M).
        nearest: Nearest position with a tap of the object (the lower of two equally near), -1 if the object has no
            tap, shape (L, M).
    """

    order: NDArray[np.intp]
    first: NDArray[np.intp]
    count: NDArray[np.intp]  # pyright: ignore[reportIncompatibleMethodOverride]
    nearest: NDArray[np.intp]

    def pick(self, where: int, what: int, uniform: float) -> int:
        """Index of the tap of a class that a uniform number in [0, 1) selects; the class must have a tap."""
        return int(self.order[self.first[where, what] + int(uniform * self.count[where, what])])


def tap_pool(where: ArrayLike, what: ArrayLike, shape: tuple[int, int]) -> TapPool:
    """Pool of taps with these classes.

    Args:
        where: Position index of each tap, -1 for taps outside the grid, shape (N,).
        what: Object index of each tap, likewise.
        shape: (L, M).

    Raises:
        InputError: No tap lies inside the grid.
    """
    where, what = np.asarray(where, dtype=np.intp), np.asarray(what, dtype=np.intp)
    _, M = shape
    inside = np.flatnonzero((where >= 0) & (what >= 0))
    if not len(inside):
        raise InputError("No tap belongs to a class of the grid.")
    return pool_of(inside, where[inside] * M + what[inside], shape)


def pool_of(taps: NDArray[np.intp], cell: NDArray[np.intp], shape: tuple[int, int]) -> TapPool:
    """Pool of some taps, possibly with repetitions.

    Args:
        taps: Tap indices, shape (n,).
        cell: Class of each as l M + m, shape (n,).
        shape: (L, M).
    """
    L, M = shape
    count = np.bincount(cell, minlength=L * M).reshape(L, M)
    first = np.cumsum(count).reshape(L, M) - count
    distance = np.abs(np.arange(L)[:, np.newaxis] - np.arange(L)).astype(np.float64)
    nearest = np.where(count.T > 0, distance[:, np.newaxis, :], np.inf).argmin(axis=-1)
    nearest[:, count.sum(axis=0) == 0] = -1
    return TapPool(taps[np.argsort(cell, kind="stable")], first, count, nearest)
