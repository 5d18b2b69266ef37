"""Emulated board of the iCub's skin, like an mtb4: commands and readings of its triangles as CAN frames.

Sources are `embot_app_application_theSkin.cpp` and `embot_prot_can_skin_periodic.cpp` of github.com/robotology/
icub-firmware. Each triangle has 12 taxels, whose values fall under load.
"""

import math
from typing import NamedTuple

import numpy as np

from ...models.errors import InputError
from .faults import Switches
from .finger import Finger
from .sensor_faults import FaultyFinger, masked

TAXELS = 12
TRIANGLES = 16
_BROADCAST = 15
_NOT_CONNECTED = 2
_VERSION = bytes([11, 1, 5, 0])  # mtb4, and its firmware
_PROTOCOL = (1, 0)


class CanFrame(NamedTuple):
    """A data frame with an 11-bit identifier."""

    identifier: int
    data: bytes


class Halves(NamedTuple):
    """One reading of a triangle: a frame with taxels 0 to 6, and one with taxels 7 to 11 and the diagnostics."""

    head: CanFrame
    tail: CanFrame


class SkinBoard:
    """A board with the finger as triangle `triangle`; nothing touches the others.

    At start it calibrates, enables all triangles and does not stream. It obeys `0x4D`, `0x50`, `0x07` and `0x1C` and
    ignores all else. Drift compensation by skin type is not emulated, as the fingertip has none.

    Args:
        switches: Faults.
        finger: The finger, with at most 12 taxels.
        board: CAN address of the board.
        triangle: Triangle to which the finger is connected.

    Raises:
        InputError: The finger has more taxels than a triangle.
    """

    def __init__(self, switches: Switches, finger: Finger, board: int = 14, triangle: int = 0) -> None:
        if finger.taxels > TAXELS:
            raise InputError(f"The finger has {finger.taxels} taxels; a triangle of the iCub's skin has {TAXELS}.")
        self._switches = switches
        self._finger = FaultyFinger(switches, finger)
        self._board = board
        self._triangle = triangle
        self._others = np.random.default_rng(board)
        self._period_s = 0.05
        self._no_load = 245
        self._enabled = set(range(TRIANGLES))
        self._shift = [2] * TRIANGLES
        self._start_s = math.inf
        self._ticks = 0
        self._baseline = self._finger.load(0.0)

    def hear(self, frame: CanFrame, time_s: float) -> list[CanFrame]:
        """Obeys a frame if it is a command for this board; returns its answer, if any."""
        if frame.identifier >> 8 != 2 or frame.identifier & 15 not in {self._board, _BROADCAST}:
            return []
        match [*frame.data]:
            case [0x4D, _, period_ms, no_load, *_] if period_ms > 0:
                self._set_board(period_ms, no_load, time_s)
            case [0x50, first, last, shift, flags, _, _, *_] if first <= last < TRIANGLES:
                self._set_triangles(range(first, last + 1), shift, bool(flags & 1), time_s)
            case [0x07, mode, *_]:
                self._start_s, self._ticks = (time_s, 0) if mode == 0 else (math.inf, 0)
            case [0x1C, *wanted] if len(wanted) >= 2:
                return [self._version(frame.identifier >> 4 & 15, (wanted[0], wanted[1]))]
        return []

    def leave_streaming(self, time_s: float) -> None:
        """Streams the finger every 20 ms, as after a program that ended without stopping it."""
        self._set_board(20, 240, time_s)
        self._set_triangles(range(self._triangle, self._triangle + 1), 0, True, time_s)
        self._start_s = time_s

    def next_event_s(self) -> float:
        """Time of the next reading; infinity if it does not stream."""
        return self._start_s + (self._ticks + 1) * self._period_s if self._enabled else math.inf

    def tick(self) -> list[Halves]:
        """Readings that are due at `next_event_s`, in order of the triangles."""
        time_s = self.next_event_s()
        self._ticks += 1
        if self._switches.strikes("silent_sensor", time_s) is not None:
            return []
        message_class = 4 if self._switches.strikes("old_class", time_s) is None else 3
        readings = [self._reading(message_class, triangle, time_s) for triangle in sorted(self._enabled)]
        if self._switches.strikes("foreign", time_s) is not None:
            readings.insert(0, self._foreign(message_class, self._board % 14 + 1, self._triangle))
            readings.append(self._foreign(message_class, self._board, (self._triangle + 1) % TRIANGLES))
        return readings

    def _set_board(self, period_ms: int, no_load: int, time_s: float) -> None:
        self._period_s = period_ms / 1000
        self._no_load = no_load
        self._enabled.clear()
        if self._start_s < math.inf:
            self._start_s, self._ticks = time_s, 0

    def _set_triangles(self, triangles: range, shift: int, enabled: bool, time_s: float) -> None:
        self._enabled = self._enabled | set(triangles) if enabled else self._enabled - set(triangles)
        for triangle in triangles:
            self._shift[triangle] = shift
        self._start_s, self._ticks = math.inf, 0
        self._baseline = self._finger.load(time_s)

    def _version(self, asker: int, wanted: tuple[int, int]) -> CanFrame:
        data = bytes([0x1C, *_VERSION, *_PROTOCOL, wanted <= _PROTOCOL])
        return CanFrame(0x200 | self._board << 4 | asker, data)

    def _reading(self, message_class: int, triangle: int, time_s: float) -> Halves:
        """Taxels of a triangle as bytes; those at twice their range or more are flagged (`fill`)."""
        if triangle != self._triangle:
            return self._foreign(message_class, self._board, triangle)
        if self._switches.strikes("recalibrate", time_s) is not None:
            self._baseline = self._finger.load(time_s)
        below = np.rint(self._finger.read(time_s) - self._baseline).astype(int).tolist()
        below += [0] * (TAXELS - len(below))
        shift = self._shift[triangle]
        most, least = 2 * self._no_load << shift, -2 * (255 - self._no_load) << shift
        sent = [min(max(self._no_load - (value >> shift), 0), 255) for value in below]
        beyond = sum(1 << t for t, value in enumerate(below) if not least < value < most)
        error = 0
        if (fault := self._switches.strikes("taxel_error", time_s)) is not None:
            broken = masked(fault, TAXELS).tolist()
            sent = [0 if gone else byte for byte, gone in zip(sent, broken, strict=True)]
            beyond |= sum(1 << t for t, gone in enumerate(broken) if gone)
            error = _NOT_CONNECTED
        return _halves(message_class << 8 | self._board << 4 | triangle, bytes(sent), beyond, error)

    def _foreign(self, message_class: int, board: int, triangle: int) -> Halves:
        """A reading of an untouched triangle."""
        noise = np.rint(self._others.standard_normal(TAXELS)).astype(int)
        sent = np.clip(self._no_load + noise, 0, 255).astype(np.uint8).tobytes()
        return _halves(message_class << 8 | board << 4 | triangle, sent, 0, 0)


def _halves(identifier: int, taxels: bytes, beyond: int, error: int) -> Halves:
    head = CanFrame(identifier, bytes([0x40]) + taxels[:7])
    return Halves(head, CanFrame(identifier, bytes([0xC0]) + taxels[7:] + (beyond << 4 | error).to_bytes(2, "big")))
