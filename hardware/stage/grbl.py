"""Protocol of GRBL 1.1 and grblHAL: decoder and commands.

Separator rule: a carriage return or a line feed ends a line, and empty lines are ignored; so damage affects only the
lines that it touches. A line is a unit only if all of it has the form of one: a status report interrupted by another
message, or two answers that lost the line end between them, give `Unknown`. Lines with unprintable bytes, and overlong
lines, are dropped and counted. A flipped bit that turns one digit into another cannot be detected.

`Ok` and `Error` answer one command line each; everything else is unsolicited or additional (GRBL's interface.md).
Commands end in one line feed: with CRLF the empty second line would be answered too (protocol.c).
"""

import math
import re
from dataclasses import dataclass
from enum import StrEnum

from ..link.port import LineSplitter

LONGEST_LINE = 256
"""Longest line kept, in bytes; a status report with every field takes about half."""

LONGEST_COMMAND = 79
"""Longest command in bytes, by GRBL's line buffer (protocol.h)."""

STATUS = b"?"
"""Real-time command: needs no line end, is never answered by `ok`, and works in the middle of a line."""
RESET = b"\x18"
"""Real-time; in motion it loses the position (ALARM:3). Ignore everything up to the banner."""
JOG_CANCEL = b"\x85"
"""Real-time; ignored unless jogging."""
HOLD = b"!"
"""Real-time; brakes a motion that is not a jog."""

HOME = b"$H\n"
"""Answered after homing, which may take minutes; no status meanwhile."""
SETTINGS = b"$$\n"
"""Refused (error 8) while moving, except in a jog. It also completes what another line left incomplete: one lost,
added or flipped byte makes nothing of it that moves, while one bit turns `$I` into homing."""
NO_MOTION = b"G80G21\n"
"""Cancels G-code's motion mode, so that the rest of a jog that a line end has cut is refused (error 31) instead of a
rapid move, and sets millimetres, so that no jog needs a units word, which one flipped bit would turn into inches."""
PARSER_STATE = b"$G\n"

ERRORS = {
    1: "a word does not start with a letter",
    2: "a number is missing or malformed",
    3: "unknown $ command",
    5: "homing is switched off ($22)",
    8: "the command needs the controller idle",
    9: "commands are locked out during alarm or jog",
    10: "soft limits need homing ($22)",
    11: "the line is too long",
    15: "the jog would leave the travel",
    16: "the jog command is malformed",
    20: "the command is not supported",
    22: "the feed rate is missing",
    31: "motion is cancelled (G80)",
}
"""Descriptions of the errors that a stage may give (error_codes_en_US.csv)."""

ALARMS = {
    1: "a limit switch was hit",
    2: "the move would leave the travel",
    3: "reset while moving",
    4: "the probe was not in its starting state",
    5: "the probe found nothing",
    6: "reset while homing",
    7: "a door was opened while homing",
    8: "homing could not leave the switch",
    9: "homing found no switch",
    10: "homing failed on one of two motors of an axis",
    11: "homing is required (grblHAL)",
}
"""Descriptions of the alarms (alarm_codes_en_US.csv, grblHAL's alarms.h)."""

POSITION_LOST = frozenset({1, 3, 6, 7, 8, 9})
"""Alarms after which the position is unknown."""


class State(StrEnum):
    """States of a status report (report.c)."""

    IDLE = "Idle"
    RUN = "Run"
    HOLD = "Hold"
    JOG = "Jog"
    ALARM = "Alarm"
    DOOR = "Door"
    CHECK = "Check"
    HOME = "Home"
    SLEEP = "Sleep"


Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Ok:
    """A line was accepted; a move is then queued, not done."""


@dataclass(frozen=True, slots=True)
class Error:
    """A line was refused for the reason `ERRORS[code]`."""

    code: int


@dataclass(frozen=True, slots=True)
class Alarm:
    """The controller stopped for the reason `ALARMS[code]`."""

    code: int


@dataclass(frozen=True, slots=True)
class Banner:
    """Welcome message after power-up and every reset; only its start is checked, so that no reset is missed.

    Attributes:
        firmware: `Grbl` or `GrblHAL`; grblHAL may call itself either.
        version: Version, such as `1.1h`.
    """

    firmware: str
    version: str


@dataclass(frozen=True, slots=True)
class GrblSetting:
    """A line of the answer to `$$` whose value is a number."""

    number: int
    value: float


@dataclass(frozen=True, slots=True)
class Feedback:
    """A message in brackets, such as `[MSG:Caution: Unlocked]`, `[GC:...]` or `[VER:...]`.

    Attributes:
        kind: Text before the first colon.
        text: Text after it.
    """

    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class StartupLine:
    """A stored line that ran at start, with its result, which answers no command."""

    line: str
    result: str


@dataclass(frozen=True, slots=True)
class StatusReport:
    """A status report; lengths are in millimetres unless setting 13 is 1, then in inches.

    Attributes:
        state: State of the controller.
        substate: Number after the state, if any.
        machine: Machine position (MPos), if reported.
        work: Work position (WPos), if reported instead; the machine position minus the offset.
        offset: Work offset (WCO), which only some reports contain.
        other: Remaining fields and their text, in the order of the report.
    """

    state: State
    substate: int | None = None
    machine: Vector | None = None
    work: Vector | None = None
    offset: Vector | None = None
    other: tuple[tuple[str, str], ...] = ()

    def field(self, name: str) -> str | None:
        """Text of another field such as FS, Pn, Ov or Bf, if reported."""
        return dict(self.other).get(name)


@dataclass(frozen=True, slots=True)
class Unknown:
    """A readable line of unknown form."""

    text: str


Unit = Ok | Error | Alarm | Banner | GrblSetting | Feedback | StartupLine | StatusReport | Unknown

_NUMBER = r"-?\d{1,6}\.\d{3,4}"
_VECTOR = re.compile(rf"{_NUMBER},{_NUMBER},{_NUMBER}")
"""Always three axes, with 3 decimals in millimetres or 4 in inches (report.c)."""
_STATUS = re.compile(rf"<({'|'.join(State)})(?::(\d{{1,3}}))?\|([^<>]+)>")
_FIELD = re.compile(r"([A-Za-z]+):([^|:]*(?::[^|:]*)*)")
_PRINTABLE = re.compile(rb"[ -~]+")


class GrblDecoder:
    """Decodes bytes of a controller into units, and keeps the rest for the next push.

    Accepts any bytes without raising, and keeps at most `LONGEST_LINE` of them.

    Attributes:
        lines: Pending bytes, and counts of what was dropped.
    """

    def __init__(self) -> None:
        self.lines = LineSplitter(b"\r\n", LONGEST_LINE)

    def push(self, data: bytes) -> list[Unit]:
        """Units that these bytes complete."""
        units: list[Unit] = []
        for text, _ in self.lines.push(data):
            if text and _PRINTABLE.fullmatch(text):
                units.append(_unit(text.decode("ascii")))
            elif text:
                self.lines.dropped.malform(text)
        return units


def _unit(text: str) -> Unit:
    for form, build in _FORMS:
        if match := form.fullmatch(text):
            return build(match) or Unknown(text)
    return Unknown(text)


def _status(match: re.Match[str]) -> StatusReport | None:
    """Report with one position and no repeated field, which would show an interrupted one; fields in any order."""
    found = [_FIELD.fullmatch(text) for text in match[3].split("|")]
    fields = {field[1]: field[2] for field in found if field}
    vectors = {name: _vector(fields.pop(name)) for name in ("MPos", "WPos", "WCO") if name in fields}
    complete = len(fields) + len(vectors) == len(found)
    if not complete or ("MPos" in vectors) == ("WPos" in vectors) or None in vectors.values():
        return None
    substate = int(match[2]) if match[2] else None
    machine, work, offset = (vectors.get(name) for name in ("MPos", "WPos", "WCO"))
    return StatusReport(State(match[1]), substate, machine, work, offset, tuple(fields.items()))


def _vector(text: str) -> Vector | None:
    if not _VECTOR.fullmatch(text):
        return None
    x, y, z = map(float, text.split(","))
    return x, y, z


_FORMS = (
    (re.compile(r"ok"), lambda _: Ok()),
    (re.compile(r"error:(\d{1,3})"), lambda match: Error(int(match[1]))),
    (re.compile(r"ALARM:(\d{1,3})"), lambda match: Alarm(int(match[1]))),
    (re.compile(r"\$(\d{1,4})=(-?\d+(?:\.\d+)?)"), lambda match: GrblSetting(int(match[1]), float(match[2]))),
    (re.compile(r"\[([A-Za-z0-9.]+):([^\[\]]*)\]"), lambda match: Feedback(match[1], match[2])),
    (re.compile(r"(Grbl(?:HAL)?)\s+(\S+)(?:\s.*)?"), lambda match: Banner(match[1], match[2])),
    (re.compile(r">(.*):(ok|error:\d{1,3})"), lambda match: StartupLine(match[1], match[2])),
    (_STATUS, _status),
)


def jog(feed_mm_min: float, to_mm: Vector, *, relative: bool = False) -> bytes:
    """Command of a jog, which keeps the modal state and, beyond soft limits, is refused (error 15) without an alarm.

    It names all three axes, so that a damaged letter repeats another, and its feed last, so that a lost end has none.
    Lengths have 4 decimals, so that a lost point exceeds the travel; a step of the default configuration is 0.004 mm.
    Units are the modal ones, see `NO_MOTION`.

    Args:
        feed_mm_min: Speed in mm/min.
        to_mm: Target in machine coordinates in mm, or distances if relative.
        relative: Whether targets are distances; never resend such a command blindly.

    Raises:
        ValueError: A number is not finite, the feed rounds to 0, or the line is too long.
    """
    if not all(map(math.isfinite, to_mm)):
        raise ValueError(f"A jog needs finite targets, got {to_mm}.")
    if not (math.isfinite(feed_mm_min) and feed_mm_min >= 0.001):
        raise ValueError(f"A jog needs a feed of at least 0.001 mm/min, got {feed_mm_min}.")
    words = "".join(f"{name}{mm:z.4f}" for name, mm in zip("XYZ", to_mm, strict=True))
    feed = f"{feed_mm_min:.3f}".rstrip("0").rstrip(".")
    line = f"$J={'G91' if relative else 'G53'}{words}F{feed}"
    if len(line) > LONGEST_COMMAND:
        raise ValueError(f"A command has at most {LONGEST_COMMAND} characters, got {len(line)}: {line[:40]}...")
    return line.encode("ascii") + b"\n"
