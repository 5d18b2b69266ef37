"""Serial port, the only module that imports pySerial, and the lines in its bytes.

Addresses are those of `serial.serial_for_url`: a device such as `/dev/serial/by-id/...`, which keeps its name when it
is plugged in again, or a URL such as `socket://host:port`.

The line splitter reads no port: bytes are pushed in, complete lines come out.
"""

import errno
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from ...models.extras import extra
from ..errors import PortBusy, PortError, PortLost, WriteTimeout

try:
    from termios import error as terminal_error
except ModuleNotFoundError:  # on Windows
    terminal_error = OSError
if TYPE_CHECKING:
    import serial

WRITE_TIMEOUT_S = 1.0
"""Write timeout in seconds. Commands are shorter than 100 bytes, which take 9 ms at 115200 baud."""

_LOST = (OSError, terminal_error, TypeError)
"""Exceptions of the system when a device disappears, from which pySerial derives its own; a read in progress may even
meet a None file."""
_MOST_BYTES = 65536


class Port:
    """A serial port that never blocks for long and raises only `RigError`.

    Args:
        address: Device or URL.
        baud: Bits per second.

    Attributes:
        address: Device or URL.
        sent: Bytes written since the port was opened.
        received: Bytes read since the port was opened.
    """

    def __init__(self, address: str, baud: int = 115200) -> None:
        self.address = address
        self.sent = 0
        self.received = 0
        self._baud = baud
        self._serial: serial.Serial | None = None

    @property
    def is_open(self) -> bool:
        """Whether it is open, as last seen."""
        return self._serial is not None

    def open(self) -> None:
        """Opens the port exclusively; earlier input is discarded.

        Raises:
            PortBusy: Another program has it open.
            PortError: It does not exist or is not a serial port.
        """
        if self._serial is not None:
            return
        with extra("serial"):
            import serial  # noqa: PLC0415 - an extra, which replays do not need
        try:
            self._serial = serial.serial_for_url(
                self.address, baudrate=self._baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True
            )
        except (*_LOST, ValueError) as error:
            raise self._not_opened(error) from error
        self.sent = self.received = 0

    def close(self) -> None:
        """Closes the port if it is open."""
        if self._serial is not None:
            port, self._serial = self._serial, None
            with suppress(*_LOST):  # a lost port is closed already
                port.close()

    def read(self) -> bytes:
        """All bytes received so far, possibly none.

        Raises:
            PortLost: The port was lost or is closed.
        """
        with self._losing("reading") as port:
            data = port.read(_MOST_BYTES)
        self.received += len(data)
        return data

    def write(self, data: bytes) -> None:
        """Sends bytes.

        Raises:
            PortLost: The port was lost or is closed.
            WriteTimeout: Not all were sent in time; the device may have received any part of them.
        """
        with self._losing("writing") as port:
            port.write(data)
        self.sent += len(data)

    def waiting(self) -> int:
        """Number of bytes that can be read; 1 if the port is lost, so that a read reports it."""
        try:
            return 1 if self._serial is None else self._serial.in_waiting
        except _LOST:
            return 1

    def fileno(self) -> int | None:
        """File descriptor, None if there is none to wait on."""
        try:
            return None if self._serial is None else self._serial.fileno()
        except (*_LOST, AttributeError):
            return None

    @contextmanager
    def _losing(self, doing: str) -> "Iterator[serial.Serial]":
        if self._serial is None:
            raise PortLost(f"{self.address}: the port is closed.")
        try:
            yield self._serial
        except _LOST as error:
            from serial import SerialTimeoutException  # noqa: PLC0415 - as in `open`

            if isinstance(error, SerialTimeoutException):
                said = f"the device took no bytes for {WRITE_TIMEOUT_S:g} s; part of them may have arrived"
                raise WriteTimeout(f"{self.address}: {said}.") from error
            self.close()
            reader = " or is read by a second program" if "no data" in str(error) else ""
            raise PortLost(f"{self.address}: lost the port while {doing}; it was unplugged{reader}.") from error

    def _not_opened(self, error: Exception) -> PortError:
        number = getattr(error, "errno", None)
        if number in (errno.EAGAIN, errno.EBUSY) or "lock" in str(error):
            return PortBusy(f"{self.address}: another program has the port open.")
        why = {errno.ENOENT: "no such port", errno.EACCES: "permission denied"}.get(number or 0)
        return PortError(f"{self.address}: cannot open the port: {why or str(error).rstrip('.')}.")


class Line(NamedTuple):
    """Text before a terminator.

    Attributes:
        text: Bytes without the terminator, or None if the line was too long and dropped.
        end: The terminator, one byte.
    """

    text: bytes | None
    end: bytes


@dataclass
class Dropped:
    """Counts of what a decoder has dropped.

    Attributes:
        overlong: Number of lines longer than any that the device sends.
        malformed: Number of lines that violate the protocol.
        byte_count: Bytes of both, without terminators.
    """

    overlong: int = 0
    malformed: int = 0
    byte_count: int = 0

    @property
    def line_count(self) -> int:
        """Number of dropped lines of both kinds."""
        return self.overlong + self.malformed

    def malform(self, text: bytes) -> None:
        """Counts a malformed line."""
        self.malformed += 1
        self.byte_count += len(text)


class LineSplitter:
    """Returns complete lines and keeps the rest, at most `longest` bytes of it.

    The lines do not depend on how the stream is split into pushes.

    Args:
        terminators: Bytes that each end a line.
        longest: Longest line kept, in bytes without its terminator.

    Attributes:
        dropped: Counts of what was dropped; the decoder on top adds to them.
    """

    def __init__(self, terminators: bytes, longest: int) -> None:
        self._end = re.compile(b"[" + re.escape(terminators) + b"]")
        self._longest = longest
        self._kept = bytearray()
        self._overlong = False
        self.dropped = Dropped()

    @property
    def pending(self) -> int:
        """Bytes that wait for their terminator."""
        return len(self._kept)

    def push(self, data: bytes) -> list[Line]:
        """Lines that these bytes complete."""
        lines, start = [], 0
        for match in self._end.finditer(data):
            self._keep(data[start : match.start()])
            lines.append(Line(self._take(), match.group()))
            start = match.end()
        self._keep(data[start:])
        return lines

    def _keep(self, data: bytes) -> None:
        if not self._overlong and self.pending + len(data) <= self._longest:
            self._kept += data
            return
        self.dropped.overlong += not self._overlong
        self.dropped.byte_count += self.pending + len(data)
        self._overlong = True
        self._kept.clear()

    def _take(self) -> bytes | None:
        text = None if self._overlong else bytes(self._kept)
        self._kept.clear()
        self._overlong = False
        return text
