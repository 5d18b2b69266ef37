"""G-code of the emulated controller: lines, dwell, units, distance modes and jogs.

Order of checks and error numbers are those of GRBL's gcode.c, including what a damaged line does: a number is cut to
eight digits, the number of a G word to one byte, and a jog without axis words goes to machine zero. Arcs, probing,
offsets, spindles and program flow are recognised as far as a jog with them is refused; otherwise they give error 20.
"""

import math
import re
from typing import NamedTuple

_INCH_MM = 25.4
_WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))")
_GROUP = (
    dict.fromkeys((4, 10, 28, 30, 53, 92), 0)
    | dict.fromkeys((0, 1, 2, 3, 80), 1)
    | dict.fromkeys((17, 18, 19), 2)
    | dict.fromkeys((90, 91), 3)
    | dict.fromkeys((93, 94), 5)
    | dict.fromkeys((20, 21), 6)
    | {40: 7, 49: 8, 61: 13}
    | dict.fromkeys(range(54, 60), 12)
)
"""Modal group of each G word; a line holds at most one word of a group."""
_OWN_AXES, _MOTIONS, _ARCS, _NO_MOTION = {10, 28, 30, 92}, {0, 1, 2, 3}, {2, 3}, 80
_NOT_EMULATED = {2, 3, 10, 18, 19, 28, 30, 55, 56, 57, 58, 59, 92, 93}
_M_GROUP = {0: -4, 1: -4, 2: -4, 30: -4, 3: -7, 4: -7, 5: -7, 7: -8, 8: -8, 9: -8}
_VALUES, _NEVER_NEGATIVE = frozenset("FIJKLNPRSTXYZ"), frozenset("FNPST")
_JOG_GROUPS = {0, 3, 6}
_FLOW, _ENDS = -4, {2, 30}
_DIGITS, _LAST_LINE, _LAST_TOOL = 8, 10_000_000, 255


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
        motion: 0, 1 or, with motion words cancelled, 80, as in the G word.
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
        ends: Whether it ends the program.
    """

    modal: Modal
    axes: dict[int, float]
    absolute: bool
    machine: bool
    feed_mm_min: float
    dwell_s: float | None
    ends: bool = False


def parse(text: str, modal: Modal, *, jog: bool) -> Block:
    """Parses a line in capitals, without spaces and comments.

    Args:
        text: The line; for a jog, the part after `$J=`.
        modal: Modal state before it; a jog leaves it unchanged.
        jog: Whether it is a jog.

    Raises:
        LineRefused: The line is invalid.
    """
    codes, groups, values, flow = _words(text)
    inches = 20 in codes or (modal.inches and 21 not in codes)
    absolute = 90 in codes or (modal.absolute and 91 not in codes)
    motion = next(iter(codes & {*_MOTIONS, _NO_MOTION}), 1 if jog else modal.motion)
    unit = _INCH_MM if inches else 1.0
    axes = {axis: values[name] * unit for axis, name in enumerate("XYZ") if name in values}
    if values.get("N", 0.0) >= _LAST_LINE + 1:
        raise LineRefused(27)
    if jog and "F" not in values:
        raise LineRefused(22)
    feed = values["F"] * unit if "F" in values else modal.feed_mm_min
    dwell_s = values.get("P", None) if 4 in codes else None
    if 4 in codes and dwell_s is None:
        raise LineRefused(28)
    if codes & {10, 92} and not axes:
        raise LineRefused(26)
    moves = bool(codes & _MOTIONS) or (bool(axes) and not codes & _OWN_AXES)
    _check_motion(codes, motion if moves or motion == _NO_MOTION else None, feed, axes, values)
    used = set("FN") | (set() if jog else set("ST")) | (set("P") if 4 in codes else set())
    used |= set("IJKR") if motion in _ARCS else set()
    if set(values) - used - (set("XYZ") if moves or codes & _OWN_AXES else set()):
        raise LineRefused(36)
    if jog and (groups - _JOG_GROUPS or 4 in codes or codes & _OWN_AXES):
        raise LineRefused(16)
    if codes & _NOT_EMULATED or flow - _ENDS:
        raise LineRefused(20)
    after = modal if jog else Modal(1, True, inches, feed) if flow else Modal(motion, absolute, inches, feed)
    if jog and not axes:  # measured on GRBL 1.1h
        return Block(after, dict.fromkeys(range(3), 0.0), True, True, feed, None)
    return Block(after, axes, absolute, 53 in codes, feed if motion == 1 else math.inf, dwell_s, bool(flow))


def _check_motion(
    codes: set[int], motion: int | None, feed: float, axes: dict[int, float], values: dict[str, float]
) -> None:
    """Checks a motion, None for a line without one."""
    if 53 in codes and motion not in {None, 0, 1}:
        raise LineRefused(30)
    if motion == _NO_MOTION and axes:
        raise LineRefused(31)
    if motion in {1, *_ARCS} and feed == 0.0:
        raise LineRefused(22)
    if motion not in _ARCS:
        return
    if not axes:
        raise LineRefused(26)
    if not axes.keys() & {0, 1}:
        raise LineRefused(32)
    if not values.keys() & set("RIJ"):
        raise LineRefused(35)


def _words(text: str) -> tuple[set[int], set[int], dict[str, float], set[int]]:
    """Numbers of the G words, groups of the G and M words, values of the others, and M words of program flow."""
    codes: set[int] = set()
    groups: set[int] = set()
    values: dict[str, float] = {}
    flow: set[int] = set()
    at = 0
    while at < len(text):
        if not "A" <= text[at] <= "Z":
            raise LineRefused(1)
        match = _WORD.match(text, at)
        if match is None:
            raise LineRefused(2)
        letter, number = match[1], _number(match[2])
        at = match.end()
        if letter in "GM":
            code = math.trunc(number) % 256
            group = _group(letter, code, number)
            if letter == "G" and codes & (_OWN_AXES | _MOTIONS) and code in _OWN_AXES | _MOTIONS:
                raise LineRefused(24)
            if group in groups:
                raise LineRefused(21)
            groups.add(group)
            codes |= {code} if letter == "G" else set()
            flow |= {code} if group == _FLOW else set()
        else:
            _check_value(letter, number, values)
            values[letter] = number
    return codes, groups, values, flow


def _number(text: str) -> float:
    """Value of a number, of whose digits only the first eight count (nuts_bolts.c)."""
    digits, kept = 0, ""
    whole, dot, fraction = text.partition(".")
    for character in whole + dot + fraction[: max(0, _DIGITS - len(whole.lstrip("+-")))]:
        digits += character.isdigit()
        kept += "0" if digits > _DIGITS and character.isdigit() else character
    return float(kept)


def _group(letter: str, code: int, number: float) -> int:
    known = _GROUP if letter == "G" else _M_GROUP
    if code not in known and (letter == "G" or number == code):
        raise LineRefused(20)
    if round(100 * (number - code)) % 65536:
        raise LineRefused(20 if code in {28, 30, 49, 61, 90, 92} else 23)
    return known[code]


def _check_value(letter: str, number: float, values: dict[str, float]) -> None:
    if letter not in _VALUES:
        raise LineRefused(20)
    if letter == "T" and number > _LAST_TOOL:
        raise LineRefused(38)
    if letter in values:
        raise LineRefused(25)
    if number < 0 and letter in _NEVER_NEGATIVE:
        raise LineRefused(4)
