"""GRBL's firmware: a main program that takes line after line and blocks where the real one blocks.

The program is a generator that yields the time at which it resumes. A reset or an alarm discards it and starts
another, so every state in which the real firmware waits is a line that yields.
"""

import math

from ..faults import Switches
from . import report as grbl_report
from .commands import Commands
from .motion import Move, Vector
from .processor import Processor, Program
from .settings import ControllerSettings

_HARD_LIMIT, _RESET_IN_MOTION, _RESET_IN_HOMING = 1, 3, 6


class Firmware:
    """The main program and the events beside it: real-time commands, limit switches, loss of power.

    Args:
        switches: Faults.
        settings: Settings of the controller.
    """

    def __init__(self, switches: Switches, settings: ControllerSettings) -> None:
        self._cpu = Processor(switches, settings)
        self._commands = Commands(self._cpu)
        self._in_line = False
        self._limit_move: Move | None = None
        self._switch_s = self._fault_s = math.inf
        self._run(self._serve())

    @property
    def runs(self) -> bool:
        """Whether it is neither starting nor printing an alarm."""
        return self._cpu.resets

    def position_mm(self, time_s: float) -> Vector:
        """True position in machine coordinates."""
        return self._cpu.machine.position_mm(time_s)

    def next_event_s(self) -> float:
        """Time of the next event that needs no byte."""
        return max(self._cpu.now_s, min(self._wake_s, self._status_due_s(), self._limit_due_s()))

    def advance(self, time_s: float) -> None:
        """Handles all events due by this time, in order."""
        while (due_s := self.next_event_s()) <= time_s and due_s < math.inf:
            self._cpu.now_s = due_s
            if self._limit_due_s() <= due_s:
                self._meet_limit()
            elif self._status_due_s() <= due_s:
                self._cpu.report()
            else:
                self._wake_s = math.inf
                self._wake_s = next(self._program)
        self._cpu.now_s = max(self._cpu.now_s, time_s)

    def wake(self) -> None:
        """Resumes the main program to check what has changed."""
        self._wake_s = min(self._wake_s, self._cpu.now_s)

    def take_output(self) -> bytes:
        """Output since the last call."""
        return self._cpu.take_output()

    # Bytes and power

    def put(self, byte: int) -> None:
        """Takes a byte for the main program."""
        self._cpu.input.put(byte)

    @property
    def is_deaf(self) -> bool:
        """Whether interrupts are off, so that bytes are lost."""
        return self._cpu.now_s < self._cpu.deaf_until

    def ask_status(self) -> None:
        """`?`: reports soon; repeated requests before then give one report."""
        self._cpu.asked_s = self._cpu.now_s if self._cpu.asked_s is None else self._cpu.asked_s

    def reset(self) -> None:
        """0x18: stops at once and restarts; in motion this loses the position."""
        cpu = self._cpu
        if cpu.resets:
            alarm = _RESET_IN_HOMING if cpu.homing else _RESET_IN_MOTION if cpu.moves else None
            cpu.machine.stop_dead(cpu.now_s)
            cpu.listens = cpu.resets = False
            self._run(self._restart(alarm))

    def hold(self) -> None:
        """`!`: brakes and keeps the remaining path; a jog is cancelled instead."""
        if self._cpu.jogs:
            self.cancel_jog()
        elif self._obeys() and not self._cpu.checking:
            self._suspend()

    def open_door(self) -> None:
        """0x84: as `!`, in state Door; a jog is cancelled first."""
        cpu = self._cpu
        if cpu.listens and not (cpu.locked or cpu.checking or cpu.homing):
            self.cancel_jog()
            cpu.say(grbl_report.DOOR)
            cpu.door = True
            self._suspend()

    def _suspend(self) -> None:
        cpu = self._cpu
        if cpu.jogs:  # braking after its cancellation
            cpu.planner.cancel(cpu.now_s, cpu.settings.ahead_s)
        else:
            cpu.planner.hold(cpu.now_s, cpu.settings.ahead_s)
        cpu.held, cpu.suspended_until = True, math.inf

    def resume(self) -> None:
        """`~`: resumes after a hold is complete."""
        if self._cpu.held and not self._cpu.moves:
            self._cpu.planner.resume(self._cpu.now_s)
            self._cpu.held, self._cpu.door, self._cpu.suspended_until = False, False, -math.inf

    def cancel_jog(self) -> None:
        """0x85: during a jog, brakes and drops the remaining path; lines wait until it is at rest."""
        if self._cpu.jogs and self._obeys():
            self._cpu.planner.cancel(self._cpu.now_s, self._cpu.settings.ahead_s)
            self._cpu.suspended_until = self._cpu.planner.end_s()
            self._commands.see_place()

    def lose_power(self) -> None:
        """Restarts with its position set to zero."""
        self._cpu.machine.lose_power(self._cpu.now_s)
        self._cpu.listens = self._cpu.resets = False
        self._run(self._boot())

    def _obeys(self) -> bool:
        return self._cpu.listens and not self._cpu.locked and self._cpu.now_s >= self._cpu.suspended_until

    # The main program

    def _run(self, program: Program) -> None:
        self._program = program
        self._wake_s = self._cpu.now_s

    def _serve(self) -> Program:
        """Executes line after line and answers each."""
        while True:
            yield from self._while_suspended()
            line = self._cpu.input.line()
            if line is None:
                yield math.inf
                continue
            yield from self._cpu.pause(self._cpu.settings.line_s)
            yield from self._while_suspended()
            self._in_line = True
            code = yield from self._commands.execute(line)
            self._in_line = False
            self._answer(code)
            if self._cpu.sleeping:
                self._cpu.say(grbl_report.SLEEPING)
                while True:
                    yield math.inf
            if self._cpu.restarts:
                yield from self._restart(None)

    def _while_suspended(self) -> Program:
        while self._cpu.now_s < self._cpu.suspended_until:
            yield self._cpu.suspended_until

    def _answer(self, code: int) -> None:
        cpu = self._cpu
        if code:
            cpu.say(f"error:{code}")
        elif cpu.switches.strikes("lost_ok", cpu.now_s) is None:
            cpu.say("ok")
            if cpu.switches.strikes("extra_ok", cpu.now_s) is not None:
                cpu.say("ok")

    def _restart(self, alarm: int | None) -> Program:
        """A soft reset; a line in execution is answered late (gcode.c)."""
        if alarm is not None:
            self._cpu.locked = True
            self._cpu.say(f"ALARM:{alarm}")
            yield from self._cpu.pause(self._cpu.settings.alarm_s)
        yield from self._cpu.pause(self._cpu.settings.reset_s)
        if self._in_line:
            self._cpu.say("ok")
        yield from self._start()

    def _boot(self) -> Program:
        yield from self._cpu.pause(self._cpu.settings.boot_s)
        self._cpu.locked = bool(self._cpu.memory[22])
        yield from self._start()

    def _start(self) -> Program:
        self._in_line = False
        self._cpu.forget()
        self._commands.forget()
        cpu = self._cpu
        cpu.say(grbl_report.banner(cpu.settings.firmware, cpu.settings.version))
        if cpu.memory[21] and cpu.pressed_now:
            cpu.locked = True
            cpu.say(grbl_report.PRESSED)
        if cpu.locked:
            cpu.say(grbl_report.LOCKED)
        yield from self._serve()

    # Events in time

    def _status_due_s(self) -> float:
        cpu = self._cpu
        return math.inf if cpu.asked_s is None or not cpu.listens else cpu.asked_s + cpu.settings.status_s

    def _limit_due_s(self) -> float:
        """When the current move changes a limit switch, or the fault presses one, in the middle of the move."""
        cpu = self._cpu
        move = cpu.planner.current(cpu.now_s)
        if move is None or cpu.homing or not cpu.memory[21]:
            return math.inf
        if move is not self._limit_move:
            self._limit_move = move
            self._switch_s, self._fault_s = cpu.machine.switch_s(move), (move.start_s + move.end_s) / 2
        return min(self._switch_s, self._fault_s if cpu.switches.is_on("limit_alarm") else math.inf)

    def _meet_limit(self) -> None:
        """Stops if a limit switch changes, or the fault presses those of the axes that move."""
        cpu, move = self._cpu, self._limit_move
        fault = cpu.now_s < self._switch_s
        if fault:
            self._fault_s = math.inf
            if move is None or cpu.switches.strikes("limit_alarm", cpu.now_s) is None:
                return
            ends = zip("XYZ", move.start, move.end, strict=True)
            cpu.pressed = "".join(name for name, start, end in ends if start != end)
        cpu.machine.stop_dead(cpu.now_s)
        cpu.listens = cpu.resets = False
        self._run(cpu.critical_alarm(_HARD_LIMIT))
