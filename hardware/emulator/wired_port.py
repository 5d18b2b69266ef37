"""A port without a system, with an emulated device behind it, and its clock: for many short runs in rig time."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from ..errors import PortLost, RigError
from .link import Device


class ManualClock:
    """Time that advances only while someone waits: to the next byte of a port, or to the end of the wait.

    Attributes:
        time_s: Rig time.
    """

    def __init__(self) -> None:
        self.time_s = 0.0

    def now(self) -> float:
        """Rig time in seconds."""
        return self.time_s

    def wait(self, ports: Sequence[Any], until: float) -> None:
        """Waits until a port has bytes, at most until rig time `until`."""
        while not any(port.waiting() for port in ports):
            due = min((port.next_event_s() for port in ports), default=math.inf)
            self.time_s = max(self.time_s, min(due, until))
            for port in ports:
                port.step()
            if due > until:
                return


class MemoryPort:
    """The interface of `Port`, without a system.

    Args:
        clock: Its time.
        address: Its name.

    Attributes:
        address: Its name.
        clock: Its time.
        is_open: Whether it is open.
        sent: Bytes written.
        received: Bytes read.
        failure: Raised by every use, as if the port had failed so.
        incoming: Bytes that can be read.
    """

    def __init__(self, clock: ManualClock, address: str) -> None:
        self.address = address
        self.clock = clock
        self.is_open = False
        self.sent = self.received = 0
        self.failure: RigError | None = None
        self.incoming: bytearray = bytearray()

    def open(self) -> None:
        """Opens it."""
        self.is_open = True

    def close(self) -> None:
        """Closes it."""
        self.is_open = False

    def read(self) -> bytes:
        """All bytes received so far."""
        self.check()
        data = bytes(self.incoming)
        self.incoming.clear()
        self.received += len(data)
        return data

    def write(self, data: bytes) -> None:
        """Sends bytes."""
        self.check()
        self.sent += len(data)

    def waiting(self) -> int:
        """Number of bytes that can be read; 1 if a read would fail."""
        return len(self.incoming) if self.is_open and self.failure is None else 1

    def fileno(self) -> None:
        """No file descriptor."""

    def check(self) -> None:
        """Raises what a use of a failed or closed port does.

        Raises:
            RigError: `failure`, or `PortLost`.
        """
        if self.failure is not None:
            self.is_open &= not isinstance(self.failure, PortLost)
            raise self.failure
        if not self.is_open:
            raise PortLost(f"{self.address}: the port is closed.")


class WiredPort(MemoryPort):
    """A port with an emulated device behind it.

    Args:
        clock: Its time.
        device: The device.
        address: Its name.
        wire: Changes what the device sends.

    Attributes:
        device: The device.
        wire: Changes what the device sends.
        log: All bytes sent.
    """

    def __init__(
        self, clock: ManualClock, device: Device, address: str, wire: Callable[[bytes], bytes] = bytes
    ) -> None:
        super().__init__(clock, address)
        self.device = device
        self.wire = wire
        self.log = b""

    def open(self) -> None:
        """Opens it, as the device sees."""
        if not self.is_open:
            super().open()
            self.device.opened(self.clock.now())

    def close(self) -> None:
        """Closes it, as the device sees."""
        if self.is_open:
            super().close()
            self.incoming.clear()
            self.device.closed(self.clock.now())

    def write(self, data: bytes) -> None:
        """Sends bytes to the device."""
        super().write(data)
        self.log += bytes(data)
        self.device.receive(bytes(data), self.clock.now())
        self.step()

    def next_event_s(self) -> float:
        """Time of the device's next event."""
        return self.device.next_event_s()

    def step(self) -> None:
        """Takes what the device sends now."""
        if data := self.device.step(self.clock.now()):
            self.incoming.extend(self.wire(data))
