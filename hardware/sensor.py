"""Interface of a sensor for perception; simulated, replayed and real rigs implement it."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..models.errors import InputError
from ..models.grid import ClassGrid
from ..models.preprocessing import Preprocessing


class TouchSensor(Protocol):
    """A sensor that taps an object and moves along it in steps of one position.

    Moves are counted in positions, not millimetres, so that the shift of the belief (Eq. 9) and the motor command are
    the same integer. The rig converts it to millimetres.
    """

    @property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing of the taps; perception compares it with that of the model."""
        ...

    @property
    def room(self) -> tuple[int, int]:
        """Steps left to the lower and the upper end of the range, both >= 0."""
        ...

    def tap(self) -> NDArray[np.float64]:
        """Samples of one tap at the current position, shape (J, K)."""
        ...

    def move(self, delta: int) -> int:
        """Moves by `delta` positions, at most to the end of the range.

        Returns:
            Steps actually made, `delta` clipped to `[-room[0], room[1]]`. The belief is shifted by the commanded
            `delta`, as the actual one would reveal the position.
        """
        ...


def clipped_move(delta: int, room: tuple[int, int]) -> int:
    """Steps of a move that fit into the room left."""
    return max(-room[0], min(int(delta), room[1]))


def check_class(grid: ClassGrid, where: int, what: int) -> None:
    """Checks that a class lies on the grid.

    Raises:
        InputError: It does not.
    """
    if not (0 <= where < grid.L and 0 <= what < grid.M):
        raise InputError(f"Class ({where}, {what}) is outside the grid of {grid.L} x {grid.M} classes.")
