"""A sensor that sends a line of text per reading, such as an array behind an Arduino, as a `Skin`.

Each line carries the sensor's own time, so readings that are lost are known exactly. The sensor takes no commands;
opening the port resets most boards.
"""

import numpy as np

from ..errors import NoAnswer, RigError, WrongDevice
from ..journal import Journal
from ..link.loop import Loop
from ..link.patient_open import open_patiently
from ..link.port import Port
from ..rig.settings import LineSettings
from .baseline import SkinLimits
from .line_frames import CLOCK_MS, Comment, LineDecoder, LineReading
from .monitor import SkinMonitor
from .skin import SkinCounts, SkinFrame, ignore_frame

BOOT_S = 5.0
"""Time in seconds until the first reading: an Arduino that opening the port resets takes about two."""
QUIET_S = 0.2
"""Time in seconds in which what the sensor sent before it was reset is thrown away."""
JUMP_S = 1.0
"""How far the sensor's time may stray from the host's between two readings; more is a line damaged on its way."""
_NOISE_BYTES = 32


class LineSensor:
    """A sensor of K taxels.

    Args:
        settings: Which, and where.
        loop: Reads the port.
        journal: Hears of every reading and trouble.
        port: In place of that of the settings.

    Attributes:
        port: Where it is.
        on_frame: Called with every reading.
        monitor: Whether the readings can be trusted.
        remarks: Comments that the sensor sent since `start`, at most ten.
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
        """`K` of the taps, which may be taken from a part of the line."""
        return len(self._order)

    @property
    def rate_hz(self) -> float:
        """Readings per second that it should send."""
        return self._settings.rate_hz

    @property
    def counts(self) -> SkinCounts:
        """What went wrong so far."""
        counts = self.monitor.counts
        counts.dropped = self._decoder.lines.dropped.line_count
        return counts

    def start(self) -> None:
        """Opens the port, waits for readings and measures the baseline.

        Raises:
            RigError: The device is missing, another one, or touched; the port is closed again.
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
            self.monitor.measure_baseline()
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Closes the port; never raises a `RigError`."""
        self.monitor.begin()
        self._loop.detach(self.port)
        self.port.close()

    def receive(self, data: bytes, time_s: float) -> None:
        """Takes bytes of the port."""
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
            return WrongDevice(f"{name}: lines of {other} values come, where sensor.taxels = {K} are expected.")
        if self._decoder.lines.dropped.byte_count + self._decoder.lines.pending >= _NOISE_BYTES:
            return WrongDevice(
                f"{name}: what comes are no lines of a time and {K} values; this is another device, or sensor.baud is "
                f"wrong."
            )
        return NoAnswer(f"{name}: no line of a time and {K} values came within {wait_s:.1f} s.")

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
        """The sensor's time, which goes on where the counter starts again."""
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
    """Takes bytes from before the start."""


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
    )
