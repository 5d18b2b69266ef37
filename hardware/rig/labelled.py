"""A rig that tells its journal what is tapped and where, tap by tap, as a data collection does."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...models.io.rig_recording import TapLabel
from ...models.preprocessing import Preprocessing
from .rig import Rig


class LabelledRig:
    """A `TouchSensor` whose taps have labels, so that a recording of them becomes a tap set.

    Args:
        rig: Connected.

    Attributes:
        what: Number of the object in the table of the recording; None where it is not known, and taps get no label.
    """

    def __init__(self, rig: Rig) -> None:
        self.what: int | None = None
        self._rig = rig
        self._trial = 0

    @property
    def preprocessing(self) -> Preprocessing:
        """How taps are prepared."""
        return self._rig.preprocessing

    @property
    def room(self) -> tuple[int, int]:
        """Class steps left to either side."""
        return self._rig.room

    def move(self, delta: int) -> int:
        """Moves by `delta` where classes, at most to the end of the range; returns the steps made."""
        return self._rig.move(delta)

    def tap(self) -> NDArray[np.float64]:
        """The samples of one tap, shape (J, K)."""
        self._rig.label = {}
        if self.what is not None:
            label = TapLabel(trial=self._trial, what=self.what, where_mm=self._rig.place_mm, session=0)
            self._rig.label = msgspec.to_builtins(label)
        self._trial += 1
        return self._rig.tap()
