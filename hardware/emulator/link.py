"""A device behind its pseudo-terminal: opening, closing, bytes both ways, and faults of the line."""

from math import inf
from pathlib import Path
from typing import Any, Protocol

from .faults import Switches
from .pseudo_terminal import PseudoTerminal
from .wire import Wire


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


_PROBE = b"AT\r\nATE1 E0\r\n"
_OLD_TEXT = b"\x00k\r\n0,0>\r\n"
_REMEMBERED_BYTES = 64
_UNPLUGGED_S = 1.0
_BUSY_S = 10.0
_DEAF_S = 1.0


class Link:
    """One device and its port; times are rig time in seconds.

    Args:
        name: `"stage"` or `"sensor"`, for faults that are on for one port only.
        path: Path of the port.
        device: The device.
        switches: Faults.

    Attributes:
        name: Name of the port.
        device: The device.
        terminal: Its pseudo-terminal.
    """

    def __init__(self, name: str, path: Path, device: Device, switches: Switches) -> None:
        self.name = name
        self.device = device
        self.terminal = PseudoTerminal(path)
        self._switches = switches
        self._wire = Wire(name, switches)
        self._open = False
        self._received = 0
        self._back_s = inf
        self._free_s = inf
        self._hearing_s = inf
        self._last = b""
        self._left = b""

    @property
    def is_open(self) -> bool:
        """Whether a program has the port open, as last seen."""
        return self._open

    def next_event_s(self) -> float:
        """Time of the next event that needs no input."""
        return min(self.device.next_event_s(), self._wire.next_event_s(), self._back_s, self._free_s, self._hearing_s)

    def listen(self, time_s: float, sent: int | None = None) -> None:
        """Detects whether a program opened or closed the port, and passes on what it wrote.

        Args:
            time_s: Current rig time.
            sent: Bytes that the program reports to have written since it opened the port; waits for all of them.
        """
        if not self.terminal.is_plugged or self._free_s < inf or self._hearing_s < inf:
            return
        is_open = self.terminal.is_open
        if is_open and not self._open:
            self._note_opened(time_s)
        if self.terminal.has_input and (fault := self._strikes("deaf", time_s)) is not None:
            self._hearing_s = time_s + fault.get("seconds", _DEAF_S)
            return
        self._hear(time_s, sent if is_open else None)
        if self._open and not is_open:
            self.terminal.discard()
            self._note_closed(time_s)
        if not is_open and (fault := self._strikes("busy_port", time_s)) is not None:
            self._occupy(time_s, fault.get("seconds", _BUSY_S))

    def step(self, time_s: float) -> None:
        """Handles all events of the device and the line that are due."""
        if time_s >= self._back_s:
            self.come_back()
        if time_s >= self._free_s:
            self.terminal.release()
            self.device.closed(time_s)
            self._free_s = inf
        if time_s >= self._hearing_s:
            self._hearing_s = inf
            self.listen(time_s)
        if time_s >= self.device.next_event_s() and (data := self.device.step(time_s)):
            self._last = (self._last + data)[-_REMEMBERED_BYTES:]
            self._wire.send(data, time_s)

    def deliver(self, time_s: float) -> int:
        """Writes the bytes that have arrived.

        Returns:
            Number of bytes that the program can read; 1 if it has just lost the port, which a read will show.
        """
        data = self._wire.arrived(time_s)
        if not data:
            return 0
        if self._free_s < inf:
            self._left = (self._left + data)[-_REMEMBERED_BYTES:]
            return 0
        if not self._open:
            return 0
        for fault in ("unplug", "renumber"):
            if (parameters := self._strikes(fault, time_s)) is not None:
                self._vanish(time_s, parameters.get("seconds", _UNPLUGGED_S), fault == "renumber")
                return 1
        written = self.terminal.write(data)
        if written and (theft := self._strikes("second_reader", time_s)) is not None:
            written -= self.terminal.steal(int(theft.get("count", (written + 1) // 2)))
        return written

    def come_back(self) -> None:
        """Puts a port back that has vanished."""
        self.terminal.plug()
        self._back_s = inf

    def close(self) -> None:
        """Removes the port."""
        self.terminal.unplug()

    def _strikes(self, fault: str, time_s: float) -> dict[str, Any] | None:
        return self._switches.strikes(fault, time_s, self.name)

    def _hear(self, time_s: float, sent: int | None) -> None:
        """Reads, and detects whether the program reopened the port since the last call.

        A program counts the bytes sent since its last opening, so excess bytes date from before it.
        """
        data = self.terminal.read(0 if sent is None else sent - self._received)
        if data and not self._open:
            self._note_opened(time_s)
        if sent is not None and self._received + len(data) > sent:
            before = max(0, len(data) - sent)
            if before:
                self.device.receive(data[:before], time_s)
            self._note_closed(time_s)
            self._note_opened(time_s)
            data = data[before:]
        self._received = self._received + len(data) if sent is None else sent  # missing bytes are lost
        if data:
            self.device.receive(data, time_s)

    def _note_opened(self, time_s: float) -> None:
        self._open = True
        self._received = 0
        self.device.opened(time_s)
        if self._strikes("stale_input", time_s) is not None:
            self._left += self._last or _OLD_TEXT
        if self._left:
            self._wire.send(self._left, time_s)
            self._left = b""

    def _note_closed(self, time_s: float) -> None:
        self._open = False
        self._received = 0
        self.device.closed(time_s)

    def _occupy(self, time_s: float, seconds: float) -> None:
        """Another program, such as a modem manager, opens the port and talks to the device."""
        self.terminal.hold()
        self.device.opened(time_s)
        self.device.receive(_PROBE, time_s)
        self._free_s = time_s + seconds

    def _vanish(self, time_s: float, seconds: float, renumber: bool) -> None:
        self.terminal.unplug(renumber)
        self._wire.clear()
        self._note_closed(time_s)
        self._back_s = time_s + seconds
