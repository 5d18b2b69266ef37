"""Where to move next, given the belief: functions behind one type."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..models.errors import InputError
from . import reference


class MovePolicy(Protocol):
    """A control strategy."""

    def __call__(self, belief: NDArray[np.float64]) -> int:
        """The move in where classes for a joint belief of shape (L, M); 0 stays."""
        ...


def passive(belief: NDArray[np.float64]) -> int:  # noqa: ARG001 - every policy takes the belief
    """Never moves: theta_X = 1."""
    return 0


def fixation(fixation_index: int, theta_x: float = 0.0) -> MovePolicy:
    """Moves so that the believed position comes to the fixation point; Eq. 8 and 10.

    Args:
        fixation_index: The where class to be at, counted from 0.
        theta_x: Threshold on the where belief for a move: 0 always moves, 1 never does.

    Raises:
        InputError: When called with a belief that has no such class.
    """

    def move(belief: NDArray[np.float64]) -> int:
        check_fixation(fixation_index, len(belief))
        where = reference.where_decision(belief, theta_x)
        return 0 if where is None else reference.fixation_move(where, fixation_index)

    return move


def default_fixation(L: int) -> int:
    """The middle class of the range, the lower one of two: 7 of the paper's 16, its "position class at 8 mm"."""
    return (L - 1) // 2


def check_fixation(fixation_index: int | None, L: int) -> int:
    """The fixation index, the default where it is `None`.

    Raises:
        InputError: It lies outside the grid.
    """
    if fixation_index is None:
        return default_fixation(L)
    if not 0 <= fixation_index < L:
        raise InputError(f"The fixation point must be a class index from 0 to {L - 1}, got {fixation_index}.")
    return fixation_index
