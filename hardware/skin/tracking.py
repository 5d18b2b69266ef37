"""What is tracked from reading to reading: readings lost without a number, and the baseline of an untouched sensor.

Readings leave at a steady period and may arrive late, but never early. With `n` readings sent before it, a reading that
arrives at `t` has the residual `t - n * period`; the lower envelope of residuals is flat despite delays, and steps up
by a period for each lost reading. So a delay is not a loss if a later reading is on time again; if none is, it is.

A board calibrates even under load, and may recalibrate by itself. Both show as readings at rest far from their expected
values.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import BaselineRefused
from .skin import SkinFrame, SkinLimits, taxel_names

_REMEMBERED = 1024
_SAME_STEP = 0.25
_DOUBT = 3  # readings after the first at the new envelope that may have been sent before the gap and delayed

REST_NOISE_LIMITS = 2.0
"""Largest distance of a taxel at rest from the baseline, in noise limits."""
FOLLOWED_NOISE_LIMITS_PER_S = 0.125
"""Largest drift rate of the baseline, in noise limits per second: half a count for the fingertip."""


class Loss(NamedTuple):
    """A loss of readings.

    Attributes:
        earliest_s: Time of the first reading that may follow the gap.
        latest_s: Time of the last reading that may precede the gap.
        readings: Number of lost readings.
    """

    earliest_s: float
    latest_s: float
    readings: int


class LossTracker:
    """Counts lost readings and records when they were lost.

    Args:
        period_s: Time in seconds between two readings, in the clock of `push`.
        patience: Periods after which persistent delay means a loss; 0 if the clock of `push` is the sensor's own, in
            which nothing is late.
        slack: Fraction by which a period may exceed `period_s`.

    Attributes:
        period_s: Time in seconds between two readings.
        patience_s: Time in seconds after which persistent delay means a loss.
        lost: Number of readings lost so far.
    """

    def __init__(self, period_s: float, patience: float = 25.0, slack: float = 0.002) -> None:
        self.period_s = period_s
        self.lost = 0
        self.patience_s = patience * period_s
        self._slack_s = slack * period_s
        self._losses: deque[Loss] = deque(maxlen=_REMEMBERED)
        self._sent = 0
        self._anchor: tuple[int, float] | None = None
        self._step: tuple[int, float] | None = None
        self._late: list[tuple[float, float]] = []
        self._lowest_s = self._since_s = float("inf")
        self._last_s = float("-inf")

    @property
    def undecided(self) -> bool:
        """Whether the last readings are late, or come after a loss."""
        return bool(self._late)

    def push(self, clock_s: float, time_s: float) -> int:
        """Takes the next reading.

        Args:
            clock_s: Its time in the clock in which readings are equally spaced.
            time_s: Its time for `between`.

        Returns:
            Change of `lost`; negative if readings counted as lost turn out to have been late.
        """
        before = self.lost
        queue = deque([(clock_s, time_s)])
        while queue:
            if self._take(*queue.popleft()):
                queue.extendleft(reversed(self._confirm()))
        return self.lost - before

    def restart(self, time_s: float) -> None:
        """Notes a jump of the sensor's clock between the last reading and the one at `time_s`."""
        self._losses.append(Loss(time_s, self._last_s, 1))
        self.lost += 1
        self._anchor = self._step = None
        self._late.clear()

    def between(self, first_s: float, last_s: float) -> int:
        """Number of readings lost between two received ones, an upper bound if uncertain."""
        return sum(loss.readings for loss in self._losses if first_s <= loss.latest_s and last_s >= loss.earliest_s)

    def _take(self, clock_s: float, time_s: float) -> bool:
        """Whether the readings that are now late mean a loss."""
        self._sent += 1
        residual_s = clock_s - self._sent * self.period_s
        if self._anchor is None:
            self._anchor = self._sent, residual_s
        envelope_s = self._anchor[1] + (self._sent - self._anchor[0]) * self._slack_s
        late_s = residual_s - envelope_s
        if late_s <= self.period_s / 2:
            residual_s += self._take_back(residual_s) * self.period_s
            self._anchor = self._sent, min(envelope_s, residual_s)
            self._late.clear()
            self._last_s = time_s
            return False
        return self._wait(late_s, clock_s, time_s)

    def _wait(self, late_s: float, clock_s: float, time_s: float) -> bool:
        if not self._late:
            self._lowest_s = float("inf")
        if late_s < self._lowest_s - _SAME_STEP * self.period_s:
            self._since_s = clock_s
        self._lowest_s = min(self._lowest_s, late_s)
        self._late.append((clock_s, time_s))
        return clock_s - self._since_s >= self.patience_s

    def _take_back(self, residual_s: float) -> int:
        """Revokes losses if a reading arrives earlier than possible after them; returns their number."""
        if self._step is None or (self._sent - self._step[0]) * self._slack_s > _SAME_STEP * self.period_s:
            return 0
        found = min(max(0, round((self._step[1] - residual_s) / self.period_s)), self.lost)
        self._sent -= found
        self.lost -= found
        return found

    def _confirm(self) -> list[tuple[float, float]]:
        """Records a loss before the late readings, and returns these for another check."""
        late, self._late = self._late, []
        readings = max(1, round(self._lowest_s / self.period_s))
        lowest = next(i for i, (clock_s, _) in enumerate(late) if clock_s >= self._since_s)
        before = lowest + (_DOUBT if self.patience_s else 0)
        last_s = late[min(before, len(late)) - 1][1] if before else self._last_s
        self._losses.append(Loss(late[0][1], last_s, readings))
        self._sent += readings - len(late)
        self._step = self._anchor and (self._sent, self._anchor[1])
        self.lost += readings
        return late


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
