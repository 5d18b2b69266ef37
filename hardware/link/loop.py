"""One loop in one thread reads all ports of a rig while anyone waits for anything.

A driver never reads its port. It is handed its bytes, and whoever waits for an answer, for a motion to end or for a
tap to be complete turns this loop meanwhile; so frames arrive while the stage moves, and a guard sees every frame.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..errors import NoAnswer, PortLost
from .clock import Clock
from .port import Port

Receiver = Callable[[bytes, float], None]
"""Takes bytes and the rig time at which they were read."""
Guard = Callable[[float], None]
"""Looks at the rig at a time and raises a `RigError` if all must stop."""


class Loop:
    """Waits, reads, hands out bytes and runs the guards.

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
        """Waits for bytes until a time at the latest, hands out all there are, and runs the guards.

        A lost port is told once and no longer read, so that the other devices can still be brought to rest.

        Raises:
            RigError: A port was lost, a device failed, or a guard objects.
        """
        self.clock.wait(list(self._receivers), until)
        for port, receive in list(self._receivers.items()):
            if port not in self._receivers:  # a receiver before it detached it
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
        """Lets rig time go on.

        Raises:
            RigError: As `turn`.
        """
        until = self.now + seconds
        while self.now < until:
            self.turn(until)

    def wait_for(self, condition: Callable[[], bool], timeout_s: float, expected: str) -> None:
        """Turns until a condition holds.

        Args:
            condition: Asked before the first turn and after each.
            timeout_s: Time in seconds that it may take.
            expected: The sentence of the error, which says who did not do what.

        Raises:
            NoAnswer: It took longer.
            RigError: As `turn`.
        """
        until = self.now + timeout_s
        while not condition():
            if self.now >= until:
                raise NoAnswer(expected)
            self.turn(until)
