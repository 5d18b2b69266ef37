"""Control strategies as functions from beliefs to moves, for one belief or a batch.

Strategies take beliefs and, if random, a uniform number for each; they have no memory. They return commanded moves,
which the end of the range may cut short. "Small repositioning movements" around the estimated position are those of
Martinez-Hernandez et al. (2017); `random_place` is the baseline for active strategies.
"""

from dataclasses import dataclass
from numbers import Real
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError, check_probability

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]

ALIKE = 1e-12
"""Tolerance within which values of moves count as equal."""


class MovePolicy(Protocol):
    """A control strategy."""

    def __call__(self, beliefs: Floats, chance: Floats) -> Integers:
        """Moves for joint beliefs after a tap.

        Args:
            beliefs: Normalised beliefs, shape (..., L, M).
            chance: A uniform random number in [0, 1) for each, shape (...).

        Returns:
            Moves in positions, shape (...); 0 to stay.
        """
        ...


def passive() -> MovePolicy:
    """Strategy that never moves: theta_X = 1.

    >>> int(passive()(np.full((16, 5), 1 / 80), 0.0))
    0
    """
    return lambda beliefs, chance: np.zeros(np.shape(beliefs)[:-2], dtype=np.int64)  # noqa: ARG005


def fixation(fixation_index: int, theta_x: float = 0.0) -> MovePolicy:
    """Strategy that moves the estimated position to the fixation point; Eq. 8 and 10.

    >>> belief = np.zeros((16, 5))
    >>> belief[2, 1] = 1.0  # in position 2
    >>> int(fixation(7)(belief, 0.0))
    5

    Args:
        fixation_index: Index of the fixation point.
        theta_x: Belief in a position needed for a move: 0 always moves, 1 never moves.

    Raises:
        InputError: The index is no integer of at least 0, or theta_x no number from 0 to 1; or on a call, if the
            belief has no such position.
    """
    if not _whole(fixation_index) or fixation_index < 0:
        raise InputError(f"The fixation point must be an index from 0, got {fixation_index!r}.")
    check_probability(theta_x, "theta_x")
    return FixationPolicy(int(fixation_index), theta_x)


@dataclass(frozen=True)
class FixationPolicy:
    """Strategy of `fixation`.

    Attributes:
        fixation_index: Index of the fixation point.
        theta_x: Belief in a position needed for a move.
    """

    fixation_index: int
    theta_x: float

    def __call__(self, beliefs: Floats, chance: Floats) -> Integers:  # noqa: ARG002
        """As `MovePolicy`."""
        where = where_beliefs(beliefs)
        check_fixation(self.fixation_index, where.shape[-1])
        sure = (where.max(axis=-1) > self.theta_x) & (self.theta_x < 1)
        return np.where(sure, self.fixation_index - where.argmax(axis=-1), 0).astype(np.int64)


def random_place() -> MovePolicy:
    """Strategy that moves the estimated position to a uniformly random one each time.

    >>> belief = np.zeros((16, 5))
    >>> belief[2, 1] = 1.0  # in position 2
    >>> random_place()(np.array([belief] * 3), np.array([0.0, 0.5, 0.99])).tolist()
    [-2, 6, 13]
    """

    def move(beliefs: Floats, chance: Floats) -> Integers:
        where = where_beliefs(beliefs)
        return _drawn(chance, where.shape[-1]) - where.argmax(axis=-1)

    return move


def random_step(reach: int) -> MovePolicy:
    """Strategy that makes a uniformly random step of 1 to `reach` positions to either side.

    A step beyond the range goes to the other side, or to the end if that is also beyond.

    >>> belief = np.zeros((16, 5))
    >>> belief[2, 1] = 1.0  # in position 2
    >>> random_step(2)(np.array([belief] * 4), np.array([0.0, 0.25, 0.5, 0.75])).tolist()
    [-2, -1, 1, 2]

    Raises:
        InputError: The reach is below 1.
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
    """Another strategy with moves limited to `reach` positions.

    Raises:
        InputError: The reach is below 1.
    """
    check_reach(reach)
    return lambda beliefs, chance: np.clip(policy(beliefs, chance), -reach, reach)


def where_beliefs(beliefs: Floats) -> Floats:
    """Position marginals, shape (..., L), of beliefs (..., L, M); Eq. 5."""
    return np.asarray(beliefs, dtype=np.float64).sum(axis=-1)


def best_move(values: Floats, deltas: Integers) -> Integers:
    """Move of the largest value; among equal ones 0, then the shortest, then the one to the lowest position.

    Args:
        values: Value of each move, shape (..., D); differences below 1e-12 are ignored.
        deltas: Moves in positions, in the order of their targets, shape (..., D).

    Returns:
        Moves, shape (...).
    """
    best = values >= values.max(axis=-1, keepdims=True) - ALIKE
    choice = np.where(best, np.abs(deltas), np.iinfo(np.int64).max).argmin(axis=-1)
    return np.take_along_axis(deltas, choice[..., np.newaxis], axis=-1)[..., 0].astype(np.int64)


def _drawn(chance: Floats, count: int) -> Integers:
    """Random integers from 0 to `count` - 1."""
    return np.floor(np.asarray(chance) * count).astype(np.int64)


def default_fixation(L: int) -> int:
    """Index of the middle position, the lower of two: 7 of the paper's 16, its "position class at 8 mm"."""
    return (L - 1) // 2


def check_fixation(fixation_index: int | None, L: int) -> int:
    """Fixation index, by default the middle.

    Raises:
        InputError: It lies outside the grid, or is no whole number.
    """
    if fixation_index is None:
        return default_fixation(L)
    if not (_whole(fixation_index) and 0 <= fixation_index < L):
        raise InputError(f"The fixation point must be an index from 0 to {L - 1}, got {fixation_index!r}.")
    return fixation_index


def check_reach(reach: int) -> int:
    """Checks the longest move and returns it.

    Raises:
        InputError: It is below 1, or no whole number.
    """
    if not (_whole(reach) and reach >= 1):
        raise InputError(f"The reach of a move must be at least 1 position, got {reach!r}.")
    return reach


def _whole(number: object) -> bool:
    return isinstance(number, Real) and float(number).is_integer()
