"""What perception needs to know of a rig; simulated, replayed and real ones all satisfy it."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

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
