"""Time on the rig: drivers ask one clock for the time and wait on nothing else.

The clock of a real rig is the host's monotonic one. Emulated devices hand out their own (`shared_clock.py`), which
stands still while the driver computes; deadlines then do not depend on how busy the machine is.
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
        """Returns when a port has bytes or is lost, and at rig time `until` at the latest.

        Args:
            ports: Open ports, from which everything that came before has been read.
            until: Rig time in seconds.
        """
        ...


class HostClock:
    """The monotonic clock of this computer."""

    def now(self) -> float:
        """Time in seconds since some moment."""
        return time.monotonic()

    def wait(self, ports: Sequence[Port], until: float) -> None:
        """Returns when a port has bytes or is lost, and at time `until` at the latest."""
        files = [port.fileno() for port in ports]
        known = [file for file in files if file is not None]
        if len(known) == len(files):
            select.select(known, [], [], max(0.0, until - time.monotonic()))
            return
        while not any(port.waiting() for port in ports) and (left := until - time.monotonic()) > 0:
            time.sleep(min(_POLL_S, left))
