"""An emulated array of taxels that prints a line for each reading, like a sketch on an Arduino."""

import math

import numpy as np

from ..simulator.signal_chain import FULL_SCALE
from .faults import Switches
from .finger import Finger
from .sensor_faults import FaultyFinger, LostReadings

_BOOT_S = 1.0


class LineArray:
    """Restarts when the port is opened, then prints a header and `t_ms,v0,...` at a steady rate, whatever it is told.

    Args:
        switches: Faults.
        finger: What it reads.
        rate_hz: Readings per second.
    """

    def __init__(self, switches: Switches, finger: Finger, rate_hz: float) -> None:
        self._switches = switches
        self._finger = FaultyFinger(switches, finger)
        self._rate_hz = rate_hz
        self._start_s = math.inf
        self._printed = 0
        self._losses = LostReadings(switches)

    def opened(self, time_s: float) -> None:
        """Restarts, as the port's lines reset it."""
        self._start_s = time_s
        self._printed = 0

    def closed(self, time_s: float) -> None:  # noqa: ARG002 - the interface of a device
        """Prints nothing until the port is opened again."""
        self._start_s = math.inf

    def receive(self, data: bytes, time_s: float) -> None:
        """Ignores what it is told."""

    def next_event_s(self) -> float:
        """When the next line comes; infinity while the port is closed."""
        return self._start_s + _BOOT_S + self._printed / self._rate_hz

    def step(self, time_s: float) -> bytes:
        """The lines that are due, the header before the first."""
        lines = b""
        while (due_s := self.next_event_s()) <= time_s:
            if self._printed == 0:
                lines += f"# solidtouch-lines K={self._finger.taxels} rate_hz={self._rate_hz:g}\n".encode()
            self._printed += 1
            lines += self._line(due_s)
        return lines

    def _line(self, time_s: float) -> bytes:
        counts = np.clip(np.rint(self._finger.read(time_s)), 0, FULL_SCALE).astype(int)
        if self._losses.strikes(time_s) or self._switches.strikes("silent_sensor", time_s) is not None:
            return b""
        return ",".join(map(str, [round(1000 * (time_s - self._start_s)), *counts.tolist()])).encode() + b"\n"
