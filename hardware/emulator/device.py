"""Device behind a pseudo-terminal: a state machine in rig time, without files or clocks."""

from typing import Protocol


class Device(Protocol):
    """An emulated device. Times are rig time in seconds and never go backwards between calls."""

    def opened(self, time_s: float) -> None:
        """A program opened the port."""
        ...

    def closed(self, time_s: float) -> None:
        """The program closed the port or ended."""
        ...

    def receive(self, data: bytes, time_s: float) -> None:
        """Bytes came from the program."""
        ...

    def next_event_s(self) -> float:
        """Time of the device's next event; infinity if none is due."""
        ...

    def step(self, time_s: float) -> bytes:
        """Handles all events due by this time; returns the bytes to send."""
        ...
