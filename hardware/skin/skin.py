"""Reading of all taxels, limits of readings, and counts of their faults."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class SkinFrame:
    """One reading of all taxels.

    Attributes:
        time_s: Rig time in seconds at which its first byte was read.
        raw: Values as sent, in the configured order, shape (K,).
        values: Values that rise under load, `255 - raw` for the iCub's fingertip, shape (K,).
        valid: Whether each taxel is valid, shape (K,).
        device_ms: The sensor's own time in milliseconds, if it sends one.
    """

    time_s: float
    raw: NDArray[np.float64]
    values: NDArray[np.float64]
    valid: NDArray[np.bool_]
    device_ms: float | None = None


@dataclass
class SkinCounts:
    """Counts of faults, in readings unless noted.

    Attributes:
        frames: Complete readings.
        lost: Lost readings.
        unpaired: Half readings without the other half.
        foreign: Messages from other boards or sensors.
        dropped: Malformed or overlong lines.
        stale: Gaps of at least three periods.
        stuck: Readings identical to the previous one, beyond the number that a quiet sensor may repeat.
        saturated: Readings with a saturated taxel.
        invalid: Readings with a taxel reported as invalid.
        refused: Commands refused by the adapter.
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
    """Default of `on_frame`: ignores the reading."""


@dataclass(frozen=True)
class SkinLimits:
    """Limits of the readings of a sensor.

    Attributes:
        name: Port of the sensor, for messages.
        taxels: Number of taxels, `K`.
        rate_hz: Readings per second.
        idle_low: Lowest mean of a taxel without contact, as sent.
        idle_high: Highest mean of a taxel without contact, as sent.
        highest: Mean above which a taxel at rest may be saturated, as sent.
        noise_limit: Largest standard deviation of a taxel without contact; infinity if unknown, and then neither rest
            is checked nor drift tracked.
        overload: Value, with the sign that rises under load, at or beyond which a taxel is overloaded.
        stuck_readings: Number of consecutive identical readings that show a stuck sensor; 0 for no check.
        own_clock: Whether the sensor sends its own time.
        stale_s: Silence in seconds after which the sensor is stale; `None` for that of `SkinMonitor`.
    """

    name: str
    taxels: int
    rate_hz: float
    idle_low: float = -math.inf
    idle_high: float = math.inf
    highest: float = math.inf
    noise_limit: float = math.inf
    overload: float = math.inf
    stuck_readings: int = 0
    own_clock: bool = False
    stale_s: float | None = None


def taxel_names(marked: NDArray[np.bool_]) -> str:
    """Names of the marked taxels, shape (K,), such as `taxel 3` or `taxels 3, 5`."""
    numbers = np.flatnonzero(marked)
    return f"taxel{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}"
