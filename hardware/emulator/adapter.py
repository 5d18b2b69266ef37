"""An emulated SLCAN adapter between a serial port and the bus of a skin board.

It answers as github.com/Nakakiyo092/canable2-fw does: a carriage return for a command that it obeys, a bell for any
other and for one in the wrong state. With the fault `no_acks` it is like github.com/normaldotcom/canable-fw, which
knows fewer commands and answers only `V`.
"""

import math
import re
from enum import Enum
from typing import NamedTuple

from .faults import Switches
from .sensor_faults import LostReadings
from .skin_board import CanFrame, Halves, SkinBoard

_DONE, _REFUSED = b"\r", b"\a"
_LONGEST_COMMAND = 32
_MOST_OUTPUT = 65536
_STAMPS_MS = 60000


class _Mode(Enum):
    CLOSED = 0
    NORMAL = 1
    LISTENING = 2


_CLOSED = frozenset({_Mode.CLOSED})
_OPEN = frozenset({_Mode.NORMAL, _Mode.LISTENING})
_ANY = _CLOSED | _OPEN


class _Command(NamedTuple):
    argument: re.Pattern[bytes]
    modes: frozenset[_Mode]


def _command(argument: bytes, modes: frozenset[_Mode]) -> _Command:
    return _Command(re.compile(argument), modes)


_BYTES = b"(?:" + b"|".join(b"%d(?:[0-9A-Fa-f]{2}){%d}" % (length, length) for length in range(9)) + b")"
_STANDARD, _EXTENDED = b"[0-7][0-9A-Fa-f]{2}", b"[01][0-9A-Fa-f]{7}"
_COMMANDS = {
    b"": _command(b"", _ANY),
    b"S": _command(b"[0-8]", _CLOSED),
    b"O": _command(b"", _CLOSED),
    b"L": _command(b"", _CLOSED),
    b"C": _command(b"", _OPEN),
    b"t": _command(_STANDARD + _BYTES, frozenset({_Mode.NORMAL})),
    b"T": _command(_EXTENDED + _BYTES, frozenset({_Mode.NORMAL})),
    b"r": _command(_STANDARD + b"[0-8]", frozenset({_Mode.NORMAL})),
    b"R": _command(_EXTENDED + b"[0-8]", frozenset({_Mode.NORMAL})),
    b"F": _command(b"", _OPEN),
    b"V": _command(b"", _ANY),
    b"N": _command(b"", _ANY),
    b"Z": _command(b"[01]", _CLOSED),
    b"M": _command(b"[0-9A-Fa-f]{8}", _CLOSED),
    b"m": _command(b"[0-9A-Fa-f]{8}", _CLOSED),
}
_MODES = {b"O": _Mode.NORMAL, b"L": _Mode.LISTENING, b"C": _Mode.CLOSED}
_ANSWERS = {b"V": b"V1013\r", b"N": b"NA123\r", b"F": b"F00\r", b"t": b"z\r", b"r": b"z\r", b"T": b"Z\r", b"R": b"Z\r"}
_WITHOUT_ACKS = frozenset({b"S", b"O", b"C", b"t", b"T", b"r", b"R", b"V"})
_VERSION_WITHOUT_ACKS = b"b158aa7 github.com/normaldotcom/canable-fw.git\r"


class Adapter:
    """Adapter with a skin board on its bus; the board hears it at 1 Mbit/s only.

    Acceptance codes and masks are accepted and ignored. The CAN channel stays open when the port is closed.

    Args:
        switches: Faults.
        board: Board on the bus.
    """

    def __init__(self, switches: Switches, board: SkinBoard) -> None:
        self._switches = switches
        self._board = board
        self._mode = _Mode.CLOSED
        self._bit_rate = b"4"
        self._stamped = False
        self._line = b""
        self._output = b""
        self._output_s = math.inf
        self._losses = LostReadings(switches)

    def opened(self, time_s: float) -> None:
        """Applies the fault `left_open`: an earlier program left the channel open and the board streaming."""
        if self._switches.strikes("left_open", time_s) is not None:
            self._mode, self._bit_rate = _Mode.NORMAL, b"8"
            self._board.leave_streaming(time_s)

    def closed(self, time_s: float) -> None:  # noqa: ARG002 - the interface of a device
        """Discards unread output."""
        self._output, self._output_s = b"", math.inf

    def receive(self, data: bytes, time_s: float) -> None:
        """Executes the commands that these bytes complete."""
        *lines, rest = (self._line + data).split(b"\r")
        self._line = rest[: _LONGEST_COMMAND + 1]
        for line in lines:
            self._take(line, time_s)

    def next_event_s(self) -> float:
        """Time of the next output."""
        return min(self._output_s, self._board.next_event_s())

    def step(self, time_s: float) -> bytes:
        """Answers and frames from the bus, as bytes to send."""
        while (due_s := self._board.next_event_s()) <= time_s:
            for halves in self._heard(self._board.tick(), due_s):
                self._pass_on(halves, due_s)
        output, self._output, self._output_s = self._output, b"", math.inf
        return output

    def _take(self, line: bytes, time_s: float) -> None:
        name = line[:1]
        if self._switches.strikes("no_acks", time_s) is not None:
            known = name in _WITHOUT_ACKS and self._obeys(line)
            self._send(_VERSION_WITHOUT_ACKS if known and name == b"V" else b"", time_s)
        else:
            # the bell after `C` carries no information: a closed channel answers with it too
            rings = name not in {b"", b"C"} and self._switches.strikes("bell", time_s) is not None
            known = not rings and self._obeys(line)
            self._send(_ANSWERS.get(name, _DONE) if known else _REFUSED, time_s)
        if known and name == b"t":
            self._transmit(line, time_s)

    def _obeys(self, line: bytes) -> bool:
        """Executes a command; returns whether it was known and allowed in this state."""
        name, argument = line[:1], line[1:]
        command = _COMMANDS.get(name)
        if command is None or self._mode not in command.modes or not command.argument.fullmatch(argument):
            return False
        self._mode = _MODES.get(name, self._mode)
        if name == b"S":
            self._bit_rate = argument
        if name == b"Z":
            self._stamped = argument == b"1"
        return True

    def _transmit(self, line: bytes, time_s: float) -> None:
        if self._bit_rate == b"8":
            frame = CanFrame(int(line[1:4], 16), bytes.fromhex(line[5:].decode("ascii")))
            self._pass_on(self._board.hear(frame, time_s), time_s)

    def _heard(self, readings: list[Halves], time_s: float) -> list[tuple[CanFrame, ...]]:
        """Frames that reach the adapter from the readings of one tick."""
        if not readings or self._mode is _Mode.CLOSED or self._losses.strikes(time_s):
            return []
        heard: list[tuple[CanFrame, ...]] = list(readings)
        if self._switches.strikes("swapped_halves", time_s) is not None:
            heard = [halves[::-1] for halves in heard]
        if self._switches.strikes("lost_half", time_s) is not None:
            at, half = self._switches.generator.integers([len(heard), 2]).tolist()
            heard[at] = heard[at][half : half + 1]
        return heard

    def _pass_on(self, frames: tuple[CanFrame, ...] | list[CanFrame], time_s: float) -> None:
        if self._mode is _Mode.CLOSED or self._bit_rate != b"8":
            return
        stamp = f"{int(1000 * time_s) % _STAMPS_MS:04X}" if self._stamped else ""
        for identifier, data in frames:
            text = f"t{identifier:03X}{len(data)}{data.hex().upper()}{stamp}\r"
            self._send(text.encode("ascii"), time_s)

    def _send(self, data: bytes, time_s: float) -> None:
        if data and len(self._output) + len(data) <= _MOST_OUTPUT:
            self._output += data
            self._output_s = min(self._output_s, time_s)
