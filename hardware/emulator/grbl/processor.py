"""The machine under an emulated controller, the state that all parts of its firmware share, and status reports."""

import math
from collections.abc import Generator

from ..faults import Switches
from . import report as grbl_report
from .motion import BLOCKS, Move, Planner, Vector
from .receive_buffer import ReceiveBuffer
from .settings import ControllerSettings, Memory

_BISECTIONS = 40
_MOVES = {"Run", "Jog", "Hold:1", "Door:2"}


class Machine:
    """Three axes with a limit switch at either end, which follow a planner until power or steps are lost.

    Args:
        memory: The numbered settings.
        settings: Settings of the controller.

    Attributes:
        planner: Pending lines, in the controller's own coordinates.
    """

    def __init__(self, memory: Memory, settings: ControllerSettings) -> None:
        self._memory = memory
        self._settings = settings
        travel, axes = memory.axis(130), memory.axes
        usual_mm = axes.mm(memory.home) if settings.homed else (-travel[0] / 2, -travel[1] / 2, -travel[2] / 2)
        start_mm = settings.start_mm or usual_mm
        self.planner = Planner(axes, axes.steps(start_mm) if settings.homed else (0, 0, 0))
        self._astray_mm: Vector = (0.0, 0.0, 0.0) if settings.homed else start_mm
        self._ends_mm = [(-mm, 0.0) for mm in travel]

    def believed_mm(self, time_s: float) -> Vector:
        """Position that the controller assumes, in machine coordinates."""
        return self.planner.axes.mm(self.planner.at(time_s))

    def position_mm(self, time_s: float) -> Vector:
        """True position in machine coordinates."""
        return _sum(self.planner.axes.mm(self.planner.at(time_s)), self._astray_mm)

    def pressed(self, time_s: float) -> str:
        """Letters of the axes whose limit switches are pressed."""
        return "".join(
            name for name, ends in zip("XYZ", self._switches(self.planner.at(time_s)), strict=True) if any(ends)
        )

    def switch_s(self, move: Move) -> float:
        """Time at which a line first presses or releases a limit switch; infinity if it does not."""
        before = self._switches(move.start)
        if before == self._switches(move.end):
            return math.inf
        low_s, high_s = move.start_s, move.end_s
        for _ in range(_BISECTIONS):  # each switch changes at most once in a straight line
            middle_s = (low_s + high_s) / 2
            unchanged = before == self._switches(move.at(middle_s))
            low_s, high_s = (middle_s, high_s) if unchanged else (low_s, middle_s)
        return high_s

    def _switches(self, place: Vector) -> list[tuple[bool, bool]]:
        """Whether the switches at the low and the high end of each axis are pressed at a position in steps."""
        place_mm = _sum(self.planner.axes.mm(place), self._astray_mm)
        return [(mm <= low, mm >= high) for mm, (low, high) in zip(place_mm, self._ends_mm, strict=True)]

    def stop_dead(self, time_s: float) -> None:
        """Stops the steps at once; the machine stops a little later, so the position is lost."""
        x, y, z = (speed * self._settings.overrun_s for speed in self.planner.velocity_mm_s(time_s))
        self._astray_mm = _sum(self._astray_mm, (x, y, z))
        self.planner.stop(time_s)

    def lose_power(self, time_s: float) -> None:
        """Stops at once; the controller then assumes position zero."""
        self.stop_dead(time_s)
        self._astray_mm = self.position_mm(time_s)
        self.planner.set((0, 0, 0))

    def start_homing(self, time_s: float) -> None:
        """Starts moving straight to the limit switches."""
        self.planner.set(self.planner.axes.steps(self.position_mm(time_s)))
        self._astray_mm = (0.0, 0.0, 0.0)
        self.planner.add_timed(self._memory.home, self._settings.homing_s, time_s)

    def end_homing(self) -> None:
        """Puts the machine where homing ends, with the position known."""
        self.planner.set(self._memory.home)


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


Program = Generator[float]
"""Yields the rig time at which it resumes, infinity to wait for a byte; any byte resumes it too."""
Command = Generator[float, None, int]
"""The same; returns 0 for `ok` or an error number."""


class Processor:
    """Time, memory, flags and output of a controller.

    Args:
        switches: Faults.
        settings: Settings of the controller.

    Attributes:
        now_s: Rig time.
        switches: Faults.
        settings: Settings of the controller.
        memory: The numbered settings.
        machine: The machine.
        planner: Pending lines of the machine.
        input: Receive buffer.
        locked: Whether it is in Alarm.
        pressed: Letters of the limit switches that a fault presses.
        homing: Whether it is homing.
        jogging: Whether the pending lines are jogs.
        held: Whether a feed hold or the safety door is active.
        door: Whether it is the safety door.
        checking: Whether it only checks G-code (`$C`).
        sleeping: Whether it sleeps until a reset (`$SLP`).
        restarts: Whether it restarts after the current line.
        listens: Whether it answers `?`.
        resets: Whether it obeys a reset.
        deaf_until: Time until which interrupts are off.
        suspended_until: Time until which the main program takes no line.
        asked_s: Time of a status request that is not answered yet.
    """

    def __init__(self, switches: Switches, settings: ControllerSettings) -> None:
        self.now_s = 0.0
        self.switches = switches
        self.settings = settings
        self.memory = Memory(settings.values)
        self.machine = Machine(self.memory, settings)
        self.planner = self.machine.planner
        self.input = ReceiveBuffer(settings.receive_bytes)
        self.locked = bool(self.memory[22]) and not settings.homed
        self.pressed = ""
        self._output = bytearray()
        self.forget()

    def forget(self) -> None:
        """Clears what every start clears."""
        self.input.clear()
        self._counters = grbl_report.Counters()
        self.asked_s: float | None = None
        self.deaf_until = self.suspended_until = -math.inf
        self.listens = self.resets = True
        self.homing = self.jogging = self.held = self.door = self.checking = self.restarts = False
        self.sleeping = False

    @property
    def moves(self) -> bool:
        """Whether lines are pending and not held, even if the first has not started yet."""
        return self.planner.current(self.now_s) is not None

    @property
    def jogs(self) -> bool:
        """Whether the machine is jogging."""
        return self.jogging and self.moves

    def pause(self, seconds: float) -> Program:
        """Waits for a time in seconds."""
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            yield end_s

    def until_done(self) -> Program:
        """Waits until no line is pending."""
        while self.planner.waiting(self.now_s):
            yield math.inf if self.held else self.planner.end_s()

    def until_room(self) -> Program:
        """Waits until there is room for a line."""
        while self.planner.waiting(self.now_s) >= BLOCKS:
            move = self.planner.current(self.now_s)
            yield math.inf if move is None or self.held else move.end_s

    def critical_alarm(self, number: int) -> Program:
        """Reports an alarm that only a reset clears; a reset during the report is ignored."""
        self.locked, self.listens, self.resets = True, False, False
        self.say(f"ALARM:{number}")
        yield from self.pause(self.settings.alarm_s)
        self.say(grbl_report.CRITICAL)
        self.resets = True
        while True:
            yield math.inf

    def say(self, text: str) -> None:
        """Sends a line."""
        self._output += f"{text}\r\n".encode("ascii")

    def take_output(self) -> bytes:
        """Output since the last call."""
        data = bytes(self._output)
        self._output.clear()
        return data

    def report(self) -> None:
        """Sends a status report."""
        self.asked_s = None
        if self.switches.strikes("silent_status", self.now_s) is not None:
            return
        state = self.state
        text = grbl_report.status(
            state,
            self.machine.believed_mm(self.now_s),
            self.settings.work_offset_mm,
            speed_mm_s=self.planner.speed_mm_s(self.now_s + self.settings.ahead_s) if state in _MOVES else 0.0,
            room=(BLOCKS - self.planner.waiting(self.now_s), self.input.room),
            pressed=self.pressed_now,
            mask=int(self.memory[10]),
            inches=bool(self.memory[13]),
            due=self._counters.due(state),
        )
        if self.switches.strikes("torn_status", self.now_s) is not None:
            at = int(self.switches.generator.integers(1, len(text)))
            text = f"{text[:at]}{grbl_report.PROGRAM_END}\r\n{text[at:]}"
        self.say(text)

    @property
    def pressed_now(self) -> str:
        """Letters of the axes whose limit switches are pressed, by a fault or by the machine."""
        return "".join(sorted({*self.pressed, *self.machine.pressed(self.now_s)}))

    @property
    def state(self) -> str:
        """State as in a report."""
        if self.sleeping:
            return "Sleep"
        if self.homing or self.locked:
            return "Home" if self.homing else "Alarm"
        if self.checking:
            return "Check"
        move = self.planner.current(self.now_s)
        if self.held:
            return ("Door:0" if self.door else "Hold:0") if move is None else ("Door:2" if self.door else "Hold:1")
        if move is None or move.start_s > self.now_s:
            return "Idle"
        return "Jog" if self.jogging else "Run"
