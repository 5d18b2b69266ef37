"""xy stage with a GRBL controller: homed on request, moved by jogs in millimetres of the rig frame.

Moves are jogs (`$J=`): one that would leave the travel is refused without an alarm, and jogs can be cancelled. An `ok`
only confirms that a move is queued, and a report of Idle may precede the start of the motion. So a motion has ended
when two successive reports are Idle at the target, neither before the move can have been completed. Nothing is resent.
A stage that two successive reports show elsewhere than on its way is stopped: a command may be damaged on the line.

The position is known from homing until the controller restarts, stops with an alarm or is unplugged. The position of a
controller found Idle is trusted if opening its port did not restart it: with homing enabled it starts in Alarm, which
only homing or an operator's `$X` ends; the operator is then responsible for the position.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

from ..errors import CommandRefused, NoAnswer, PositionUnknown, StageAlarm, StageFault, WrongDevice
from ..journal import Journal
from ..link.loop import Loop
from ..link.port import Port
from ..rig.settings import StageSettings
from . import grbl
from .course import CORRIDOR_MM, MotionCourse
from .grbl import State, StatusReport, Vector
from .grbl_link import MOVING_POLL_S, POLL_S, GrblLink, remedy
from .leg import AxisLimits, AxisSetup, Leg, Setup, check_limits, check_setup, leg_time, machine_end, needed_settings
from .state import StageCounts

_PRINTED_MM = 0.001
_UNUSED_MM = 0.01  # tolerance of the axis that the rig does not use
_REST_S = 0.6
_HOMING_S = 0.5  # any other command is answered sooner
_SLOWER = 1.5
_MARGIN_S = 1.0
_SETTINGS_S = 2.0
_ATTEMPTS = 3
_OFFSET_POLLS = 30  # reports that may lack the work offset (config.h)


class StageReport(NamedTuple):
    """State of the controller at connection.

    Attributes:
        firmware: Name and version.
        state: State of the controller.
        homed: Whether its position is known.
        values: Settings by number.
        notes: Warnings, one sentence each.
    """

    firmware: str
    state: str
    homed: bool
    values: dict[int, float]
    notes: tuple[str, ...]


class Stage:
    """Driver of the stage; call `connect` first.

    Args:
        settings: Port, axes and limits.
        loop: Loop that reads the port.
        journal: Journal for commands, reports and events.
        port: Port to use instead of that of the settings.

    Attributes:
        port: Port of the controller.
        report: State at connection, None before.
    """

    def __init__(self, settings: StageSettings, loop: Loop, journal: Journal, port: Port | None = None) -> None:
        self.port = port or Port(settings.port, settings.baud)
        self.report: StageReport | None = None
        self._settings = settings
        self._loop = loop
        self._journal = journal
        self._link = GrblLink(self.port, loop, journal, self._take_status)
        self._said = self._link.said
        self._setup: Setup | None = None
        self._homed = False
        self._rest: Vector | None = None
        self._strayed = 0

    @property
    def counts(self) -> StageCounts:
        """Counts of faults so far."""
        return self._said.counts

    @property
    def homed(self) -> bool:
        """Whether the position is known."""
        return self._homed and self._said.trouble is None and self.port.is_open

    @property
    def position_mm(self) -> tuple[float, float] | None:
        """Position (x, y) in mm of the rig frame from the last report; None if unknown."""
        machine = self._said.machine
        if machine is None or self._setup is None or not self.homed:
            return None
        settings, setup = self._settings, self._setup
        return settings.x.rig_mm(machine[setup.x.number]), settings.y.rig_mm(machine[setup.y.number])

    def connect(self, will_home: bool = False) -> StageReport:
        """Opens the port and checks the controller and its settings; nothing moves. Returns `report`.

        Args:
            will_home: Whether `home` follows, so that a controller that accepts only a reset may be reset.

        Raises:
            PortError: The port cannot be opened.
            WrongDevice: Another device answers, or a setting does not suit; the message says what to send.
            RigError: The controller does not answer, or is busy.
        """
        self._homed = False
        try:
            self._link.open()
            self._link.greet(self._settings.boot_s, will_home)
            self._setup = check_setup(self._settings, self._read_values(), will_home)
            status = self._locate()
        except BaseException:
            self.close()
            raise
        self._said.booting = False
        banner = self._said.banner
        homed = status.state is State.IDLE and banner is None and self._inside_travel()
        firmware = f"{banner.firmware} {banner.version}" if banner else "Grbl 1.1"
        if homed:
            self._protect()
        self._homed = homed
        self.report = StageReport(firmware, str(status.state), self._homed, dict(self._said.values), self._setup.notes)
        self._link.note("connected", f"{self.port.address}: {firmware} is {status.state}, homed: {self._homed}.")
        return self.report

    def home(self) -> None:
        """Homes the stage: moves to the limit switches, which makes the position known. Never done unless requested.

        After an alarm the controller is reset first, as it may accept nothing else.

        Raises:
            StageAlarm: A switch was not found or not released.
            RigError: The controller failed, or homing timed out and the controller was reset.
        """
        setup = self._connected()
        self._homed = False
        self._rest = None
        if isinstance(self._said.trouble, StageAlarm):
            self._link.restart(self._settings.boot_s)
        self._said.trouble = None
        asked_s = self._loop.now
        try:
            answered = self._link.ask(grbl.HOME, self._settings.homing_s)
            status = self._link.poll()
        except StageFault:
            raise
        except BaseException:
            self._link.halt("homing was interrupted and the controller reset")
            raise
        at_home = all(self._near(axis, axis.home_mm) for axis in (setup.x, setup.y))
        if answered and not at_home and self._loop.now - asked_s < _HOMING_S:
            raise StageFault(f"{self.port.address}: the controller answered without homing; home it again.")
        if status.state is not State.IDLE or not (answered or at_home):
            self._link.halt("homing did not end and the controller was reset")
            raise NoAnswer(
                f"{self.port.address}: homing did not end within {self._settings.homing_s:g} s (state {status.state}); "
                f"the controller was reset, home it again."
            )
        if not answered:
            self._link.note("lost ok", f"{self.port.address}: homing ended without an ok.")
        self._protect()
        self._homed = True
        self._locate()

    def move(self, x_mm: float | None = None, y_mm: float | None = None, speed_mm_s: float | None = None) -> None:
        """Moves to a position in the rig frame and returns on arrival.

        Args:
            x_mm: Target along x; None to keep x.
            y_mm: Target along y; None to keep y.
            speed_mm_s: Speed; default: that of the slowest moving axis.

        Raises:
            OutOfLimits: The target or the speed is outside the limits; nothing was sent.
            PositionUnknown: The stage must be homed first; nothing was sent.
            RigError: The controller failed, or the stage is not at the target.
        """
        axes = ((x_mm, self._settings.x), (y_mm, self._settings.y))
        speeds = [axis.speed_mm_s for target, axis in axes if target is not None]
        if not speeds:
            raise ValueError("Pass x_mm or y_mm.")
        self._follow([Leg(x_mm, y_mm, min(speeds) if speed_mm_s is None else speed_mm_s)])

    def path(self, points: Sequence[tuple[float, float, float]]) -> None:
        """Moves through points without waiting between them, and returns on arrival at the last.

        Args:
            points: x and y in mm of the rig frame, and speed of the move to there in mm/s.

        Raises:
            RigError: As `move`; the limits of all points are checked before anything is sent.
        """
        if not points:
            raise ValueError("A path needs at least one point.")
        self._follow([Leg(*point) for point in points])

    def stop(self) -> None:
        """Cancels all jogs and returns when the stage is at rest.

        A cancel that arrives before a line in transit becomes a jog is ignored, so it is repeated until the controller
        is Idle; a report may be damaged, so two in succession must be of one place.

        Raises:
            RigError: The controller failed or did not stop.
        """
        setup, self._rest, last = self._connected(), None, None
        braking_s = max(axis.limits.rate_mm_s / axis.limits.acceleration_mm_s2 for axis in (setup.x, setup.y))
        until = self._loop.now + braking_s + _MARGIN_S
        self._link.write(grbl.JOG_CANCEL)
        while True:
            status = self._link.poll()
            place = self._said.machine if status.state is State.IDLE else None
            if place is not None and place == last:
                return
            if self._loop.now >= until:
                why = f"the stage did not stop (state {status.state}); it is {self._place()}"
                raise StageFault(f"{self.port.address}: {why}; {remedy(status.state)}.")
            if place is None:
                self._link.write(grbl.JOG_CANCEL + (grbl.HOLD if status.state is State.RUN else b""))
            last = place

    def check(self, now_s: float) -> None:  # noqa: ARG002 - the signature of a guard
        """Guard for the loop; between motions it also asks for reports.

        Raises:
            PortLost: The port was lost.
            StageAlarm: The controller stopped with an alarm.
            StageFault: It restarted, or two successive reports show that it moves without a command.
        """
        self._link.check()
        if self._rest is None:
            return
        self._link.request(MOVING_POLL_S if self._strayed else POLL_S)
        if self._strayed > 1:
            self._rest = None
            raise StageFault(f"{self.port.address}: the stage moved without a command; it is {self._place()}.")

    def close(self) -> None:
        """Closes the port; a move in progress ends by itself."""
        self._link.close()

    def _read_values(self) -> dict[int, float]:
        needed = needed_settings(self._settings)
        for _ in range(_ATTEMPTS):
            if needed <= self._said.values.keys():
                return self._said.values
            self._said.values.clear()
            self._link.ask(grbl.SETTINGS, _SETTINGS_S)
        missing = ", ".join(f"${number}" for number in sorted(needed - self._said.values.keys()))
        raise WrongDevice(f"{self.port.address}: the answer to $$ is incomplete; missing: {missing or 'ok'}.")

    def _locate(self) -> StatusReport:
        """Report after which the machine position is known."""
        for _ in range(_OFFSET_POLLS):
            status = self._link.poll()
            if self._said.machine is not None:
                return status
        raise NoAnswer(f"{self.port.address}: the controller reports work positions ($10) but not their offset (WCO).")

    def _inside_travel(self) -> bool:
        """Whether the position is within the travel, as after homing."""
        setup, machine = self._connected(), self._said.machine
        axes = (setup.x, setup.y)
        return machine is not None and all(
            -axis.travel_mm - self._tolerance(axis) <= machine[axis.number] <= self._tolerance(axis) for axis in axes
        )

    def _connected(self) -> Setup:
        if self._setup is None:
            raise PositionUnknown(f"{self.port.address}: the stage is not connected.")
        return self._setup

    def _known_position(self) -> tuple[float, float]:
        self._link.check()
        if self._homed and self._said.machine is None:
            self._link.poll()
        if (position := self.position_mm) is None:
            raise PositionUnknown(f"{self.port.address}: position unknown; home the stage first.")
        return position

    def _protect(self) -> None:
        """Cancels G-code's motion mode and sets millimetres, as the commands of a motion rely on both.

        Raises:
            StageFault: The controller does not confirm it.
        """
        for _ in range(_ATTEMPTS):
            self._said.modes = frozenset()
            with suppress(CommandRefused):
                told = self._link.ask(grbl.NO_MOTION) and self._link.ask(grbl.PARSER_STATE)
                if told and self._said.modes >= {"G80", "G21"} and self._link.poll().state is State.IDLE:
                    return
        why = f"the controller does not confirm G80 and G21 (state {(state := self._link.poll().state)})"
        raise StageFault(f"{self.port.address}: {why}; {remedy(state)}.")

    def _follow(self, legs: Sequence[Leg]) -> None:
        """Sends jogs in succession and waits for the end of the last.

        All but the first are relative to the one before, so that any damage of one shows in the end position.
        """
        setup = self._connected()
        for leg in legs:
            check_limits(leg, self._settings, setup)
        at = self._known_position()
        self._rest, self._strayed = None, 0
        earliest_s = latest_s = self._loop.now
        course = MotionCourse(self._machine())
        limits: list[AxisLimits | None] = [None] * 3
        limits[setup.x.number], limits[setup.y.number] = setup.x.limits, setup.y.limits
        for i, leg in enumerate(legs):
            shortest_s, longest_s = leg_time(leg, at, setup)
            earliest_s += shortest_s
            latest_s += _SLOWER * longest_s + _MARGIN_S
            start, end = course.end, machine_end(leg, course.end, self._settings, setup)
            course.add(end, leg.speed_mm_s, limits)
            x, y, z = (b - a for a, b in zip(start, end, strict=True)) if i else end
            if not self._link.ask(grbl.jog(60.0 * leg.speed_mm_s, (x, y, z), relative=i > 0)):
                self._finish(leg, course, earliest_s, latest_s)
                self._link.note("lost ok", f"{self.port.address}: a jog ended without an ok.")
            at = leg.end(at)
        self._finish(legs[-1], course, earliest_s, latest_s)
        self._rest = self._machine()

    def _finish(self, leg: Leg, course: MotionCourse, earliest_s: float, latest_s: float) -> None:
        """Waits for the end of a motion.

        Raises:
            StageFault: The stage left its path and was stopped, or is elsewhere or still moving at the latest time.
        """
        idle, moved_s = 0, self._loop.now
        while idle < 2:
            status = self._report(leg, course)
            there, rests = self._at(course.end), status.state not in (State.JOG, State.RUN)
            ended = status.state is State.IDLE and there and self._loop.now >= earliest_s
            self.counts.false_idle += status.state is State.IDLE and not ended
            idle = idle + 1 if ended else 0
            if there or not rests:
                moved_s = self._loop.now
            if not idle and self._loop.now >= min(latest_s, moved_s + _REST_S):
                raise StageFault(
                    f"{self.port.address}: the stage should be at {leg}, but is {self._place()} (state {status.state})."
                )

    def _report(self, leg: Leg, course: MotionCourse) -> StatusReport:
        """Next report of a motion.

        Raises:
            StageFault: Two successive reports do not belong to the motion; the stage was stopped.
        """
        for after_s in (MOVING_POLL_S, 0.0):  # one report may be damaged itself
            status = self._link.poll(after_s)
            if (objection := course.objection(status, self._machine())) is None:
                return status
        self.stop()
        raise StageFault(
            f"{self.port.address}: the stage {objection} on its way to {leg} and was stopped; it is {self._place()}; "
            f"its hold was pressed, a command was damaged on the line, or the controller does not obey."
        )

    def _machine(self) -> Vector:
        if self._said.machine is None:
            raise PositionUnknown(f"{self.port.address}: position unknown; home the stage first.")
        return self._said.machine

    def _at(self, place: Vector) -> bool:
        """Whether the last report is of a machine position."""
        setup = self._connected()
        tolerances = {axis.number: self._tolerance(axis) for axis in (setup.x, setup.y)}
        off_mm = [abs(a - b) for a, b in zip(self._machine(), place, strict=True)]
        return all(mm <= tolerances.get(axis, _UNUSED_MM) for axis, mm in enumerate(off_mm))

    def _place(self) -> str:
        if (position := self.position_mm) is None:
            return "at an unknown position"
        return f"at x = {position[0]:z.3f}, y = {position[1]:z.3f} mm"

    def _near(self, axis: AxisSetup, target_mm: float) -> bool:
        machine = self._said.machine
        return machine is not None and abs(machine[axis.number] - target_mm) <= self._tolerance(axis)

    def _tolerance(self, axis: AxisSetup) -> float:
        """Half a motor step plus rounding of the report, in mm."""
        return 0.5 / axis.steps_per_mm + _PRINTED_MM

    def _take_status(self, status: StatusReport) -> None:
        if self._rest is not None and self._said.machine is not None:
            strays = math.dist(self._rest, self._said.machine) > CORRIDOR_MM
            self._strayed = self._strayed + 1 if strays else 0
        self._journal.status(self._loop.now, str(status.state), self.position_mm)
