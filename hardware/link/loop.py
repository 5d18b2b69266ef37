"""Rig time, and the single-threaded loop that reads all ports of a rig during every wait.

Drivers read one clock and wait only on it: the host's monotonic clock, or that of emulated devices.

Drivers never read their ports; the loop passes them their bytes. Whoever waits for an answer, the end of a motion or a
complete tap runs the loop meanwhile, so frames arrive while the stage moves, and guards see every frame.
"""

import select
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from ..errors import NoAnswer, PortBusy, PortLost
from ..journal import Journal
from .port import Port

_POLL_S = 0.001
_GUARDED_S = 0.05  # longest time without a look at the guards, as a silent device sends nothing


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


Receiver = Callable[[bytes, float], None]
"""Receives bytes and the rig time at which they were read."""
Guard = Callable[[float], None]
"""Checks the rig at a rig time; raises a `RigError` to stop everything."""


class Loop:
    """Waits, reads, dispatches bytes and runs the guards.

    Args:
        clock: Rig time.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self._receivers: dict[Port, Receiver] = {}
        self._guards: list[Guard] = []

    @property
    def now(self) -> float:
        """Rig time in seconds."""
        return self.clock.now()

    def attach(self, port: Port, receive: Receiver) -> None:
        """Reads an open port from now on."""
        self._receivers[port] = receive

    def detach(self, port: Port) -> None:
        """Stops reading a port."""
        self._receivers.pop(port, None)

    @contextmanager
    def guarded(self, guard: Guard) -> Iterator[None]:
        """Runs a guard after every turn inside the block."""
        self._guards.append(guard)
        try:
            yield
        finally:
            self._guards.remove(guard)

    @contextmanager
    def unguarded(self) -> Iterator[None]:
        """Runs no guard inside the block, so that a rig in trouble can still be brought to rest."""
        guards, self._guards = self._guards, []
        try:
            yield
        finally:
            self._guards = guards

    def turn(self, until: float) -> None:
        """Waits for bytes at most until a time, dispatches them, and runs the guards; if there are any, waits less.

        A lost port is reported once and then no longer read, so that the other devices can still be brought to rest.

        Raises:
            RigError: A port was lost, a device failed, or a guard objects.
        """
        self.clock.wait(list(self._receivers), min(until, self.now + _GUARDED_S) if self._guards else until)
        for port, receive in list(self._receivers.items()):
            if port not in self._receivers:  # detached by an earlier receiver
                continue
            try:
                data = port.read()
            except PortLost:
                self.detach(port)
                raise
            if data:
                receive(data, self.clock.now())
        for guard in tuple(self._guards):
            guard(self.clock.now())

    def sleep(self, seconds: float) -> None:
        """Waits for a time in seconds of rig time, while reading.

        Raises:
            RigError: As `turn`.
        """
        until = self.now + seconds
        while self.now < until:
            self.turn(until)

    def wait_for(self, condition: Callable[[], bool], timeout_s: float, expected: str) -> None:
        """Runs the loop until a condition holds.

        Args:
            condition: Checked before the first turn and after each.
            timeout_s: Timeout in seconds.
            expected: Message of the error on timeout.

        Raises:
            NoAnswer: The timeout expired.
            RigError: As `turn`.
        """
        until = self.now + timeout_s
        while not condition():
            if self.now >= until:
                raise NoAnswer(expected)
            self.turn(until)


BUSY_S = 15.0
"""Time in seconds that a port may stay busy; a modem manager probes a new one for about ten."""
_RETRY_S = 0.5


def open_patiently(port: Port, loop: Loop, journal: Journal) -> None:
    """Opens a port, retrying while another program has it open.

    Raises:
        PortBusy: The other program keeps it open.
        PortError: It cannot be opened.
        RigError: As `Loop.turn`.
    """
    until = loop.now + BUSY_S
    while True:
        try:
            port.open()
            return
        except PortBusy as error:
            if loop.now >= until:
                raise
            journal.event(loop.now, "busy", str(error))
        loop.sleep(_RETRY_S)
