"""Rig time: drivers read one clock and wait only on it.

A real rig uses the host's monotonic clock. Emulated devices provide their own (`shared_clock.py`), which stands still
while the driver computes, so deadlines do not depend on the load of the machine.
"""

import select
import time
from collections.abc import Sequence
from typing import Protocol

from .port import Port

_POLL_S = 0.001


class Clock(Protocol):
    """Rig time, in seconds that never go backwards."""

    def now(self) -> float:
        """Time in seconds."""
        ...

    def wait(self, ports: Sequence[Port], until: float) -> None:
        """Waits until a port has bytes or is lost, at most until rig time `until`.

        Args:
            ports: Open ports with all earlier bytes read.
            until: Rig time in seconds.
        """
        ...


class HostClock:
    """The monotonic clock of this computer."""

    def now(self) -> float:
        """Time in seconds since an arbitrary origin."""
        return time.monotonic()

    def wait(self, ports: Sequence[Port], until: float) -> None:
        """Waits until a port has bytes or is lost, at most until time `until`."""
        files = [port.fileno() for port in ports]
        known = [file for file in files if file is not None]
        if len(known) == len(files):
            select.select(known, [], [], max(0.0, until - time.monotonic()))
            return
        while not any(port.waiting() for port in ports) and (left := until - time.monotonic()) > 0:
            time.sleep(min(_POLL_S, left))
