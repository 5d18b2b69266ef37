"""Where to move next, given the belief: functions behind one type, of one belief or of a batch of them.

Strategies see beliefs and, for those that draw, a random number for each; they remember nothing. What they answer is
commanded, and the end of the range may cut it short. "Small repositioning movements" around where the sensor is
believed to be are those of Martinez-Hernandez et al. (2017); `random_place` is the baseline that active strategies are
to be held against.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]

ALIKE = 1e-12
"""Values of moves that differ by less are equal but for rounding."""


class MovePolicy(Protocol):
    """A control strategy."""

    def __call__(self, beliefs: Floats, chance: Floats) -> Integers:
        """The moves for joint beliefs after a tap.

        Args:
            beliefs: Shape (..., L, M), each of sum one.
            chance: A random number in [0, 1) for each, shape (...).

        Returns:
            Where classes to move by, shape (...); 0 stays.
        """
        ...


def passive(beliefs: Floats, chance: Floats) -> Integers:  # noqa: ARG001 - every policy takes both
    """Never moves: theta_X = 1."""
    return np.zeros(np.shape(beliefs)[:-2], dtype=np.int64)


def fixation(fixation_index: int, theta_x: float = 0.0) -> MovePolicy:
    """Moves so that the believed position comes to the fixation point; Eq. 8 and 10.

    Args:
        fixation_index: The where class to be at, counted from 0.
        theta_x: Threshold on the where belief for a move: 0 always moves, 1 never does.

    Raises:
        InputError: When called with a belief that has no such class.
    """

    def move(beliefs: Floats, chance: Floats) -> Integers:  # noqa: ARG001
        where = where_beliefs(beliefs)
        check_fixation(fixation_index, where.shape[-1])
        sure = (where.max(axis=-1) > theta_x) & (theta_x < 1)
        return np.where(sure, fixation_index - where.argmax(axis=-1), 0).astype(np.int64)

    return move


def random_place() -> MovePolicy:
    """Moves so that the believed position comes to a place that is drawn anew each time, all as likely."""

    def move(beliefs: Floats, chance: Floats) -> Integers:
        where = where_beliefs(beliefs)
        return _drawn(chance, where.shape[-1]) - where.argmax(axis=-1)

    return move


def random_step(reach: int) -> MovePolicy:
    """Repositions by a step of 1 to `reach` classes to either side of the believed position, all as likely.

    A step to a place beyond the range goes to the other side, or to the end where that lies beyond too.

    Raises:
        InputError: The reach is below one class.
    """
    check_reach(reach)

    def move(beliefs: Floats, chance: Floats) -> Integers:
        where = where_beliefs(beliefs)
        last, here = where.shape[-1] - 1, where.argmax(axis=-1)
        number = _drawn(chance, 2 * reach)
        step = number - reach + (number >= reach)
        step = np.where((here + step < 0) | (here + step > last), -step, step)
        return np.clip(here + step, 0, last) - here

    return move


def bounded(policy: MovePolicy, reach: int) -> MovePolicy:
    """As another strategy, but no move is longer than `reach` classes.

    Raises:
        InputError: The reach is below one class.
    """
    check_reach(reach)
    return lambda beliefs, chance: np.clip(policy(beliefs, chance), -reach, reach)


def where_beliefs(beliefs: Floats) -> Floats:
    """The where marginals, shape (..., L), of beliefs (..., L, M); Eq. 5."""
    return np.asarray(beliefs, dtype=np.float64).sum(axis=-1)


def best_move(values: Floats, deltas: Integers) -> Integers:
    """The move of the largest value; of equal ones none at all, then the shortest, then the one to the lowest class.

    Args:
        values: What each move is worth, shape (..., D); differences below 1e-12 are rounding.
        deltas: The moves, in the order of the classes they lead to, shape (..., D).

    Returns:
        Shape (...).
    """
    best = values >= values.max(axis=-1, keepdims=True) - ALIKE
    choice = np.where(best, np.abs(deltas), np.iinfo(np.int64).max).argmin(axis=-1)
    return np.take_along_axis(deltas, choice[..., np.newaxis], axis=-1)[..., 0].astype(np.int64)


def _drawn(chance: Floats, count: int) -> Integers:
    """Whole numbers from 0 to `count` - 1."""
    return np.floor(np.asarray(chance) * count).astype(np.int64)


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


def check_reach(reach: int) -> int:
    """The longest move, if it is one.

    Raises:
        InputError: It is below one class.
    """
    if reach < 1:
        raise InputError(f"The reach of a move must be at least one class, got {reach}.")
    return reach
