"""Execution of a line by an emulated GRBL firmware (system.c, gcode.c, jog.c)."""

import re

from . import report as grbl_report
from .gcode import Block, LineRefused, Modal, parse
from .motion import Vector
from .processor import Command, Processor, Program
from .receive_buffer import LINE_BYTES

_SOFT_LIMIT = 2
_BAD_NUMBER, _UNKNOWN_COMMAND, _NO_HOMING, _NOT_IDLE, _LOCKED, _OVERFLOW, _TRAVEL = 2, 3, 5, 8, 9, 11, 15
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_WRITE = re.compile(rf"\$({_NUMBER})(=?)({_NUMBER})?(.*)")
_LAST_SETTING = 255


class Commands:
    """Executes lines.

    Args:
        processor: State of the controller.
    """

    def __init__(self, processor: Processor) -> None:
        self._cpu = processor
        self.forget()

    def forget(self) -> None:
        """Clears what every start clears."""
        self._modal = Modal()
        self.see_place()

    def see_place(self) -> None:
        """Sets the last target to where the machine will come to rest."""
        cpu = self._cpu
        self._target_mm = cpu.machine.believed_mm(max(cpu.now_s, cpu.planner.end_s()))

    def execute(self, line: str) -> Command:
        """Executes a line, in capitals and without spaces and comments."""
        if len(line) > LINE_BYTES:
            return _OVERFLOW
        if line.startswith("$"):
            return (yield from self._system(line))
        if line and (self._cpu.locked or self._cpu.jogs):
            return _LOCKED
        return (yield from self._gcode(line, jog=False)) if line else 0

    def _system(self, line: str) -> Command:
        """Executes a `$` line (system.c)."""
        cpu, kind, rest = self._cpu, line[1:2], line[2:]
        if kind == "J":
            if cpu.state not in {"Idle", "Jog"} or (cpu.moves and not cpu.jogging):
                return _NOT_IDLE
            return (yield from self._gcode(line[3:], jog=True)) if rest.startswith("=") else _UNKNOWN_COMMAND
        if kind in "$GCX":
            return self._any_time(kind) if not rest else _UNKNOWN_COMMAND
        at_rest = cpu.state in {"Idle", "Alarm"} and not cpu.moves
        return (yield from self._stored(line)) if at_rest else _NOT_IDLE

    def _stored(self, line: str) -> Command:
        """Homing, and what is stored."""
        cpu, kind, rest = self._cpu, line[1], line[2:]
        if kind == "H":
            return (yield from self._home(rest))
        if kind in "#IN" and not rest:
            return self._print(kind)
        if kind == "I" and rest.startswith("="):  # stored, as a setting is
            return (yield from self._write(0, cpu.memory[0]))
        if kind == "S" and rest == "LP":
            cpu.sleeping = cpu.locked = True
            return 0
        return _UNKNOWN_COMMAND if kind in "#IRS" else (yield from self._setting(line))

    def _setting(self, line: str) -> Command:
        """Any other `$` line, which writes a setting."""
        number, equals, value, more = match.groups() if (match := _WRITE.fullmatch(line)) else ("", "=", None, "")
        if not equals:
            return _UNKNOWN_COMMAND
        if value is None:
            return _BAD_NUMBER
        if more or float(number) > _LAST_SETTING:
            return _UNKNOWN_COMMAND
        return (yield from self._write(int(float(number)), float(value)))

    def _any_time(self, kind: str) -> int:
        """`$`, `$$`, `$G`, `$C` or `$X`."""
        cpu = self._cpu
        if kind == "":
            cpu.say(grbl_report.HELP)
        elif kind == "$":
            if cpu.held or (cpu.moves and not cpu.jogging):
                return _NOT_IDLE
            for text in cpu.memory.lines():
                cpu.say(text)
        elif kind == "G":
            cpu.say(grbl_report.parser_state(self._modal))
        elif kind == "X" and cpu.locked:
            cpu.say(grbl_report.UNLOCKED)
            cpu.locked = False
        elif kind == "C" and cpu.checking:
            cpu.say(grbl_report.DISABLED)
            cpu.restarts = True
        elif kind == "C":
            if cpu.state != "Idle":
                return _NOT_IDLE
            cpu.say(grbl_report.ENABLED)
            cpu.checking = True
        return 0

    def _print(self, kind: str) -> int:
        settings = self._cpu.settings
        if kind == "I":
            texts = grbl_report.build_info(settings.version, settings.receive_bytes)
        elif kind == "N":
            texts = ["$N0=", "$N1="]
        else:
            texts = grbl_report.offsets(settings.work_offset_mm, inches=bool(self._cpu.memory[13]))
        for text in texts:
            self._cpu.say(text)
        return 0

    def _write(self, number: int, value: float) -> Command:
        """Writes a setting; interrupts are off, so bytes that arrive meanwhile or right after the line are lost."""
        cpu = self._cpu
        cpu.input.discard()
        cpu.deaf_until = cpu.now_s + cpu.settings.write_s
        yield from cpu.pause(cpu.settings.write_s)
        code = cpu.memory.write(number, value)
        cpu.planner.axes = cpu.memory.axes
        return code

    def _home(self, rest: str) -> Command:
        """Homes silently; a status requested meanwhile is sent at the end. After more text it stays in state Home."""
        cpu = self._cpu
        if not cpu.memory[22]:
            return _NO_HOMING
        cpu.homing, cpu.locked = True, False
        if rest:
            return _UNKNOWN_COMMAND
        cpu.listens = False
        cpu.machine.start_homing(cpu.now_s)
        yield from cpu.pause(cpu.settings.homing_s)
        cpu.machine.end_homing()
        self.see_place()
        cpu.pressed = ""
        cpu.listens = True
        if cpu.asked_s is not None:
            cpu.report()
        cpu.homing = False
        return 0

    def _gcode(self, line: str, *, jog: bool) -> Command:
        cpu = self._cpu
        try:
            block = parse(line, self._modal, jog=jog)
        except LineRefused as refused:
            return refused.code
        if block.dwell_s is not None:
            yield from cpu.until_done()
            yield from cpu.pause(block.dwell_s)
        if block.axes:
            if (fault := cpu.switches.strikes("refuse_move", cpu.now_s)) is not None:
                return int(fault.get("code", _LOCKED))
            target_mm = self._aim(block)
            if cpu.memory.leaves_travel(target_mm):
                if jog:
                    return _TRAVEL
                yield from self._break_soft_limit()
            if not cpu.checking:
                yield from cpu.until_room()
                self._move(target_mm, block.feed_mm_min / 60, jog=jog)
            self._target_mm = target_mm
        if block.ends:
            yield from cpu.until_done()
            cpu.say(grbl_report.PROGRAM_END)
        self._modal = block.modal
        return 0

    def _aim(self, block: Block) -> Vector:
        """Target of a block, in machine coordinates."""
        target = list(self._target_mm)
        for axis, value in block.axes.items():
            zero = 0.0 if block.machine else self._cpu.settings.work_offset_mm[axis]
            target[axis] = value + (zero if block.absolute or block.machine else target[axis])
        return target[0], target[1], target[2]

    def _move(self, target_mm: Vector, speed_mm_s: float, *, jog: bool) -> None:
        """Appends a line; a jog starts at once, any other with the next turn of the main loop."""
        cpu, start_s = self._cpu, self._cpu.now_s
        if cpu.planner.waiting(cpu.now_s) == 0:
            cpu.jogging = jog
            start_s += 0.0 if jog else cpu.settings.start_s
            if (fault := cpu.switches.strikes("false_idle", cpu.now_s)) is not None:
                start_s += float(fault.get("seconds", 0.1))
        cpu.planner.add(cpu.planner.axes.steps(target_mm), speed_mm_s, start_s)

    def _break_soft_limit(self) -> Program:
        """Brings the machine to rest and locks; does not return."""
        self._cpu.planner.cancel(self._cpu.now_s, self._cpu.settings.ahead_s)
        yield from self._cpu.until_done()
        yield from self._cpu.critical_alarm(_SOFT_LIMIT)
