"""G-code of the emulated controller: lines, dwell, units, distance modes and jogs.

Order of checks and error numbers are those of GRBL's gcode.c. Arcs, probing, offsets, spindles and program flow are
not supported: their words give error 20.
"""

import math
import re
from typing import NamedTuple

_INCH_MM = 25.4
_WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))")
_GROUP = {4: 0, 53: 0, 0: 1, 1: 1, 17: 2, 90: 3, 91: 3, 94: 5, 20: 6, 21: 6, 40: 7, 49: 8, 54: 12, 61: 13}
"""Modal group of each G word; a line holds at most one word of a group."""
_M_GROUP = {3: -7, 4: -7, 5: -7, 7: -8, 8: -8, 9: -8}
_VALUES, _NEVER_NEGATIVE = frozenset("FIJKLNPRSTXYZ"), frozenset("FNPST")
_JOG_GROUPS = {0, 3, 6}


class LineRefused(Exception):
    """A line is refused.

    Attributes:
        code: Error number.
    """

    def __init__(self, code: int) -> None:
        super().__init__(f"error:{code}")
        self.code = code


class Modal(NamedTuple):
    """Modal state, which carries over from line to line.

    Attributes:
        motion: 0 or 1, as in the G word.
        absolute: Whether targets are positions rather than distances.
        inches: Whether lengths are inches.
        feed_mm_min: Speed of G1; 0 if not set.
    """

    motion: int = 0
    absolute: bool = True
    inches: bool = False
    feed_mm_min: float = 0.0


class Block(NamedTuple):
    """One line of G-code, lengths in mm.

    Attributes:
        modal: Modal state after it.
        axes: Value of each axis named, 0 to 2.
        absolute: Whether they are positions rather than distances.
        machine: Whether they are machine coordinates (G53).
        feed_mm_min: Speed; infinity for the fastest the axes allow.
        dwell_s: Waiting time after all motion, None for no dwell.
    """

    modal: Modal
    axes: dict[int, float]
    absolute: bool
    machine: bool
    feed_mm_min: float
    dwell_s: float | None


def parse(text: str, modal: Modal, *, jog: bool) -> Block:
    """Parses a line in capitals, without spaces and comments.

    Args:
        text: The line; for a jog, the part after `$J=`.
        modal: Modal state before it; a jog leaves it unchanged.
        jog: Whether it is a jog.

    Raises:
        LineRefused: The line is invalid.
    """
    codes, groups, values = _words(text)
    inches = 20 in codes or (modal.inches and 21 not in codes)
    absolute = 90 in codes or (modal.absolute and 91 not in codes)
    motion = 1 if jog or 1 in codes else 0 if 0 in codes else modal.motion
    unit = _INCH_MM if inches else 1.0
    if jog and "F" not in values:
        raise LineRefused(22)
    feed = values["F"] * unit if "F" in values else modal.feed_mm_min
    axes = {axis: values[name] * unit for axis, name in enumerate("XYZ") if name in values}
    dwell_s = values.get("P", None) if 4 in codes else None
    if 4 in codes and dwell_s is None:
        raise LineRefused(28)
    if motion == 1 and (axes or 1 in groups or jog):
        _check_line(feed, axes)
    used = set("FNXYZ") | (set() if jog else set("ST")) | (set("P") if 4 in codes else set())
    if set(values) - used:
        raise LineRefused(36)
    if jog and (groups - _JOG_GROUPS or 4 in codes):
        raise LineRefused(16)
    after = modal if jog else Modal(motion, absolute, inches, feed)
    return Block(after, axes, absolute, 53 in codes, feed if motion == 1 else math.inf, dwell_s)


def _check_line(feed: float, axes: dict[int, float]) -> None:
    if feed == 0.0:
        raise LineRefused(22)
    if not axes:
        raise LineRefused(26)


def _words(text: str) -> tuple[set[int], set[int], dict[str, float]]:
    """Numbers of the G words, groups of the G and M words, and values of the others."""
    codes: set[int] = set()
    groups: set[int] = set()
    values: dict[str, float] = {}
    at = 0
    while at < len(text):
        if not "A" <= text[at] <= "Z":
            raise LineRefused(1)
        match = _WORD.match(text, at)
        if match is None:
            raise LineRefused(2)
        letter, number = match[1], float(match[2])
        at = match.end()
        if letter in "GM":
            group = _group(letter, number)
            if group in groups:
                raise LineRefused(21)
            groups.add(group)
            codes |= {int(number)} if letter == "G" else set()
        else:
            _check_value(letter, number, values)
            values[letter] = number
    return codes, groups, values


def _group(letter: str, number: float) -> int:
    known = _GROUP if letter == "G" else _M_GROUP
    if int(number) not in known:
        raise LineRefused(20)
    if number != int(number):
        raise LineRefused(23)
    return known[int(number)]


def _check_value(letter: str, number: float, values: dict[str, float]) -> None:
    if letter not in _VALUES:
        raise LineRefused(20)
    if letter in values:
        raise LineRefused(25)
    if number < 0 and letter in _NEVER_NEGATIVE:
        raise LineRefused(4)
