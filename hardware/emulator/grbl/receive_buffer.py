"""Receive buffer of an emulated GRBL controller; yields lines without spaces and comments."""

_SKIPPED = frozenset(b"/") | frozenset(range(33))
"""Ignored: spaces, control characters and the block delete sign."""
LINE_BYTES = 79
"""Longest line accepted, in characters (protocol.h)."""


class ReceiveBuffer:
    """Bytes not read yet, and the line being read.

    Args:
        size: Capacity in bytes; excess bytes are lost silently.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._bytes = bytearray()
        self.clear()

    @property
    def room(self) -> int:
        """Free space in bytes."""
        return self._size - len(self._bytes)

    def put(self, byte: int) -> None:
        """Takes a byte, if there is room."""
        if self.room > 0:
            self._bytes.append(byte)

    def discard(self) -> None:
        """Discards unread bytes."""
        self._bytes.clear()

    def clear(self) -> None:
        """Discards everything, including the line being read."""
        self._bytes.clear()
        self._start_line()

    def line(self) -> str | None:
        """Next line in capitals, longer than `LINE_BYTES` if it was too long; None if none is complete yet."""
        for count, byte in enumerate(self._bytes, 1):
            if byte in b"\r\n":
                del self._bytes[:count]
                line = self._line.decode("ascii").upper()
                self._start_line()
                return line
            self._read(byte)
        self._bytes.clear()
        return None

    def _start_line(self) -> None:
        self._line = bytearray()
        self._comment = b""

    def _read(self, byte: int) -> None:
        if self._comment:
            if self._comment == b")" and byte == ord(")"):
                self._comment = b""
        elif byte in b"(;":
            self._comment = b")" if byte == ord("(") else b"\n"
        elif byte not in _SKIPPED and len(self._line) <= LINE_BYTES:
            self._line.append(byte)
