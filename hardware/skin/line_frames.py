r"""Decoder for the lines `t_ms,v0,...,v(K-1)` of a simple sensor; see docs/how-to/line-sensor.md.

A line ends with `\n` or `\r\n`. It is a comment if it starts with `#`, a reading if it is a time and exactly K finite
numbers, and else is dropped. What stands before the first line end may be half a reading and is not believed.
"""

import math
import re
from dataclasses import dataclass

from ..link.lines import LineSplitter

CLOCK_MS = 1 << 32
"""The sensor's time counts milliseconds and starts again at this number, as Arduino's `millis` does."""

_TIME = re.compile(rb"[0-9]{1,10}")
_NUMBER = re.compile(rb"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_LONGEST_NUMBER = 24
_LONGEST_COMMENT = 200


@dataclass(frozen=True, slots=True)
class LineReading:
    """One reading.

    Attributes:
        t_ms: The sensor's time in milliseconds, below `CLOCK_MS`.
        values: K numbers.
    """

    t_ms: int
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Comment:
    """A comment line of the sensor, without the `#`."""

    text: str


class LineDecoder:
    """Turns bytes into readings and comments, and keeps the rest for the next push.

    No bytes raise an exception, and a bounded number of them is kept.

    Args:
        taxels: `K`.

    Attributes:
        lines: What waits for its line end, and what was thrown away as neither reading nor comment.
        other_size: Values in the last line that had too many or too few, None if there was none.
    """

    def __init__(self, taxels: int) -> None:
        self.other_size: int | None = None
        self._taxels = taxels
        self.lines = LineSplitter(b"\n", longest_line(taxels))
        self._begun = False

    def push(self, data: bytes) -> list[LineReading | Comment]:
        """Readings and comments that these bytes complete."""
        units: list[LineReading | Comment] = []
        for text, _ in self.lines.push(data):
            begun, self._begun = self._begun, True
            line = (text or b"").removesuffix(b"\r")
            if not line or not (begun or line.startswith(b"#")):
                continue
            unit = self._unit(line)
            self.lines.dropped.malform(line) if unit is None else units.append(unit)
        return units

    def _unit(self, line: bytes) -> LineReading | Comment | None:
        if line.startswith(b"#"):
            return Comment(line[1:].strip().decode("ascii", "replace"))
        time, *numbers = line.split(b",")
        if not _TIME.fullmatch(time) or int(time) >= CLOCK_MS or not all(map(_NUMBER.fullmatch, numbers)):
            return None
        if len(numbers) != self._taxels:
            self.other_size = len(numbers)
            return None
        values = tuple(map(float, numbers))
        return LineReading(int(time), values) if all(map(math.isfinite, values)) else None


def longest_line(taxels: int) -> int:
    """Bytes kept of a line of a sensor with so many taxels."""
    return max(_LONGEST_COMMENT, 16 + (_LONGEST_NUMBER + 1) * taxels)
