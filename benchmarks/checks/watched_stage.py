"""A stage whose true position is compared with the commanded path, on a wire that can alter what is sent.

`Bench` is one on any port; `EmulatedStage` has an emulated controller in memory.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.grbl.controller import Controller, ControllerSettings
from solidtouch.hardware.emulator.wired_port import ManualClock, WiredPort
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.link.loop import Clock, Loop
from solidtouch.hardware.rig.settings import RigFile
from solidtouch.hardware.stage.stage import Stage

ON_PATH_MM = 0.05
UNHOMED_MM = (-5.0, -5.0, -5.0)
"""Where a stage stands before it is homed."""
_AFTER_S = 1.0

Place = tuple[float, ...]


class Wire:
    """Part of a port that keeps what is written, and may send something else.

    Attributes:
        writes: What was written.
        alter: What is sent instead, from the number of the write and its bytes.
    """

    writes: list[bytes]
    alter: Callable[[int, bytes], bytes]

    def keep(self, alter: Callable[[int, bytes], bytes] = lambda _, data: data) -> None:
        """Forgets what was written, and alters what follows."""
        self.writes, self.alter = [], alter

    def write(self, data: bytes) -> None:
        """Sends bytes."""
        number = len(self.writes)
        self.writes.append(data)
        if sent := self.alter(number, data):
            super().write(sent)  # type: ignore[misc] - of the port beside it


class WireInMemory(Wire, WiredPort):
    """A wire to an emulated device."""


class Watch:
    """Time at which the true position is sampled.

    Args:
        clock: The time itself.
        place: True position now, in machine coordinates.
        sample_s: Time between samples in seconds.

    Attributes:
        clock: The time itself.
        paths: Polylines in machine coordinates that are commanded.
        strayed_mm: Largest distance from them.
        strayed_s: Longest time off them in motion.
        trace: Time and position of the samples.
    """

    def __init__(self, clock: Clock, place: Callable[[], Place], sample_s: float) -> None:
        self.clock = clock
        self.paths: list[list[Place]] = []
        self.strayed_mm = self.strayed_s = 0.0
        self.trace: list[tuple[float, Place]] = []
        self._place = place
        self._sample_s = sample_s
        self._since_s = math.inf

    def now(self) -> float:
        """Rig time in seconds."""
        return self.clock.now()

    def wait(self, ports: Sequence[Any], until: float) -> None:
        """Waits in steps, and samples after each."""
        while True:
            self.clock.wait(ports, min(until, self.now() + self._sample_s))
            self._sample()
            if self.now() >= until or any(port.waiting() for port in ports):
                return

    def _sample(self) -> None:
        if not self.paths:
            return
        at, now_s = self._place(), self.now()
        moved = not self.trace or at != self.trace[-1][1]
        self.trace.append((now_s, at))
        if not moved:
            return
        distance = min(_distance(at, a, b) for path in self.paths for a, b in pairwise([path[0], *path]))
        self.strayed_mm = max(self.strayed_mm, distance)
        if distance <= ON_PATH_MM:
            self._since_s = math.inf
        else:
            self._since_s = min(self._since_s, now_s)
            self.strayed_s = max(self.strayed_s, now_s - self._since_s)


def _distance(at: Place, a: Place, b: Place) -> float:
    way = [q - p for p, q in zip(a, b, strict=True)]
    square = sum(mm * mm for mm in way)
    share = sum(mm * (c - p) for mm, c, p in zip(way, at, a, strict=True)) / square if square else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.dist(at, [p + mm * share for p, mm in zip(a, way, strict=True)])


class Bench:
    """A stage that is watched.

    Args:
        rig: Settings.
        port: Its port, a `Wire`.
        clock: Its time.
        place: True position now, in machine coordinates.
        sample_s: Time between its samples in seconds.

    Attributes:
        rig: Settings.
        port: Its port.
        stage: The driver.
        watch: Its clock, which knows where the stage is.
        right_mm: Largest error of a position that counts as right.
        right_s: The same of a duration.
    """

    right_mm, right_s = 0.01, 0.021

    def __init__(
        self, rig: RigFile, port: Any, clock: Clock, place: Callable[[], Place], sample_s: float = 0.01
    ) -> None:
        self.rig = rig
        self.port = port
        self.port.keep()
        self.watch = Watch(clock, place, sample_s)
        self.stage = Stage(rig.stage, Loop(self.watch), NoJournal(), port)
        self._place = place

    def machine(self, x_mm: float, y_mm: float) -> tuple[float, float, float]:
        """Machine coordinates of a place in the rig frame."""
        return machine_place(self.rig, x_mm, y_mm)

    @property
    def place(self) -> Place:
        """True position in machine coordinates."""
        return self._place()

    def rest(self) -> bool:
        """Whether nothing moves for a second."""
        before, until = self.place, self.watch.now() + _AFTER_S
        self.port.open()  # else nobody waits for it
        while self.watch.now() < until:
            self.port.read()
            self.watch.clock.wait([self.port], until)
        return before == self.place


def machine_place(rig: RigFile, x_mm: float, y_mm: float) -> tuple[float, float, float]:
    """Machine coordinates of a place in the rig frame."""
    return rig.stage.x.machine_mm(x_mm), rig.stage.y.machine_mm(y_mm), -1.0


class EmulatedStage(Bench):
    """A stage and its emulated controller in memory.

    Args:
        rig: Settings.
        start: Start in the rig frame; None for a controller that must be homed.
    """

    def __init__(self, rig: RigFile, start: tuple[float, float] | None) -> None:
        place = UNHOMED_MM if start is None else machine_place(rig, *start)
        clock = ManualClock()
        controller = Controller(Switches(), ControllerSettings(homed=start is not None, start_mm=place))
        port = WireInMemory(clock, controller, "stage")
        super().__init__(rig, port, clock, lambda: controller.position_mm(clock.now()))
