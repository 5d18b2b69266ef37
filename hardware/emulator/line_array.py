"""Emulated taxel array that prints a line per reading, like an Arduino sketch."""

import math

import numpy as np

from ..simulator.signal_chain import FULL_SCALE
from .faults import Switches
from .finger import Finger
from .sensor_faults import FaultyFinger, LostReadings

_BOOT_S = 1.0


class LineArray:
    """Restarts when the port is opened, then prints a header and `t_ms,v0,...` at a fixed rate; ignores all input.

    Args:
        switches: Faults.
        finger: The finger.
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
        """Restarts, as opening the port resets the board."""
        self._start_s = time_s
        self._printed = 0

    def closed(self, time_s: float) -> None:  # noqa: ARG002 - the interface of a device
        """Stops printing until the port is opened again."""
        self._start_s = math.inf

    def receive(self, data: bytes, time_s: float) -> None:
        """Ignores the bytes."""

    def next_event_s(self) -> float:
        """Time of the next line; infinity while the port is closed."""
        return self._start_s + _BOOT_S + self._printed / self._rate_hz

    def step(self, time_s: float) -> bytes:
        """Lines that are due, with a header before the first."""
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
