"""One reading of all taxels, and what can be wrong with many."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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
