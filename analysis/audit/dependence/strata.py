"""Groups of taps that can be exchanged."""

import numpy as np
from numpy.typing import NDArray

from ....models.grid import ClassGrid
from ....models.taps import TapSet


def strata(taps: TapSet, grid: ClassGrid) -> tuple[NDArray[np.intp], bool]:
    """Groups within which taps can be exchanged, shape (N,), and whether those are of one session each.

    Taps of one class and session; where most of these are single, taps of one class.
    """
    where, what = taps.indices(grid)
    own = where * grid.M + what
    key = own * (int(taps.session.max()) + 1) + taps.session
    _, count = np.unique(key, return_counts=True)
    by_session = bool(np.median(count) > 1)
    return (key if by_session else own), by_session


def evenly(key: NDArray[np.intp], most: int) -> NDArray[np.bool_]:
    """At most so many members of each group, spread evenly over it; a mask, shape (N,)."""
    chosen = np.zeros(len(key), dtype=bool)
    for value in np.unique(key):
        members = np.flatnonzero(key == value)
        if len(members) > most:
            members = members[np.linspace(0, len(members) - 1, most).round().astype(np.intp)]
        chosen[members] = True
    return chosen
