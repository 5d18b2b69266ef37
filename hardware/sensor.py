"""Interface of a sensor for perception; simulated, replayed and real rigs implement it."""

from numbers import Integral, Real
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.errors import InputError
from ..models.grid import ClassGrid
from ..models.preprocessing import Preprocessing

_ROUNDING = 1e-6  # of a step
_FARTHEST = 2**53  # positions, that a number counts exactly


class TouchSensor(Protocol):
    """A sensor that taps an object and moves along it in steps of one position.

    Moves are counted in positions, not millimetres, so that the shift of the belief (Eq. 9) and the motor command are
    the same integer. The rig converts it to millimetres. A sensor may have two attributes for pictures: `taxel_mm`, the
    places of its taxels in mm, shape (K, 2) or (K, 3), and `units`, the unit of its samples as text.
    """

    @property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing of the taps; perception compares it with that of the model."""
        ...

    @property
    def step(self) -> ArrayLike:
        """Length of a step in the unit of the model's positions: one number, or one for each pair of neighbours.

        The latter, of shape (L - 1,), says that the sensor has L positions; perception compares it with the model.
        """
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


def check_sensor(sensor: object) -> None:
    """Checks that something is a sensor, as far as its names show.

    Raises:
        InputError: It is not.
    """
    for name in ("preprocessing", "step", "tap", "move"):
        if not hasattr(sensor, name):
            raise InputError(f"A sensor needs {name!r}, see TouchSensor; got {type(sensor).__name__}.")


def check_move(delta: object) -> int:
    """A move as an integer.

    Raises:
        InputError: It is no integer number of positions.
    """
    if not (isinstance(delta, Real) and float(delta).is_integer() and abs(float(delta)) < _FARTHEST):
        raise InputError(f"A move must be an integer number of positions, got {delta!r}.")
    return int(float(delta))


def clipped_move(delta: int, room: tuple[int, int]) -> int:
    """Steps of a move that fit into the room left.

    Raises:
        InputError: As `check_move`.
    """
    return max(-room[0], min(check_move(delta), room[1]))


def check_step(step: ArrayLike, grid: ClassGrid, name: str = "The sensor") -> None:
    """Checks that a step of a sensor is a step of the model.

    Args:
        step: As `TouchSensor.step`.
        grid: Class grid of the model.
        name: Name of the sensor for messages.

    Raises:
        InputError: It is not, or the sensor has another number of positions.
    """
    step, apart = np.asarray(step, dtype=np.float64), np.diff(grid.where_value)
    if step.ndim and step.shape != apart.shape:
        raise InputError(f"{name} has {len(step) + 1} positions, the model {grid.L}.")
    step = np.broadcast_to(step, apart.shape)
    wrong = ~(np.abs(apart - step) <= _ROUNDING * step)
    if wrong.any():
        l = wrong.argmax()
        raise InputError(f"{name} moves in steps of {step[l]:g}, but the model's positions are {apart[l]:g} apart.")


def check_class(grid: ClassGrid, where: int, what: int) -> None:
    """Checks that a class lies on the grid.

    Raises:
        InputError: It does not, or an index is no integer.
    """
    if not isinstance(grid, ClassGrid):
        raise InputError(f"grid must be a ClassGrid, got {type(grid).__name__}.")
    if not (isinstance(where, Integral) and isinstance(what, Integral) and 0 <= where < grid.L and 0 <= what < grid.M):
        raise InputError(f"Class ({where!r}, {what!r}) is outside the grid of {grid.L} x {grid.M} classes.")
