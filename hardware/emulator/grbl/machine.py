"""The machine under an emulated controller: its true position and the one the controller assumes."""

from .motion import Planner, Vector
from .settings import ControllerSettings, Memory


class Machine:
    """Three axes that follow a planner until power or steps are lost.

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

    def believed_mm(self, time_s: float) -> Vector:
        """Position that the controller assumes, in machine coordinates."""
        return self.planner.axes.mm(self.planner.at(time_s))

    def position_mm(self, time_s: float) -> Vector:
        """True position in machine coordinates."""
        (x, y, z), (a, b, c) = self.planner.axes.mm(self.planner.at(time_s)), self._astray_mm
        return x + a, y + b, z + c

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
