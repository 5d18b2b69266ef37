"""GRBL's own firmware, built for this computer from the user's checkout of its sources, behind a pseudo-terminal.

`tests/hardware/firmware/board.c` plays the processor, the serial line, the motors and the limit switches.
"""

import mmap
import os
import re
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from solidtouch.hardware.emulator.grbl.settings import DEFAULTS
from solidtouch.hardware.emulator.pseudo_terminal import PseudoTerminal
from solidtouch.hardware.link.loop import HostClock
from solidtouch.hardware.link.port import Port

from benchmarks.checks.watched_stage import UNHOMED_MM, Bench, Wire, machine_place

VARIABLE = "SOLIDTOUCH_GRBL"
BOARD = Path(__file__).parent / "hardware" / "firmware"
STEPS_PER_MM, TRAVEL_MM = 250, 200
QUICK = {24: 200, 25: 3000, 26: 20}
"""Settings with which homing from nearby takes a second."""
OK = re.compile(rb"ok\r\n$")
_ANSWER = re.compile(rb"(ok|error:\d+|\])\r\n$")
_REPORT = re.compile(rb"<(\w+).*\|MPos:([-0-9.,]+).*>\r\n$")
_BANNER = re.compile(rb"help\]\r\n")
_AVR = ("avr/io", "avr/interrupt", "avr/pgmspace", "avr/wdt", "util/delay")
_STATE = struct.Struct("=4iQ")
_TICKS_PER_S = 16e6
_EEPROM = 1024


def build(folder: Path) -> Path:
    """The program, or a skip that says what is missing."""
    if not (named := os.environ.get(VARIABLE)):
        pytest.skip(f"{VARIABLE} names no checkout of https://github.com/gnea/grbl")
    if (compiler := shutil.which("cc") or shutil.which("gcc")) is None:
        pytest.skip("there is no C compiler, neither cc nor gcc")
    if sys.platform != "linux":
        pytest.skip("the board around the firmware needs Linux")
    sources = Path(named).expanduser().resolve() / "grbl"
    assert (sources / "protocol.c").is_file(), f"{VARIABLE}={named}: no checkout of GRBL, there is no grbl/protocol.c"
    for name in _AVR:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / f"{name}.h").touch()
    options = ["-O1", "-w", "-fcommon", "-Dmain=firmware_main", "-include", BOARD / "board.h", "-I", folder]
    files = [BOARD / "board.c", *sorted(file for file in sources.glob("*.c") if file.name != "eeprom.c")]
    program = folder / "board"
    command = [compiler, *options, "-I", sources, "-Wl,--wrap=serial_read", "-o", program, *files, "-lm"]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return program


class Board:
    """A controller with a stage that is not homed.

    Args:
        program: What `build` built.
        folder: Folder for its port and its state.
        speed: Seconds of the board per second.
        values: Settings that differ from those of the emulated controller.

    Attributes:
        clock: Its time.
        line: Its port.
    """

    def __init__(self, program, folder, speed=1.0, values=None):
        self._program, self._speed = program, speed
        self._file = folder / "state"
        self._file.write_bytes(bytes(_STATE.size + _EEPROM))
        with self._file.open("r+b") as file:
            self._state = mmap.mmap(file.fileno(), 0)
        self._terminal = PseudoTerminal(folder / "stage")
        self._process = None
        self.clock = BoardClock(self._state, speed)
        self.line = WireOfBoard(str(folder / "stage"))
        self.line.keep()
        self.start()
        self.line.open()
        self.say(b"", 2.0, _BANNER)
        for number, value in {22: 1, **DEFAULTS, **(values or {})}.items():  # soft limits need homing
            self.say(f"${number}={value:g}\n".encode(), 10.0, OK)
        self.start()

    def start(self):
        """Switches it on, or off and on, with the stage in its place before homing."""
        self.stop()
        self.clock.restart()
        self._state[: _STATE.size] = _STATE.pack(*(round(STEPS_PER_MM * mm) for mm in UNHOMED_MM), 0, 0)
        pipe = self._terminal.fileno()
        command = [self._program, str(self._speed), str(TRAVEL_MM * STEPS_PER_MM), self._file]
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe)

    def stop(self):
        """Switches it off."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def remove(self):
        self.line.close()
        self.stop()
        self._terminal.unplug()

    @property
    def place_mm(self):
        """Where the stage truly stands, in machine coordinates."""
        return tuple(steps / STEPS_PER_MM for steps in _STATE.unpack_from(self._state)[:3])

    def press(self, axes):
        """Presses the limit switches of some axes by hand, those of the others not."""
        pressed = sum(1 << "XYZ".index(axis) for axis in axes)
        self._state[12:16] = pressed.to_bytes(4, sys.byteorder)

    def say(self, data, seconds, end=None):
        """What comes in some seconds of the board after bytes, or until an end, which then must come."""
        self.line.write(data)
        until, heard = self.clock.now() + seconds, b""
        while self.clock.now() < until and not (end and end.search(heard)):
            self.clock.wait([self.line], until)
            heard += self.line.read()
        assert end is None or end.search(heard), f"{heard!r} after {data!r}"
        return heard

    def home(self, place_mm=None):
        """Makes it idle, homed, as after a start, and at a place in machine coordinates."""
        self.line.open()
        self.press("")
        self.say(b"", 0.05)
        self.say(b"\x18", 2.0, _BANNER)
        for _ in range(5):  # on a busy computer homing may pass a switch by some steps
            if self.state() == ("Idle", pytest.approx(self.place_mm, abs=0.0011)):
                break
            self.start()
            self.say(b"", 2.0, _BANNER)
            self.say(b"$H\n", 30.0, OK)
        if place_mm is not None:
            x, y, z = place_mm
            self.say(f"$J=G53G90G21X{x}Y{y}Z{z}F3000\n".encode(), 1.0, OK)
        until = self.clock.now() + 30.0
        while (state := self.state())[0] != "Idle":
            assert self.clock.now() < until, state
        assert state[1] == pytest.approx(self.place_mm, abs=0.0011)
        self.line.close()

    def state(self):
        """State and position in a status report."""
        name, place = _REPORT.search(self.say(b"?", 20.0, _REPORT)).groups()  # of a board that may be fast
        return name.decode(), tuple(map(float, place.split(b",")))


class BoardClock(HostClock):
    """Time of a board, which a busy computer slows."""

    def __init__(self, state, speed):
        self._state, self._speed, self._before_s = state, speed, 0.0

    def now(self):
        return self._before_s + _STATE.unpack_from(self._state)[4] / _TICKS_PER_S

    def restart(self):
        """Goes on from here when the board starts anew."""
        self._before_s = self.now()

    def wait(self, ports, until):
        while (left_s := until - self.now()) > 0 and not any(port.waiting() for port in ports):
            super().wait(ports, super().now() + min(left_s / self._speed, 0.01))


class WireOfBoard(Wire, Port):
    """A wire to a board."""


def on_firmware(board):
    """A function that makes stages on a board, the one before being disconnected."""

    def make(rig, start):
        board.line.close()
        board.line.keep()
        if start is None:
            board.start()
        else:
            board.home(machine_place(rig, *start))
        bench = Bench(rig, board.line, board.clock, lambda: board.place_mm, sample_s=0.002)
        bench.right_mm, bench.right_s = 0.2, 0.3  # a busy computer samples less often
        return bench

    return make
