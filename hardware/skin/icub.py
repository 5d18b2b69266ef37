"""Protocol of the iCub's skin: commands to CAN frames, CAN frames to half readings, halves to readings of 12 taxels.

An identifier holds class (3 bits), sender (4) and destination or message number (4) (`embot_prot_can.cpp`). No skin
command is acknowledged; only the version request is answered. The start sequence is board, triangles, start: the first
clears what the second enables, and the second stops the stream (`theSkin.cpp`).

Ticks are not numbered, and a busy board may send the tail first (mtb3 keeps its frames in a stack), so heads and tails
are matched by time only.
"""

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import NamedTuple

from .slcan import RemoteFrame, SlcanFrame

HEAD, TAIL = 0x40, 0xC0
"""First byte of a frame with taxels 0 to 6, and of one with 7 to 11 (`embot_prot_can_skin_periodic.cpp`)."""

SET_BOARD, SET_TRIANGLES, SET_TRANSMISSION, GET_VERSION = 0x4D, 0x50, 0x07, 0x1C
"""Commands (`iCubCanProto_analogSensorMessages.h`). 0x32 stores a new board address permanently; not supported here."""

LONGEST_PERIOD_MS = 209
"""Longest period of the 16-bit timer of the mtb3 board."""


class MessageClass(IntEnum):
    """Classes of identifiers (`iCubCanProto_classes.h`); old-style boards send skin data as class 3, new ones as 4."""

    COMMAND = 2
    OLD_DATA = 3
    DATA = 4


class TaxelError(IntFlag):
    """Error nibble: mtb4 sets bits; mtb3 sends one of the values 0, 1, 2, which read the same."""

    NO_ACK = 1
    NOT_CONNECTED = 2


class Address(NamedTuple):
    """Parts of an 11-bit identifier.

    Attributes:
        message_class: Class of the message, 0 to 7.
        sender: Board that sends it, 0 for the host.
        low: Destination of a command, or triangle of data.
    """

    message_class: int
    sender: int
    low: int


class Sensor(NamedTuple):
    """One triangle of 12 taxels, such as a fingertip.

    Attributes:
        board: Address of the board, 14 on both hands (skinGui's hand_V2_1.ini).
        triangle: 0 to 15; 0 to 4 are index, middle, ring and little finger, and thumb.
    """

    board: int
    triangle: int


@dataclass(frozen=True, slots=True)
class Head:
    """Taxels 0 to 6 of a sensor, one byte each, falling under load."""

    sensor: Sensor
    taxels: bytes


@dataclass(frozen=True, slots=True)
class Tail:
    """Taxels 7 to 11 of a sensor, one byte each, and diagnostics, which firmware before 2014 does not send.

    Attributes:
        sensor: The sensor.
        taxels: 5 bytes.
        out_of_range: Bit t is set if taxel t, of all 12, exceeds twice its limit; None if not sent.
        error: Error of the chip reported by the board; None if not sent.
    """

    sensor: Sensor
    taxels: bytes
    out_of_range: int | None = None
    error: TaxelError | None = None


@dataclass(frozen=True, slots=True)
class BoardVersion:
    """A board's answer to the version request.

    Attributes:
        board: Address of the board.
        board_type: 5 is mtb3, 11 is mtb4 (`iCubCanProto_types.h`).
        firmware: Version, revision and build.
        protocol: Major and minor number.
        compatible: Whether the board supports the requested protocol.
    """

    board: int
    board_type: int
    firmware: tuple[int, int, int]
    protocol: tuple[int, int]
    compatible: bool


@dataclass(frozen=True, slots=True)
class SkinReading:
    """All taxels of a sensor at one tick.

    Attributes:
        sensor: The sensor.
        taxels: 12 bytes.
        out_of_range: Bit t is set if taxel t is out of range; None if not sent.
        error: Error of the chip reported by the board; None if not sent.
        time_s: Time in seconds at which the head arrived.
    """

    sensor: Sensor
    taxels: bytes
    out_of_range: int | None
    error: TaxelError | None
    time_s: float


def identifier(address: Address) -> int:
    """11-bit identifier of an address."""
    return address.message_class << 8 | address.sender << 4 | address.low


def address(identifier: int) -> Address:
    """Parts of an 11-bit identifier."""
    return Address(identifier >> 8 & 7, identifier >> 4 & 15, identifier & 15)


def board_command(board: int, skin_type: int = 1, period_ms: int = 20, no_load: int = 240) -> SlcanFrame:
    """Command that configures a board and disables all its triangles; a running stream restarts at the new period.

    Args:
        board: Address of the board.
        skin_type: 1 is palm and fingertip, without drift compensation (`iCubCanProto_types.h`).
        period_ms: Time in milliseconds between two readings; 20 is the paper's 50 Hz.
        no_load: Reading of an untouched taxel after calibration; 240 is the host's default (SkinConfigReader.h).

    Raises:
        ValueError: An argument is out of range.
    """
    _check("period in ms", period_ms, 1, LONGEST_PERIOD_MS)
    _check("skin type", skin_type, 0, 255)
    _check("no-load value", no_load, 0, 255)
    return _command(board, SET_BOARD, skin_type, period_ms, no_load)


def triangles_command(
    board: int, first: int, last: int, *, enabled: bool = True, shift: int = 0, offset: int = 0x2200
) -> SlcanFrame:
    """Command that enables or disables triangles; the board stops the stream and calibrates, even under load.

    Args:
        board: Address of the board.
        first: First triangle.
        last: Last triangle, not before the first.
        enabled: Whether to read them.
        shift: Bits by which the board scales readings down; the host's default is 0 (SkinConfigReader.h).
        offset: Offset of the converter, 16 bits, sent low byte first; the host's default is 0x2200.

    Raises:
        ValueError: An argument is out of range.
    """
    _check("first triangle", first, 0, 15)
    _check("last triangle", last, first, 15)
    _check("shift", shift, 0, 255)
    _check("offset", offset, 0, 0xFFFF)
    return _command(board, SET_TRIANGLES, first, last, shift, int(enabled), offset & 0xFF, offset >> 8)


def start_command(board: int) -> SlcanFrame:
    """Command that starts the stream; an mtb3 may have started it by itself after its calibration."""
    return _command(board, SET_TRANSMISSION, 0)


def stop_command(board: int) -> SlcanFrame:
    """Command that stops the stream."""
    return _command(board, SET_TRANSMISSION, 1)


def version_command(board: int, major: int = 0, minor: int = 0) -> SlcanFrame:
    """Command that requests the firmware version for a protocol; some old firmware does not answer."""
    _check("protocol major", major, 0, 255)
    _check("protocol minor", minor, 0, 255)
    return _command(board, GET_VERSION, major, minor)


def _command(board: int, *data: int) -> SlcanFrame:
    _check("board", board, 1, 14)
    return SlcanFrame(identifier(Address(MessageClass.COMMAND, 0, board)), bytes(data))


def _check(name: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        raise ValueError(f"The {name} must be {low} to {high}, got {value}.")


def decode(frame: SlcanFrame | RemoteFrame) -> Head | Tail | BoardVersion | None:
    """Decoded frame, or None if it is not from a skin board."""
    if isinstance(frame, RemoteFrame) or frame.extended or not frame.data:
        return None
    message_class, sender, low = address(frame.identifier)
    if message_class in {MessageClass.DATA, MessageClass.OLD_DATA}:
        return _half(Sensor(sender, low), frame.data)
    if message_class == MessageClass.COMMAND and low == 0:
        return _version(sender, frame.data)
    return None


def _half(sensor: Sensor, data: bytes) -> Head | Tail | None:
    if data[0] == HEAD and len(data) == 8:
        return Head(sensor, data[1:])
    if data[0] == TAIL and len(data) == 8:
        return Tail(sensor, data[1:6], data[6] << 4 | data[7] >> 4, TaxelError(data[7] & 15))
    if data[0] == TAIL and 6 <= len(data) < 8:
        return Tail(sensor, data[1:6])
    return None


def _version(board: int, data: bytes) -> BoardVersion | None:
    if data[0] != GET_VERSION or len(data) != 8:
        return None
    return BoardVersion(board, data[1], (data[2], data[3], data[4]), (data[5], data[6]), data[7] != 0)


class Pairing:
    """Joins heads and tails of each sensor, in either order, if they arrive within a time window.

    At most one half per sensor waits, so at most 256. A half that the next one does not complete is lost. If a half is
    lost and the neighbours of the gap arrive within the window, halves of two ticks are joined: keep the window below
    half a period and, if the link delivers in bursts, use the adapter's time stamps.

    Args:
        window_s: Longest time in seconds between the halves of a reading.

    Attributes:
        lost_heads: Number of lost heads, that is, of unpaired tails.
        lost_tails: Number of lost tails, that is, of unpaired heads.
    """

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._waiting: dict[Sensor, tuple[Head | Tail, float]] = {}
        self.lost_heads = 0
        self.lost_tails = 0

    @property
    def waiting(self) -> int:
        """Number of halves waiting for the other one."""
        return len(self._waiting)

    def push(self, half: Head | Tail, time_s: float) -> SkinReading | None:
        """Reading that this half completes, or None."""
        if half.sensor in self._waiting:
            other, other_s = self._waiting.pop(half.sensor)
            if type(other) is not type(half) and abs(time_s - other_s) <= self._window_s:
                return _joined(half, time_s, other, other_s)
            self._lose(other)
        self._waiting[half.sensor] = half, time_s
        return None

    def clear(self) -> None:
        """Counts all waiting halves as unpaired, as when the stream stops."""
        for half, _ in self._waiting.values():
            self._lose(half)
        self._waiting.clear()

    def _lose(self, alone: Head | Tail) -> None:
        if isinstance(alone, Head):
            self.lost_tails += 1
        else:
            self.lost_heads += 1


def _joined(half: Head | Tail, time_s: float, other: Head | Tail, other_s: float) -> SkinReading:
    if isinstance(half, Head) and isinstance(other, Tail):
        return SkinReading(half.sensor, half.taxels + other.taxels, other.out_of_range, other.error, time_s)
    if isinstance(half, Tail) and isinstance(other, Head):
        return _joined(other, other_s, half, time_s)
    raise ValueError("A reading has one head and one tail.")
