r"""Sensor that sends a line of text per reading, such as an array on an Arduino, as a `Skin`.

Each line carries the sensor's own time, so lost readings are known exactly. The sensor takes no commands; opening the
port resets most boards.

A line ends with `\n` or `\r\n`. It is a comment if it starts with `#`, a reading if it is a time and exactly K
finite numbers, and else is dropped. What stands before the first line end may be half a reading and is not believed.
"""

import math
import re
from dataclasses import dataclass

import numpy as np

from ..errors import NoAnswer, RigError, WrongDevice
from ..journal import Journal
from ..link.loop import Loop, open_patiently
from ..link.port import LineSplitter, Port
from ..rig.settings import LineSettings
from .monitor import SkinMonitor
from .skin import SkinCounts, SkinFrame, SkinLimits, ignore_frame

CLOCK_MS = 1 << 32
"""The sensor's time counts milliseconds and starts again at this number, as Arduino's `millis` does."""

_TIME = re.compile(rb"[0-9]{1,10}")
_NUMBER = re.compile(rb"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_LONGEST_NUMBER = 24
_LONGEST_COMMENT = 200


@dataclass(frozen=True, slots=True)
class LineReading:
    """One reading.

    Attributes:
        t_ms: The sensor's time in milliseconds, below `CLOCK_MS`.
        values: K numbers.
    """

    t_ms: int
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Comment:
    """A comment line of the sensor, without the `#`."""

    text: str


class LineDecoder:
    """Turns bytes into readings and comments, and keeps the rest for the next push.

    No bytes raise an exception, and a bounded number of them is kept.

    Args:
        taxels: `K`.

    Attributes:
        lines: What waits for its line end, and what was thrown away as neither reading nor comment.
        other_size: Values in the last line that had too many or too few, None if there was none.
    """

    def __init__(self, taxels: int) -> None:
        self.other_size: int | None = None
        self._taxels = taxels
        self.lines = LineSplitter(b"\n", longest_line(taxels))
        self._begun = False

    def push(self, data: bytes) -> list[LineReading | Comment]:
        """Readings and comments that these bytes complete."""
        units: list[LineReading | Comment] = []
        for text, _ in self.lines.push(data):
            begun, self._begun = self._begun, True
            line = (text or b"").removesuffix(b"\r")
            if not line or not (begun or line.startswith(b"#")):
                continue
            unit = self._unit(line)
            self.lines.dropped.malform(line) if unit is None else units.append(unit)
        return units

    def _unit(self, line: bytes) -> LineReading | Comment | None:
        if line.startswith(b"#"):
            return Comment(line[1:].strip().decode("ascii", "replace"))
        time, *numbers = line.split(b",")
        if not _TIME.fullmatch(time) or int(time) >= CLOCK_MS or not all(map(_NUMBER.fullmatch, numbers)):
            return None
        if len(numbers) != self._taxels:
            self.other_size = len(numbers)
            return None
        values = tuple(map(float, numbers))
        return LineReading(int(time), values) if all(map(math.isfinite, values)) else None


def longest_line(taxels: int) -> int:
    """Bytes kept of a line of a sensor with so many taxels."""
    return max(_LONGEST_COMMENT, 16 + (_LONGEST_NUMBER + 1) * taxels)


BOOT_S = 5.0
"""Timeout in seconds for the first reading; an Arduino reset by opening the port takes about two."""
QUIET_S = 0.2
"""Time in seconds for which input from before the reset is discarded."""
JUMP_S = 1.0
"""Largest difference of sensor and host time between two readings; more means a damaged line."""
_NOISE_BYTES = 32


class LineSensor:
    """A sensor of K taxels.

    Args:
        settings: Settings of the sensor.
        loop: Loop that reads the port.
        journal: Journal for readings and faults.
        port: Port to use instead of that of the settings.

    Attributes:
        port: Port of the sensor.
        on_frame: Called with every reading.
        monitor: Checks of the readings.
        remarks: Comments sent by the sensor since `start`, at most ten.
    """

    def __init__(self, settings: LineSettings, loop: Loop, journal: Journal, port: Port | None = None) -> None:
        self.port = port or Port(settings.port, settings.baud)
        self.on_frame = ignore_frame
        self.remarks: list[str] = []
        self._settings = settings
        self._loop = loop
        self._journal = journal
        self._order = np.array(settings.order or range(settings.taxels))
        self._sign = 1.0 if settings.rising else -1.0
        self._decoder = LineDecoder(settings.taxels)
        self.monitor = SkinMonitor(_limits(settings, len(self._order), self.port.address), loop, journal)
        self._device_ms: float | None = None
        self._read_s = 0.0

    @property
    def taxels(self) -> int:
        """Number of taxels of the taps, which may be a subset of the line."""
        return len(self._order)

    @property
    def rate_hz(self) -> float:
        """Configured readings per second."""
        return self._settings.rate_hz

    @property
    def counts(self) -> SkinCounts:
        """Counts of faults so far."""
        counts = self.monitor.counts
        counts.dropped = self._decoder.lines.dropped.line_count
        return counts

    def listen(self) -> None:
        """Opens the port and waits for readings.

        Raises:
            RigError: The device is missing or unexpected; the port is closed again.
        """
        try:
            open_patiently(self.port, self._loop, self._journal)
            self._loop.attach(self.port, _ignore)
            self._loop.sleep(QUIET_S)
            self._decoder = LineDecoder(self._settings.taxels)
            self._device_ms = None
            self.remarks.clear()
            self.monitor.begin()
            self._loop.attach(self.port, self.receive)
            self._wait_for_readings()
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Closes the port; never raises a `RigError`."""
        self.monitor.begin()
        self._loop.detach(self.port)
        self.port.close()

    def receive(self, data: bytes, time_s: float) -> None:
        """Takes bytes from the port."""
        for unit in self._decoder.push(data):
            if isinstance(unit, LineReading):
                self._take(unit, time_s)
            else:
                self._remark(unit, time_s)

    def _wait_for_readings(self) -> None:
        wait_s = BOOT_S + 3.0 / self.rate_hz
        if not self.monitor.comes(wait_s):
            raise self._no_readings(wait_s)

    def _no_readings(self, wait_s: float) -> RigError:
        name, K, other = self.port.address, self._settings.taxels, self._decoder.other_size
        if other is not None:
            return WrongDevice(f"{name}: received lines of {other} values, expected sensor.taxels = {K}.")
        if self._decoder.lines.dropped.byte_count + self._decoder.lines.pending >= _NOISE_BYTES:
            return WrongDevice(
                f"{name}: received no lines of a time and {K} values, but other data; this is another device, or "
                f"sensor.baud is wrong."
            )
        return NoAnswer(f"{name}: received no line of a time and {K} values within {wait_s:.1f} s.")

    def _remark(self, comment: Comment, time_s: float) -> None:
        if len(self.remarks) < 10:
            self.remarks.append(comment.text)
            self._journal.event(time_s, "sensor", comment.text)

    def _take(self, reading: LineReading, time_s: float) -> None:
        device_ms = self._unwrapped(reading.t_ms, time_s)
        raw = np.array(reading.values)[self._order]
        frame = SkinFrame(time_s, raw, self._sign * raw, np.ones(len(raw), bool), device_ms)
        self._journal.frame(frame)
        self.monitor.take(frame, device_ms / 1000.0)
        self.on_frame(frame)

    def _unwrapped(self, t_ms: int, time_s: float) -> float:
        """Sensor time in seconds, continuous across counter overflows."""
        if self._device_ms is None:
            device_ms = float(t_ms)
        else:
            step_ms = (t_ms - self._device_ms) % CLOCK_MS
            if not 0 < step_ms < 1000.0 * (time_s - self._read_s + JUMP_S):
                self.monitor.clock_jumped(time_s)
                device_ms = float(t_ms)
            else:
                device_ms = self._device_ms + step_ms
        self._device_ms, self._read_s = device_ms, time_s
        return device_ms


def _ignore(data: bytes, time_s: float) -> None:
    """Discards bytes from before the start."""


def _limits(settings: LineSettings, taxels: int, name: str) -> SkinLimits:
    overload = np.inf if settings.overload is None else settings.overload * (1.0 if settings.rising else -1.0)
    return SkinLimits(
        name=name,
        taxels=taxels,
        rate_hz=settings.rate_hz,
        idle_low=settings.idle_low,
        idle_high=settings.idle_high,
        noise_limit=settings.noise_limit,
        overload=overload,
        stuck_readings=settings.stuck_readings,
        own_clock=True,
        stale_s=settings.stale_s,
    )
