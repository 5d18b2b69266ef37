"""One reading of all taxels, and what perception needs of whatever sends them.

Readings keep the sensor's own sign and units; `load` of a monitored frame is what rises under touch.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .port import Port


@dataclass(frozen=True, slots=True, eq=False)
class SkinFrame:
    """One reading of all taxels.

    Attributes:
        time_s: Rig time in seconds at which its first byte was read.
        raw: What the sensor sent, in the order configured, shape (K,).
        values: The same with the sign that rises under load: `255 - raw` for the iCub's fingertip; shape (K,).
        valid: Whether each taxel can be believed, shape (K,).
        device_ms: The sensor's own time in milliseconds, if it sends one.
    """

    time_s: float
    raw: NDArray[np.float64]
    values: NDArray[np.float64]
    valid: NDArray[np.bool_]
    device_ms: float | None = None


@dataclass
class SkinCounts:
    """What went wrong so far, in frames unless said.

    Attributes:
        frames: Complete readings.
        lost: Readings that must have been sent and did not come.
        unpaired: Halves without the other one.
        foreign: Units from other boards or sensors.
        dropped: Units of bytes that were no unit of the protocol.
        stale: Times that none came for three periods.
        stuck: Readings bit-identical to the one before, beyond the number that a still sensor may repeat.
        saturated: Readings with a taxel at the end of its range.
        invalid: Readings with a taxel that the board reports as not to be believed.
        refused: Commands that the adapter refused.
    """

    frames: int = 0
    lost: int = 0
    unpaired: int = 0
    foreign: int = 0
    dropped: int = 0
    stale: int = 0
    stuck: int = 0
    saturated: int = 0
    invalid: int = 0
    refused: int = 0


def ignore_frame(frame: SkinFrame) -> None:
    """What `on_frame` is as long as nobody wants the readings."""


class Skin(Protocol):
    """A tactile sensor on a port that sends readings at a steady rate.

    `start` comes first; from then on `on_frame` is called for every reading while the loop turns.

    Attributes:
        port: Where it is.
        on_frame: Called with every reading; replaced by whoever wants them.
    """

    port: Port
    on_frame: Callable[[SkinFrame], None]

    @property
    def counts(self) -> SkinCounts:
        """What went wrong so far."""
        ...

    @property
    def taxels(self) -> int:
        """`K`."""
        ...

    @property
    def rate_hz(self) -> float:
        """Readings per second that it is set to."""
        ...

    @property
    def baseline(self) -> NDArray[np.float64]:
        """`values` without contact, shape (K,)."""
        ...

    def start(self) -> None:
        """Opens the port, makes sure who answers, starts the readings and measures the baseline.

        Raises:
            RigError: The device is missing, another one, or touched.
        """
        ...

    def measure_baseline(self) -> None:
        """Takes the mean of some readings without contact as `baseline`, if they are those of an untouched sensor.

        Raises:
            BaselineRefused: They are not.
            SensorFault: The readings cannot be trusted.
        """
        ...

    def check(self, now_s: float) -> None:
        """A guard for the loop.

        Raises:
            StaleSensor: No reading came for three periods.
            SensorFault: All taxels are invalid, or the values are stuck.
        """
        ...

    def check_rest(self, frames: Sequence[SkinFrame]) -> None:
        """Whether readings just before a press are those of an untouched sensor.

        Raises:
            BaselineRefused: They are not.
        """
        ...

    def overloaded(self, frame: SkinFrame) -> bool:
        """Whether a taxel is at the end of its range under load."""
        ...

    def verdict(self, frames: Sequence[SkinFrame]) -> str | None:
        """Why readings that followed each other cannot be believed, one phrase, or None if they can.

        Args:
            frames: As `on_frame` had them, in order, up to the last one.

        Raises:
            RigError: As `Loop.turn`, which it calls where it must see further readings.
        """
        ...

    def stop(self) -> None:
        """Stops the readings and closes the port; never raises a `RigError`."""
        ...
