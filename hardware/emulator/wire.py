"""Faults of a serial line: fragments, losses, noise, delays."""

from collections import deque
from typing import Any, NamedTuple

from .faults import Switches

_LINE_ENDS = b"\r\n\x07"
_PIECE_BYTES = 3
_PIECE_DELAY_S = 0.002
_LATE_S = 0.05


class _Piece(NamedTuple):
    time_s: float
    data: bytes


class Wire:
    """One direction of a serial line, in rig time; bytes stay in order.

    Args:
        port: Name of the port, for faults that are on for one port only.
        switches: Faults.
    """

    def __init__(self, port: str, switches: Switches) -> None:
        self._port = port
        self._switches = switches
        self._pieces: deque[_Piece] = deque()

    def next_event_s(self) -> float:
        """Arrival time of the next bytes; infinity if none are in transit."""
        return self._pieces[0].time_s if self._pieces else float("inf")

    def send(self, data: bytes, time_s: float) -> None:
        """Puts an output of the device on the wire."""
        data = self._damaged(data, time_s)
        late = self._strikes("late", time_s)
        arrival_s = time_s + (self._uniform(late.get("delay_s", _LATE_S)) if late is not None else 0.0)
        if self._pieces:
            arrival_s = max(arrival_s, self._pieces[-1].time_s)
        split = self._strikes("split", time_s)
        size, delay_s = len(data) or 1, 0.0
        if split is not None:
            size, delay_s = int(split.get("size", _PIECE_BYTES)), split.get("delay_s", _PIECE_DELAY_S)
        for i, start in enumerate(range(0, len(data), size)):
            self._pieces.append(_Piece(arrival_s + i * delay_s, data[start : start + size]))

    def arrived(self, time_s: float) -> bytes:
        """Bytes that have arrived by this time; they are removed."""
        data = b""
        while self._pieces and self._pieces[0].time_s <= time_s:
            data += self._pieces.popleft().data
        return data

    def clear(self) -> None:
        """Discards all bytes in transit."""
        self._pieces.clear()

    def _strikes(self, name: str, time_s: float) -> dict[str, Any] | None:
        return self._switches.strikes(name, time_s, self._port)

    def _uniform(self, high: float) -> float:
        return float(self._switches.generator.uniform(0.0, high))

    def _damaged(self, data: bytes, time_s: float) -> bytes:
        if not data:
            return data
        generator = self._switches.generator
        if (fault := self._strikes("drop_bytes", time_s)) is not None:
            gone = set(generator.permutation(len(data))[: int(fault.get("count", 1))].tolist())
            data = bytes(byte for i, byte in enumerate(data) if i not in gone)
        ends = [i for i, byte in enumerate(data) if byte in _LINE_ENDS]
        if ends and self._strikes("merge", time_s) is not None:
            data = _without_line_end(data, ends[generator.integers(len(ends))])
        if data and (fault := self._strikes("flip_bits", time_s)) is not None:
            flipped = bytearray(data)
            for bit in generator.integers(8 * len(data), size=int(fault.get("count", 1))):
                flipped[bit // 8] ^= 1 << (bit % 8)
            data = bytes(flipped)
        if self._strikes("garbage", time_s) is not None:
            data = generator.bytes(len(data))
        return data


def _without_line_end(data: bytes, at: int) -> bytes:
    """The bytes without the line end at an index; removes both bytes of a CR LF."""
    first, last = at, at + 1
    if data[at : at + 2] == b"\r\n":
        last += 1
    elif data[max(0, at - 1) : at + 1] == b"\r\n":
        first -= 1
    return data[:first] + data[last:]
