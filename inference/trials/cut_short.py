"""Trials that ran out of fresh taps: bounds on their outcome with further taps.

A trial that has had all stored taps of a class is decided as at the deadline. On taps that nobody recorded it would
have gone on, and how it would have ended cannot be known: at best right, after hardly another tap; at worst for what is
farthest from the truth, sure of it, at the deadline. Intervals reach from the one to the other.
"""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...models.grid import ClassGrid
from .records import TrialPlan, Trials

ENDINGS = ("_at_best", "_at_worst")
"""Suffixes of what trials come to with those that were cut short so, in datasets."""


class Farthest(NamedTuple):
    """Decision with the largest error for each true class.

    Attributes:
        where: Shape (L,).
        what: Shape (M,); another object, if there is one.
    """

    where: NDArray[np.intp]
    what: NDArray[np.intp]

    @classmethod
    def among(cls, L: int, M: int) -> Self:
        """Result if all errors are equal: the next class."""
        return cls(*((np.arange(n) + 1) % n for n in (L, M)))

    @classmethod
    def on(cls, grid: ClassGrid) -> Self:
        """Result on a grid."""
        where, what = (
            error(*np.indices((n, n))).argmax(axis=0)
            for error, n in ((grid.where_error, grid.L), (grid.what_error, grid.M))
        )
        alike = what == np.arange(grid.M)  # objects of one size
        return cls(where, np.where(alike, cls.among(*grid.shape).what, what))


def endings(trials: Trials, plan: TrialPlan, deadline: int, farthest: Farthest) -> tuple[Trials, Trials]:
    """Trials with the truncated ones at their best, and at their worst.

    Args:
        trials: On fresh taps.
        plan: What they are.
        deadline: Taps after which a trial ends at the latest.
        farthest: What their worst decisions are.
    """
    cut = trials.used_up
    what, where = plan.what[:, np.newaxis], trials.true_where
    decided = trials._replace(stopped=trials.stopped | cut)
    best = decided._replace(what=np.where(cut, what, trials.what), where=np.where(cut, where, trials.where))
    worst = decided._replace(
        what=np.where(cut, farthest.what[what], trials.what),
        where=np.where(cut, farthest.where[where], trials.where),
        taps=np.where(cut, deadline, trials.taps),
        belief=np.where(cut, 1.0, trials.belief),
    )
    return best, worst
