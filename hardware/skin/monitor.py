"""Checks of the readings of a tactile sensor, shared by all drivers.

Nothing is repaired: lost, invalid or stuck readings are counted and reported, never repeated or made up.

Samples of a tap may be implausible though every frame is valid: SLCAN frames have no checksum after the adapter, so a
flipped bit of a hex digit arrives as another value; and a board that recalibrates under load gives wrong readings from
then on. Both leave traces that contact cannot cause.
"""

import math
from collections.abc import Callable, Sequence
from itertools import groupby
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import SensorFault, SensorOverload, StaleSensor
from ..journal import Journal
from ..link.loop import Loop
from ..link.port import Port
from .skin import SkinCounts, SkinFrame, SkinLimits, taxel_names
from .tracking import Baseline, LossTracker

_LATE_PERIODS = 3.5  # three readings overdue, the last by half a period
_STALE_S = 0.16, 0.3
"""Shortest and longest silence after which a sensor is stale, unless its settings say otherwise or it is slower.

A busy computer leaves gaps of some 0.14 s; a finger at 12 mm/s moves 2 mm in the shortest.
"""
_GAPS = 3.0  # how many times the longest gap of the baseline is no silence
BLIND_READINGS = 3
_TOUCHED_READINGS = 3  # a single one may be damaged
_TOUCH_NOISE_LIMITS = 5.0
BASELINE_S = 1.0
BASELINE_READINGS = 50
RATE_TOLERANCE = 0.05
_STEADY = 0.1  # residuals of arrival times, in periods, below which the measured period is better than the nominal one
_SAME_PERIOD = 0.001
_CLOCK_SLACK = 0.25


class Skin(Protocol):
    """A tactile sensor on a port that sends readings at a steady rate.

    After `listen`, `on_frame` is called for every reading while the loop runs.

    Attributes:
        port: Port of the sensor.
        on_frame: Called with every reading; set it to receive them.
        monitor: Checks of the readings.
    """

    port: Port
    on_frame: Callable[[SkinFrame], None]
    monitor: "SkinMonitor"

    @property
    def counts(self) -> SkinCounts:
        """Counts of faults so far."""
        ...

    @property
    def taxels(self) -> int:
        """`K`."""
        ...

    @property
    def rate_hz(self) -> float:
        """Configured readings per second."""
        ...

    def listen(self) -> None:
        """Opens the port, checks the device and starts the readings.

        Raises:
            RigError: The device is missing or unexpected; the port is closed again.
        """
        ...

    def stop(self) -> None:
        """Stops the readings and closes the port; never raises a `RigError`."""
        ...


class SkinMonitor:
    """Checks every reading of a sensor, counts faults, and tracks the baseline.

    Args:
        limits: Limits of the readings.
        loop: Loop that reads the port.
        journal: Journal for faults.

    Attributes:
        counts: Counts of faults so far; the driver adds those that only it can see.
        rest: Baseline of the sensor.
    """

    def __init__(self, limits: SkinLimits, loop: Loop, journal: Journal) -> None:
        self.counts = SkinCounts()
        self.rest = Baseline(limits)
        self._limits = limits
        self._loop = loop
        self._journal = journal
        self._period_s = 1.0 / limits.rate_hz
        self._collected: list[tuple[float, SkinFrame]] | None = None
        self._losses = self._tracker(self._period_s)
        self._last: SkinFrame | None = None
        self._last_s = math.inf
        self._same = self._blind = self._pressed = 0
        self._is_late = False
        self._longest_s = 0.0  # gap of the baseline

    @property
    def stale_s(self) -> float:
        """Silence in seconds after which the sensor is stale."""
        if self._limits.stale_s is not None:
            return self._limits.stale_s
        low, high = _STALE_S
        return max(_LATE_PERIODS * self._period_s, min(max(low, _GAPS * self._longest_s), high))

    @property
    def baseline(self) -> NDArray[np.float64]:
        """Values without contact, shape (K,); NaN before they are measured."""
        return self.rest.values.copy()

    def begin(self) -> None:
        """Discards earlier readings, at the start or end of a stream."""
        self._losses = self._tracker(self._period_s)
        self._last, self._last_s = None, math.inf
        self._same = self._blind = self._pressed = 0
        self._is_late = False

    def take(self, frame: SkinFrame, clock_s: float) -> None:
        """Checks the next reading.

        Args:
            frame: The reading.
            clock_s: The sensor's own time in seconds if it has one, else that of the frame.
        """
        counts, limits = self.counts, self._limits
        counts.frames += 1
        if change := self._losses.push(clock_s, frame.time_s):
            self._count_lost(change, frame.time_s)
        repeated = self._last is not None and np.array_equal(frame.raw, self._last.raw)
        self._same = self._same + 1 if repeated else 0
        counts.stuck += 0 < limits.stuck_readings <= self._same
        valid = bool(frame.valid.all())
        counts.invalid += not valid
        self._blind = 0 if valid or frame.valid.any() else self._blind + 1
        counts.saturated += self.overloaded(frame)
        self._pressed = self._pressed + 1 if self._presses(frame) else 0
        if valid:
            self.rest.follow(frame)
        if self._collected is not None:
            self._collected.append((clock_s, frame))
        self._last, self._last_s = frame, frame.time_s
        self._is_late = False

    def clock_jumped(self, time_s: float) -> None:
        """Notes a jump of the sensor's own time between the last reading and the next, at `time_s`."""
        self._losses.restart(time_s)
        self._count_lost(1, time_s)

    def comes(self, wait_s: float) -> bool:
        """Whether a reading arrives within `wait_s` seconds; runs the loop meanwhile.

        Raises:
            RigError: As `Loop.turn`.
        """
        before, until = self.counts.frames, self._loop.now + wait_s
        while self.counts.frames == before and self._loop.now < until:
            self._loop.turn(until)
        return self.counts.frames > before

    def overloaded(self, frame: SkinFrame) -> bool:
        """Whether a taxel is saturated under load, even if reported as invalid."""
        return bool(frame.values.max() >= self._limits.overload)

    @property
    def touches(self) -> bool:
        """Whether the last three readings, none of them stale, are of a finger that touches something."""
        return self._pressed >= _TOUCHED_READINGS and self._loop.now - self._last_s <= self.stale_s

    def check_free(self, now_s: float) -> None:  # noqa: ARG002 - the signature of a guard
        """Guard for moves beside the object.

        Raises:
            SensorOverload: The last three readings are of a finger that touches something.
        """
        if self.touches:
            raise SensorOverload(f"{self._limits.name}: the finger touched something on its way and was stopped.")

    def _presses(self, frame: SkinFrame) -> bool:
        """Whether a taxel reads far above its baseline, or is saturated where none is known."""
        above = frame.values - self.rest.values
        return self.overloaded(frame) or bool((above > _TOUCH_NOISE_LIMITS * self._limits.noise_limit).any())

    def check(self, now_s: float) -> None:
        """Guard for the loop.

        Raises:
            StaleSensor: No reading for `stale_s`; a warning is recorded after three periods.
            SensorFault: All taxels are invalid, or the values are stuck.
        """
        name, stuck = self._limits.name, self._limits.stuck_readings
        silent_s = now_s - self._last_s
        if silent_s > _LATE_PERIODS * self._period_s:
            self._note_late(now_s)
        if silent_s > self.stale_s:
            raise StaleSensor(
                f"{name}: no reading for {1000 * silent_s:.0f} ms, expected one every {1000 * self._period_s:g} ms."
            )
        if self._blind >= BLIND_READINGS:
            raise SensorFault(f"{name}: all taxels were invalid in the last {self._blind} readings.")
        if 0 < stuck <= self._same:
            raise SensorFault(f"{name}: the last {self._same + 1} readings are identical; the sensor is stuck.")

    def verdict(self, frames: Sequence[SkinFrame]) -> str | None:
        """Why consecutive readings are implausible, as a phrase, or None.

        If the last of them are late, runs the loop until it is clear whether any was lost.

        Raises:
            RigError: As `Loop.turn`.
        """
        if not frames:
            return None
        self._decide()
        if lost := self._losses.between(frames[0].time_s, frames[-1].time_s):
            return f"{lost} reading{'s' * (lost > 1)} lost"
        if self._losses.undecided:
            return "readings late or lost"
        valid = np.array([frame.valid for frame in frames])
        if not valid.all():
            bad = int((~valid.all(axis=1)).sum())
            return f"{taxel_names(~valid.all(axis=0))} invalid in {bad} of {len(frames)} readings"
        longest = max(len(list(run)) for _, run in groupby(frame.raw.tobytes() for frame in frames))
        if 0 < self._limits.stuck_readings < longest:
            return f"stuck for {longest} readings"
        return None

    def check_rest(self, frames: Sequence[SkinFrame]) -> None:
        """Checks that readings just before a press are those of an untouched sensor.

        Raises:
            BaselineRefused: They are not.
        """
        self.rest.check(frames)

    def measure_baseline(self) -> None:
        """Sets the baseline to the mean of about one second of readings without contact.

        Raises:
            BaselineRefused: They are not those of an untouched sensor; the old baseline is kept.
            SensorFault: Readings are missing, stuck, or arrive at the wrong rate.
            RigError: As `Loop.turn`.
        """
        frames = self._collect(max(BASELINE_READINGS, math.ceil(BASELINE_S * self._limits.rate_hz)))
        self._longest_s = float(np.diff([frame.time_s for frame in frames]).max())
        self.check(self._loop.now)
        self.rest.settle(frames)

    def _tracker(self, period_s: float) -> LossTracker:
        if self._limits.own_clock:
            return LossTracker(period_s, patience=0.0, slack=_CLOCK_SLACK)
        return LossTracker(period_s)

    def _count_lost(self, change: int, time_s: float) -> None:
        self.counts.lost += change
        if change > 0:
            self._journal.event(time_s, "lost", f"{change} reading{'s' * (change > 1)} lost", readings=change)

    def _note_late(self, now_s: float) -> None:
        if not self._is_late:
            self._is_late = True
            self.counts.stale += 1
            self._journal.event(now_s, "late", "no reading for three periods")

    def _decide(self) -> None:
        until = self._loop.now + 2 * self._losses.patience_s
        while self._losses.undecided and self._loop.now < until:
            self._loop.turn(until)

    def _collect(self, n: int) -> list[SkinFrame]:
        """Next `n` readings, checked for their rate."""
        self._collected = collected = []
        start_s = self._loop.now
        until = start_s + 2.5 * n * self._period_s
        try:
            while len(collected) < n and self._loop.now < until:
                self._loop.turn(until)
        finally:
            self._collected = None
        if len(collected) < 3:
            raise StaleSensor(
                f"{self._limits.name}: {len(collected)} readings in {until - start_s:.1f} s instead of {n}."
            )
        self._check_rate(np.array([clock_s for clock_s, _ in collected]))
        return [frame for _, frame in collected]

    def _check_rate(self, clock_s: NDArray[np.float64]) -> None:
        """Checks the rate of the readings; adopts a steady rate."""
        number = np.arange(len(clock_s))
        slope_s, start_s = np.polyfit(number, clock_s - clock_s[0], 1)
        rate_hz = 1.0 / slope_s if slope_s > 0 else math.inf
        if abs(rate_hz / self._limits.rate_hz - 1.0) > RATE_TOLERANCE:
            raise SensorFault(
                f"{self._limits.name}: {rate_hz:.1f} readings per second instead of {self._limits.rate_hz:g}; the "
                f"sensor runs at another rate, or many readings are lost."
            )
        spread_s = np.std(clock_s - clock_s[0] - start_s - slope_s * number)
        if not self._limits.own_clock and spread_s < _STEADY * self._period_s:
            self._take_over(float(slope_s))

    def _take_over(self, period_s: float) -> None:
        if abs(period_s / self._losses.period_s - 1.0) > _SAME_PERIOD:
            self._losses = self._tracker(period_s)


_REST_SAMPLES = 3
_JUMP_NOISE_LIMITS = 2.0
_REST_NOISE_LIMITS = 3.0


def touches(samples: NDArray[np.float64], lead: int, noise_limit: float) -> bool:
    """Whether three samples of a tap rise far above those before the press; arguments as in `implausible`.

    With an unknown noise limit every tap counts as a touch.
    """
    rise = (samples[lead:] - samples[: max(lead, 1)].mean(axis=0)).max(axis=1)
    high = int((rise > _TOUCH_NOISE_LIMITS * noise_limit).sum())
    return high >= _TOUCHED_READINGS or not math.isfinite(noise_limit)


def implausible(samples: NDArray[np.float64], lead: int, noise_limit: float) -> str | None:
    """Why a tap is implausible, as a phrase, or None.

    Args:
        samples: One tap of a sensor whose values rise under load, shape (J, K), starting before the press.
        lead: Number of samples before the press, without contact.
        noise_limit: Largest standard deviation of an untouched taxel, in units of the samples; infinity if unknown,
            and then nothing is checked.
    """
    if not np.isfinite(noise_limit):
        return None
    jump = _jumps(samples)
    if jump.max(initial=0.0) > _JUMP_NOISE_LIMITS * noise_limit:
        j, k = np.unravel_index(np.argmax(jump), jump.shape)
        return f"taxel {k} jumped by {jump[j, k]:g} for one reading"
    if lead >= _REST_SAMPLES:
        shift = np.abs(samples[-_REST_SAMPLES:].mean(axis=0) - samples[:lead].mean(axis=0))
        if shift.max() > _REST_NOISE_LIMITS * noise_limit:
            k = int(np.argmax(shift))
            return f"taxel {k} returned to {shift[k]:.1f} away from its value before the press"
    return None


def _jumps(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each inner sample from its neighbours and the lines through them, shape (J - 2, K).

    The lines admit the turning point of a fast press.
    """
    if len(samples) < 3:
        return np.zeros((0, samples.shape[1]))
    padded = np.concatenate([samples[:1], samples, samples[-1:]])
    before, after = padded[1:-3], padded[3:-1]
    expected = np.stack([before, after, 2 * before - padded[:-4], 2 * after - padded[4:]])
    inner = samples[1:-1]
    return np.maximum(np.maximum(inner - expected.max(axis=0), expected.min(axis=0) - inner), 0.0)
