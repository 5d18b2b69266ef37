"""Splits a byte stream into lines; keeps incomplete ones, drops and counts overlong ones.

Nothing here or in the decoders on top reads a port: bytes are pushed in, complete units come out.
"""

import re
from dataclasses import dataclass
from typing import NamedTuple


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
