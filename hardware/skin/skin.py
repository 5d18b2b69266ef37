"""Reading of all taxels, counts of faults, and the baseline: whether the sensor is untouched.

A board calibrates even under load, and may recalibrate by itself. Both show as readings at rest far from their expected
values.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import BaselineRefused


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


REST_NOISE_LIMITS = 2.0
"""Largest distance of a taxel at rest from the baseline, in noise limits."""
FOLLOWED_NOISE_LIMITS_PER_S = 0.125
"""Largest drift rate of the baseline, in noise limits per second: half a count for the fingertip."""


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


class Baseline:
    """Values of an untouched sensor, which may drift.

    Args:
        limits: Limits of the readings.

    Attributes:
        values: Values without contact, rising under load, shape (K,); NaN before the first `settle`.
    """

    def __init__(self, limits: SkinLimits) -> None:
        self.values = np.full(limits.taxels, np.nan)
        self._limits = limits
        self._rest_limit = REST_NOISE_LIMITS * limits.noise_limit
        self._step = FOLLOWED_NOISE_LIMITS_PER_S * limits.noise_limit / limits.rate_hz

    @property
    def is_known(self) -> bool:
        """Whether it has been measured."""
        return not np.isnan(self.values).any()

    def settle(self, frames: Sequence[SkinFrame]) -> None:
        """Sets the baseline to the mean of readings.

        Raises:
            BaselineRefused: They are not those of an untouched sensor, or invalid; the old values are kept.
        """
        good = self._valid(frames)
        raw = np.array([frame.raw for frame in good])
        self._check_mean(raw.mean(axis=0))
        self._check_noise(raw.std(axis=0))
        self.values = np.mean([frame.values for frame in good], axis=0)

    def follow(self, frame: SkinFrame) -> None:
        """Tracks drift with a valid reading, at a bounded rate, unless a taxel is touched."""
        if math.isinf(self._step):
            return
        away = frame.values - self.values
        if np.abs(away).max() <= self._rest_limit:
            self.values = self.values + np.clip(away, -self._step, self._step)

    def check(self, frames: Sequence[SkinFrame]) -> None:
        """Checks that readings just before a press are those of an untouched finger.

        Raises:
            BaselineRefused: They are not, or the board has recalibrated under load.
        """
        if not frames or not self.is_known or math.isinf(self._rest_limit):
            return
        valid = self._valid(frames)
        self._check_end(np.mean([frame.raw for frame in valid], axis=0))
        away = np.mean([frame.values for frame in valid], axis=0) - self.values
        if (wrong := np.abs(away) > self._rest_limit).any():
            raise BaselineRefused(
                f"{self._limits.name}: {taxel_names(wrong)} up to {np.abs(away).max():.1f} away from the baseline at "
                f"rest, limit {self._rest_limit:g}; something touches the finger, or the board recalibrated by "
                f"itself: free the finger and restart."
            )

    def _valid(self, frames: Sequence[SkinFrame]) -> list[SkinFrame]:
        """The readings with all taxels valid, if there are enough."""
        good = [frame for frame in frames if frame.valid.all()]
        if len(good) < len(frames) / 2:
            wrong = ~np.all([frame.valid for frame in frames], axis=0)
            raise BaselineRefused(
                f"{self._limits.name}: {taxel_names(wrong)} invalid in {len(frames) - len(good)} of {len(frames)} "
                f"readings without contact, as after a calibration under load or with a broken chip; free the finger "
                f"and restart."
            )
        return good

    def _check_mean(self, mean: NDArray[np.float64]) -> None:
        self._check_end(mean)
        low, high = self._limits.idle_low, self._limits.idle_high
        if (wrong := (mean < low) | (mean > high)).any():
            k = int(np.argmax(np.maximum(low - mean, mean - high)))
            raise BaselineRefused(
                f"{self._limits.name}: {taxel_names(wrong)} not at rest without contact: taxel {k} reads "
                f"{mean[k]:.1f}, expected {low:g} to {high:g}; free the finger and restart."
            )

    def _check_end(self, mean: NDArray[np.float64]) -> None:
        if (wrong := mean > self._limits.highest).any():
            raise BaselineRefused(
                f"{self._limits.name}: {taxel_names(wrong)} not at rest without contact: taxel {int(np.argmax(mean))} "
                f"reads {mean.max():.1f}, the end of its range, as after a calibration under load; free the finger and "
                f"restart."
            )

    def _check_noise(self, deviation: NDArray[np.float64]) -> None:
        limit = self._limits.noise_limit
        if (wrong := deviation > limit).any():
            k = int(np.argmax(deviation))
            raise BaselineRefused(
                f"{self._limits.name}: {taxel_names(wrong)} not at rest without contact: taxel {k} varies by "
                f"{deviation[k]:.1f}, expected at most {limit:g}; free the finger and restart."
            )


def taxel_names(marked: NDArray[np.bool_]) -> str:
    """Names of the marked taxels, shape (K,), such as `taxel 3` or `taxels 3, 5`."""
    numbers = np.flatnonzero(marked)
    return f"taxel{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}"
