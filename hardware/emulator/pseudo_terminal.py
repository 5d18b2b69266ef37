"""Pseudo-terminal behind a link with a constant name, as in `/dev/serial/by-id`.

Only the device's end is kept open, so the system reports whether a program has the other one. A full buffer drops
bytes as a UART does, and unread bytes are lost when the program closes the port.
"""

import os
import select
from contextlib import suppress
from pathlib import Path

from ...models.errors import InputError
from ...models.extras import posix

with posix("An emulated device"):
    import fcntl
    import tty

_PATIENCE_MS = 200
"""Longest real time in milliseconds for expected bytes to pass through the system; they need less than one."""
_MOST_BYTES = 65536


class PseudoTerminal:
    """Device end of a serial line.

    Args:
        link: Path of the port.

    Attributes:
        link: Path of the port.
        overrun: Bytes dropped because the buffer was full.

    Raises:
        InputError: The path exists and is not a link, or no link can be created.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self.overrun = 0
        self._master: int | None = None
        self._name = ""
        self._avoid = ""
        self._holder: int | None = None
        self._poll = select.poll()
        if link.exists(follow_symlinks=False) and not link.is_symlink():
            raise InputError(f"{link}: exists and is not a link to a terminal; move it or choose another folder.")
        try:
            self.plug()
        except OSError as error:
            self.unplug()
            raise InputError(f"{link}: cannot create the port: {error.strerror}.") from error

    @property
    def is_plugged(self) -> bool:
        """Whether the link leads to a terminal."""
        return self._master is not None

    @property
    def is_open(self) -> bool:
        """Whether a program has it open."""
        return self.is_plugged and not self._events() & select.POLLHUP

    @property
    def has_input(self) -> bool:
        """Whether input from a program is waiting."""
        return bool(self._events() & select.POLLIN)

    def fileno(self) -> int | None:
        """File descriptor of the device end, None while unplugged."""
        return self._master

    def plug(self) -> None:
        """Creates a terminal and its link unless there is one."""
        if self._master is not None:
            return
        self._master, self._name = _open_terminal(self._avoid)
        os.set_blocking(self._master, False)
        self._poll.register(self._master, select.POLLIN)
        beside = self.link.with_name(f".{self.link.name}.new")
        beside.unlink(missing_ok=True)
        beside.symlink_to(self._name)
        beside.replace(self.link)

    def unplug(self, renumber: bool = False) -> None:
        """Removes terminal and link; a program that has it open gets an error.

        Args:
            renumber: Whether the next terminal must have another device number.
        """
        if self._master is None:
            return
        self.release()
        self._poll.unregister(self._master)
        os.close(self._master)
        self._master = None
        self._avoid = self._name if renumber else ""
        if self.link.is_symlink() and str(self.link.readlink()) == self._name:
            self.link.unlink()

    def read(self, promised: int = 0) -> bytes:
        """Bytes written by programs, after the promised number has arrived or timed out."""
        data = b""
        while self._events(_PATIENCE_MS if len(data) < promised and self.is_open else 0) & select.POLLIN:
            data += os.read(self._file, _MOST_BYTES)
        return data

    def write(self, data: bytes) -> int:
        """Sends bytes to the program that has it open.

        Returns:
            Number of bytes that it can read now; the others are dropped and counted.
        """
        if not self.is_plugged:
            return 0
        try:
            written = os.write(self._file, data)
        except BlockingIOError:
            written = 0
        self.overrun += len(data) - written
        return written

    def steal(self, count: int) -> int:
        """Reads up to `count` bytes at the program's end, as a second program would; returns the number read."""
        other = self._open_other_end()
        try:
            return len(os.read(other, count))
        except BlockingIOError:
            return 0
        finally:
            os.close(other)

    def discard(self) -> None:
        """Discards what a program left unread when it closed the port."""
        if self._master is not None:
            while self.steal(_MOST_BYTES):
                pass

    def hold(self) -> None:
        """Opens and locks the program's end, as another program would, unless it is in use."""
        if self._holder is None and self.is_plugged:
            self._holder = self._open_other_end()
            with suppress(BlockingIOError):
                fcntl.flock(self._holder, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def release(self) -> None:
        """Releases the program's end."""
        if self._holder is not None:
            os.close(self._holder)
            self._holder = None

    @property
    def _file(self) -> int:
        return -1 if self._master is None else self._master

    def _open_other_end(self) -> int:
        return os.open(self._name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    def _events(self, patience_ms: int = 0) -> int:
        if self._master is None:
            return 0
        happened = self._poll.poll(patience_ms)
        return happened[0][1] if happened else 0


def _open_terminal(avoid: str) -> tuple[int, str]:
    """Device end of a new raw terminal, and the name of the program's end, different from `avoid`."""
    master, slave = os.openpty()
    try:
        tty.setraw(slave)  # by default it echoes and turns CR into LF
        name = os.ttyname(slave)
        if name != avoid:
            return master, name
        again = _open_terminal(avoid)
        os.close(master)
        return again
    finally:
        os.close(slave)
