r"""SLCAN, the ASCII protocol of serial CAN adapters: decoder and commands.

Separator rule: a carriage return ends a unit; a bell is a unit of its own, the adapter's error answer, and whatever
stands before it is dropped. So damage reaches no further than the next `\r` or `\a`. A line feed left over from a
firmware that ends lines with CRLF is skipped at the start of a line (can-utils issue 324).

Units and commands follow the command list of canable2-fw; the strictness follows the receiver of the Linux kernel
(`slcan-core.c`): length digit 0 to 8, nothing but hex digits, no unit longer than its buffer. Beyond the kernel, the
number of data digits must fit the length digit and the identifier its 11 or 29 bits. A flipped bit that turns one hex
digit into another cannot be seen.
"""

import re
from dataclasses import dataclass
from enum import IntFlag
from typing import Literal

from ..link.port import LineSplitter

LONGEST_LINE = 96
"""Longest line in bytes: a frame takes 30; stock CANable firmware answers `V` with longer free text."""

LAST_STAMP_MS = 60000
"""Time stamps count milliseconds and wrap around at this number (canable2-fw, command Z)."""

OPEN = b"O\r"
CLOSE = b"C\r"
"""Sent first, whatever the answer, as another program may have left the adapter open (Linux does the same)."""
END_LINE = b"\r"
"""Ends an incomplete command that the adapter may still hold."""
VERSION = b"V\r"
STAMPS_OFF = b"Z0\r"

BIT_RATES_KBIT = {10: 0, 20: 1, 50: 2, 100: 3, 125: 4, 250: 5, 500: 6, 1000: 8}
"""Bit rate to digit of the command S. S7 is missing: 800 kbit/s in Linux and canable2-fw, 750 in canable-fw."""


class Flags(IntFlag):
    """Bits of the answer to `F` as canable2-fw defines them; other firmware may differ."""

    TRANSMIT_OVERFLOW = 1
    RECEIVE_OVERFLOW = 2
    ERROR_WARNING = 4
    FRAME_LOST = 8
    ERROR_PASSIVE = 32
    BUS_ERROR = 128


@dataclass(frozen=True, slots=True)
class SlcanFrame:
    """A CAN data frame.

    Attributes:
        identifier: 11 bits, or 29 if extended.
        data: At most 8 bytes.
        extended: Whether the identifier has 29 bits.
        stamp_ms: The adapter's time in milliseconds, from 0 to 60000, if it sends one.
    """

    identifier: int
    data: bytes
    extended: bool = False
    stamp_ms: int | None = None


@dataclass(frozen=True, slots=True)
class RemoteFrame:
    """A CAN remote frame: a length, but no data (canable2-fw).

    Attributes:
        identifier: 11 bits, or 29 if extended.
        length: Bytes asked for, 0 to 8.
        extended: Whether the identifier has 29 bits.
        stamp_ms: The adapter's time in milliseconds, if it sends one.
    """

    identifier: int
    length: int
    extended: bool = False
    stamp_ms: int | None = None


@dataclass(frozen=True, slots=True)
class Done:
    """The adapter accepted a command.

    Attributes:
        mark: Empty, or `z` or `Z` after a standard or extended frame to transmit.
    """

    mark: str = ""


@dataclass(frozen=True, slots=True)
class Bell:
    """The adapter refused a command: a bell, which no carriage return follows."""


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to `V` or `N`.

    Attributes:
        command: `V` for the version or `N` for the serial number.
        text: What follows the letter.
    """

    command: str
    text: str


@dataclass(frozen=True, slots=True)
class StatusFlags:
    """The answer to `F`.

    Attributes:
        flags: Errors since the last request.
    """

    flags: Flags


@dataclass(frozen=True, slots=True)
class Remark:
    """Readable text outside the protocol, such as the version of stock CANable firmware, which lacks the letter V.

    Attributes:
        text: The line.
    """

    text: str


Unit = SlcanFrame | RemoteFrame | Done | Bell | Reply | StatusFlags | Remark
Stamps = Literal["either", "never", "always"]

_FRAME = re.compile(rb"(?:([tr])([0-7][0-9A-Fa-f]{2})|([TR])([01][0-9A-Fa-f]{7}))([0-8])([0-9A-Fa-f]*)")
_REPLY = re.compile(rb"([VN])([ -~]+)")
_FLAGS = re.compile(rb"F([0-9A-Fa-f]{2})")
_REMARK = re.compile(rb"(?![tTrRzZVNF])(?=.*[^0-9A-Fa-f])[ -~]+")
"""Excludes the rest of a frame that lost its first letter, which is all hex digits."""


class SlcanDecoder:
    """Decodes bytes of an adapter into units, and keeps the rest for the next push.

    Accepts any bytes without raising, and keeps at most `LONGEST_LINE` of them.

    Args:
        stamps: Whether frames end in a time stamp. "either" accepts both and so cannot tell a stamp from two data
            bytes too many; a driver that has set `Z0` or `Z1` should say so here.

    Attributes:
        lines: Pending bytes, and counts of what was dropped.
    """

    def __init__(self, stamps: Stamps = "either") -> None:
        self.lines = LineSplitter(b"\r\a", LONGEST_LINE)
        self._stamp_digits = {"either": (0, 4), "never": (0,), "always": (4,)}[stamps]

    def push(self, data: bytes) -> list[Unit]:
        """Units that these bytes complete."""
        units: list[Unit] = []
        for text, end in self.lines.push(data):
            if end == b"\a":
                self._drop(text)
                units.append(Bell())
            elif text is not None:
                unit = self._unit(text.removeprefix(b"\n"))
                self._drop(text) if unit is None else units.append(unit)
        return units

    def _drop(self, text: bytes | None) -> None:
        if text and text != b"\n":
            self.lines.dropped.malform(text)

    def _unit(self, text: bytes) -> Unit | None:
        if text in {b"", b"z", b"Z"}:
            return Done(text.decode("ascii"))
        if match := _FRAME.fullmatch(text):
            return self._frame(match)
        if match := _FLAGS.fullmatch(text):
            return StatusFlags(Flags(int(match[1], 16)))
        if match := _REPLY.fullmatch(text):
            return Reply(match[1].decode("ascii"), match[2].decode("ascii"))
        return Remark(text.decode("ascii")) if _REMARK.fullmatch(text) else None

    def _frame(self, match: re.Match[bytes]) -> SlcanFrame | RemoteFrame | None:
        kind, identifier = match[1] or match[3], int(match[2] or match[4], 16)
        length, rest = int(match[5]), match[6]
        remote = kind in b"rR"
        digits = 0 if remote else 2 * length
        if len(rest) - digits not in self._stamp_digits:
            return None
        stamp_ms = int(rest[digits:], 16) if rest[digits:] else None
        if stamp_ms is not None and stamp_ms > LAST_STAMP_MS:
            return None
        if remote:
            return RemoteFrame(identifier, length, kind == b"R", stamp_ms)
        return SlcanFrame(identifier, bytes.fromhex(rest[:digits].decode("ascii")), kind == b"T", stamp_ms)


def bit_rate(kbit: int) -> bytes:
    """Command that sets the bit rate, which the adapter accepts only while closed.

    Args:
        kbit: Bit rate in kbit/s, one of `BIT_RATES_KBIT`; the iCub's bus has 1000 (CanBusSkin.cpp).

    Raises:
        ValueError: The rate is not supported.
    """
    if kbit not in BIT_RATES_KBIT:
        raise ValueError(f"The SLCAN bit rate must be one of {sorted(BIT_RATES_KBIT)} kbit/s, got {kbit}.")
    return b"S%d\r" % BIT_RATES_KBIT[kbit]


def transmit(frame: SlcanFrame | RemoteFrame) -> bytes:
    """Command that sends a frame, without its time stamp.

    Raises:
        ValueError: The identifier has too many bits or the data too many bytes.
    """
    remote = isinstance(frame, RemoteFrame)
    length = frame.length if remote else len(frame.data)
    digits = 8 if frame.extended else 3
    if not 0 <= frame.identifier < (1 << (29 if frame.extended else 11)):
        raise ValueError(f"Identifier {frame.identifier:#x} does not fit a CAN frame with extended={frame.extended}.")
    if not 0 <= length <= 8:
        raise ValueError(f"A CAN frame has 0 to 8 bytes, got {length}.")
    letter = "r" if remote else "t"
    letter = letter.upper() if frame.extended else letter
    data = "" if remote else frame.data.hex().upper()
    return f"{letter}{frame.identifier:0{digits}X}{length}{data}\r".encode("ascii")
