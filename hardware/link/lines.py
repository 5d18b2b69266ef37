"""Cuts a stream of bytes into lines; what is incomplete waits, what is too long is dropped and counted.

Nothing here or in the decoders on top reads a port: bytes are pushed in, complete units come out.
"""

import re
from dataclasses import dataclass
from typing import NamedTuple


class Line(NamedTuple):
    """What stood before a terminator.

    Attributes:
        text: The bytes without the terminator, or None if they were too many and are gone.
        end: The terminator, one byte.
    """

    text: bytes | None
    end: bytes


@dataclass
class Dropped:
    """What a decoder threw away so far.

    Attributes:
        overlong: Lines longer than any the device sends.
        malformed: Lines that are no unit of the protocol.
        byte_count: Bytes of both, without terminators.
    """

    overlong: int = 0
    malformed: int = 0
    byte_count: int = 0

    @property
    def line_count(self) -> int:
        """Lines of both."""
        return self.overlong + self.malformed

    def malform(self, text: bytes) -> None:
        """Counts a line that is no unit."""
        self.malformed += 1
        self.byte_count += len(text)


class LineSplitter:
    """Returns complete lines and keeps the rest, at most `longest` bytes of it.

    However a stream is cut into pushes, the lines are the same.

    Args:
        terminators: Bytes that each end a line.
        longest: Bytes of the longest line kept, without its terminator.

    Attributes:
        dropped: What was thrown away; the decoder on top adds to it.
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
