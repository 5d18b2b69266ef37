"""A rig that labels its taps in the journal, as in a data collection."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...models.io.rig_recording import TapLabel
from ...models.preprocessing import Preprocessing
from .rig import Rig


class LabelledRig:
    """A `TouchSensor` with labelled taps, so that a recording of them can be read as a tap set.

    Args:
        rig: Rig, connected.

    Attributes:
        what: Index of the object in the recording; None if unknown, and then taps are not labelled.
    """

    def __init__(self, rig: Rig) -> None:
        self.what: int | None = None
        self._rig = rig
        self._trial = 0

    @property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing of the taps."""
        return self._rig.preprocessing

    @property
    def step(self) -> float:
        """Length of a step in mm."""
        return self._rig.step

    @property
    def room(self) -> tuple[int, int]:
        """Steps left to either end of the range."""
        return self._rig.room

    def move(self, delta: int) -> int:
        """Moves by `delta` positions, at most to the end of the range; returns the steps made."""
        return self._rig.move(delta)

    def tap(self) -> NDArray[np.float64]:
        """Samples of one tap, shape (J, K)."""
        self._rig.label = {}
        if self.what is not None:
            label = TapLabel(trial=self._trial, what=self.what, where_mm=self._rig.place_mm, session=0)
            self._rig.label = msgspec.to_builtins(label)
        self._trial += 1
        return self._rig.tap()
