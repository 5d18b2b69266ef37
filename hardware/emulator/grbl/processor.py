"""State shared by all parts of an emulated GRBL firmware, and its status reports."""

import math
from collections.abc import Generator

from ..faults import Switches
from . import report as grbl_report
from .machine import Machine
from .motion import BLOCKS
from .receive_buffer import ReceiveBuffer
from .settings import ControllerSettings, Memory

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
        pressed: Letters of the limit switches that are pressed.
        homing: Whether it is homing.
        jogging: Whether the pending lines are jogs.
        held: Whether a feed hold is active.
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
        self.homing = self.jogging = self.held = False

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
        state = self._state()
        text = grbl_report.status(
            state,
            self.machine.believed_mm(self.now_s),
            self.settings.work_offset_mm,
            speed_mm_s=self.planner.speed_mm_s(self.now_s),
            room=(BLOCKS - self.planner.waiting(self.now_s), self.input.room),
            pressed=self.pressed,
            mask=int(self.memory[10]),
            inches=bool(self.memory[13]),
            due=self._counters.due(state),
        )
        if self.switches.strikes("torn_status", self.now_s) is not None:
            at = int(self.switches.generator.integers(1, len(text)))
            text = f"{text[:at]}{grbl_report.PROGRAM_END}\r\n{text[at:]}"
        self.say(text)

    def _state(self) -> str:
        if self.homing or self.locked:
            return "Home" if self.homing else "Alarm"
        move = self.planner.current(self.now_s)
        if self.held:
            return "Hold:0" if move is None else "Hold:1"
        if move is None or move.start_s > self.now_s:
            return "Idle"
        return "Jog" if self.jogging else "Run"
