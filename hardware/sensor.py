"""What perception needs to know of a rig; simulated, replayed and real ones all satisfy it."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..models.errors import InputError
from ..models.grid import ClassGrid
from ..models.preprocessing import Preprocessing


class TouchSensor(Protocol):
    """A sensor that taps an object and can be moved along it in class steps.

    Moves are counted in where classes, not millimetres: the shift of the belief (Eq. 9) and the motor command are
    then the same whole number. A rig turns it into millimetres with its own spacing.
    """

    @property
    def preprocessing(self) -> Preprocessing:
        """How the taps are prepared; perception compares it with the model's record."""
        ...

    @property
    def room(self) -> tuple[int, int]:
        """Class steps left before the lower and the upper end of the range, both >= 0."""
        ...

    def tap(self) -> NDArray[np.float64]:
        """The samples of one tap at the current place, shape (J, K)."""
        ...

    def move(self, delta: int) -> int:
        """Moves by `delta` where classes, at most to the end of the range.

        Returns:
            The steps really made, `delta` clipped to `[-room[0], room[1]]`. The belief is shifted by the commanded
            `delta`: the realised one would tell where the sensor stood.
        """
        ...


def clipped_move(delta: int, room: tuple[int, int]) -> int:
    """The part of a move that a sensor with this room can make."""
    return max(-room[0], min(int(delta), room[1]))


def check_class(grid: ClassGrid, where: int, what: int) -> None:
    """Whether a class lies on the grid.

    Raises:
        InputError: It does not.
    """
    if not (0 <= where < grid.L and 0 <= what < grid.M):
        raise InputError(f"Class ({where}, {what}) lies outside the grid of {grid.L} x {grid.M} classes.")
