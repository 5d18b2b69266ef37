"""The xy stage behind a GRBL controller: homed on request, moved by jogs in millimetres of the rig frame.

Moves are jogs (`$J=`): one that would leave the travel is refused without an alarm, and one can be cancelled. An `ok`
only says that a move is queued, and a report of Idle may be older than the start of the motion. So a motion has ended
when two reports running say Idle at the target, neither of them before the way can have been made. What was sent is
never sent again.

Where the stage stands is known from homing until the controller restarts, stops with an alarm or is unplugged. The
position of a controller that is found Idle is believed if opening its port did not restart it: with homing on it starts
in Alarm, and leaves that by homing, or by an operator's `$X`, who then answers for the position.
"""

from collections.abc import Sequence
from typing import NamedTuple

from ..errors import NoAnswer, PositionUnknown, StageAlarm, StageFault, WrongDevice
from ..journal import Journal
from ..link.loop import Loop
from ..link.port import Port
from ..rig.settings import StageSettings
from . import grbl
from .grbl import State, StatusReport
from .grbl_link import GrblLink
from .leg import Leg, check_limits, jog_line, leg_time
from .setup import AxisSetup, Setup, check_setup, needed_settings
from .state import StageCounts

_PRINTED_MM = 0.001
_SLOWER = 1.5
_MARGIN_S = 1.0
_SETTINGS_S = 2.0
_ATTEMPTS = 3
_OFFSET_POLLS = 30  # so many reports may lack the work offset (config.h)


class StageReport(NamedTuple):
    """What was found at connection.

    Attributes:
        firmware: Name and version.
        state: What the controller did.
        homed: Whether it knows where it is.
        values: All settings, value by number.
        notes: What is allowed but may disappoint, one sentence each.
    """

    firmware: str
    state: str
    homed: bool
    values: dict[int, float]
    notes: tuple[str, ...]


class Stage:
    """Moves the rig; `connect` comes first.

    Args:
        settings: Port, axes and limits.
        loop: Waits for the controller.
        journal: Hears of commands, reports and events.
        port: Used instead of a new one.

    Attributes:
        port: Where the controller is.
        report: What `connect` found, None before.
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

    @property
    def counts(self) -> StageCounts:
        """What went wrong so far."""
        return self._said.counts

    @property
    def homed(self) -> bool:
        """Whether the controller knows where it is."""
        return self._homed and self._said.trouble is None and self.port.is_open

    @property
    def position_mm(self) -> tuple[float, float] | None:
        """Place in the rig frame by the last report, x and y; None if it is not known."""
        machine = self._said.machine
        if machine is None or self._setup is None or not self.homed:
            return None
        settings, setup = self._settings, self._setup
        return settings.x.rig_mm(machine[setup.x.number]), settings.y.rig_mm(machine[setup.y.number])

    def connect(self, will_home: bool = False) -> None:
        """Opens the port, makes sure who answers and that it is set up for the rig; nothing moves.

        Args:
            will_home: Whether `home` comes next, so that a controller which hears nothing else may be reset.

        Raises:
            PortError: The port cannot be opened.
            WrongDevice: Something else answers, or a setting does not fit; the sentence says what to send.
            RigError: The controller does not answer, or is busy.
        """
        self._homed = False
        try:
            self._link.open()
            self._link.greet(self._settings.boot_s, will_home)
            self._setup = check_setup(self._settings, self._read_values())
            status = self._locate()
        except BaseException:
            self.close()
            raise
        self._said.booting = False
        banner = self._said.banner
        self._homed = status.state is State.IDLE and banner is None and self._inside_travel()
        firmware = f"{banner.firmware if banner else 'Grbl'} {self._said.version}"
        values = dict(self._said.values)
        self.report = StageReport(firmware, str(status.state), self._homed, values, self._setup.notes)
        self._link.note("connected", f"{self.port.address}: {firmware} is {status.state}, homed: {self._homed}.")

    def home(self) -> None:
        """Moves to the limit switches, so that the controller knows where it is; only when somebody asks for it.

        After an alarm the controller is reset first, as it may hear nothing else.

        Raises:
            StageAlarm: A switch was not found or not left.
            RigError: The controller failed, or did not end in time; it was reset to stop it.
        """
        setup = self._connected()
        self._homed = False
        if isinstance(self._said.trouble, StageAlarm):
            self._link.restart(self._settings.boot_s)
        self._said.trouble = None
        try:
            answered = self._link.ask(grbl.HOME, self._settings.homing_s)
            status = self._link.poll()
        except StageFault:
            raise
        except BaseException:
            self._link.halt("homing was interrupted and the controller reset")
            raise
        at_home = all(self._near(axis, axis.home_mm) for axis in (setup.x, setup.y))
        if status.state is not State.IDLE or not (answered or at_home):
            self._link.halt("homing did not end and the controller was reset")
            raise NoAnswer(
                f"{self.port.address}: homing should end within {self._settings.homing_s:g} s, and the controller is "
                f"in state {status.state}; it was reset, home it again."
            )
        if not answered:
            self._link.note("lost ok", f"{self.port.address}: homing ended and nobody said so.")
        self._homed = True
        self._locate()

    def move(self, x_mm: float | None = None, y_mm: float | None = None, speed_mm_s: float | None = None) -> None:
        """Moves to a place in the rig frame and returns when it stands there.

        Args:
            x_mm: Where to along x; None leaves it.
            y_mm: Where to along y; None leaves it.
            speed_mm_s: Speed; default that of the slowest axis that moves.

        Raises:
            OutOfLimits: The place or the speed is beyond the limits; nothing was sent.
            PositionUnknown: It must be homed first; nothing was sent.
            RigError: The controller failed, or the stage does not stand where it should.
        """
        axes = ((x_mm, self._settings.x), (y_mm, self._settings.y))
        speeds = [axis.speed_mm_s for target, axis in axes if target is not None]
        if not speeds:
            raise ValueError("A move needs x_mm or y_mm.")
        self._follow([Leg(x_mm, y_mm, min(speeds) if speed_mm_s is None else speed_mm_s)])

    def path(self, points: Sequence[tuple[float, float, float]]) -> None:
        """Moves through places without waiting between them, and returns when it stands at the last.

        Args:
            points: x and y in mm of the rig frame, and the speed of the way to there in mm/s.

        Raises:
            RigError: As `move`; the limits of all points are checked before anything is sent.
        """
        if not points:
            raise ValueError("A path needs a point.")
        self._follow([Leg(*point) for point in points])

    def stop(self) -> None:
        """Cancels all jogs and returns when the stage stands still.

        A cancel that comes before a line in transit has become a jog is not heard, so it is said until the controller
        is Idle twice running.

        Raises:
            RigError: The controller failed or does not stop.
        """
        setup = self._connected()
        braking_s = max(axis.limits.rate_mm_s / axis.limits.acceleration_mm_s2 for axis in (setup.x, setup.y))
        until = self._loop.now + braking_s + _MARGIN_S
        self._link.write(grbl.JOG_CANCEL)
        idle = 0
        while idle < 2:
            status = self._link.poll()
            idle = idle + 1 if status.state is State.IDLE else 0
            if not idle and self._loop.now >= until:
                raise StageFault(f"{self.port.address}: the stage should stop, and is in state {status.state}.")
            if not idle:
                self._link.write(grbl.JOG_CANCEL)

    def check(self, now_s: float) -> None:  # noqa: ARG002 - the signature of a guard
        """A guard for the loop.

        Raises:
            PortLost: The port vanished.
            StageAlarm: The controller stopped with an alarm.
            StageFault: It restarted.
        """
        self._link.check()

    def close(self) -> None:
        """Lets go of the port; what moves ends by itself."""
        self._link.close()

    def _read_values(self) -> dict[int, float]:
        needed = needed_settings(self._settings)
        for _ in range(_ATTEMPTS):
            self._said.values.clear()
            if self._link.ask(grbl.SETTINGS, _SETTINGS_S) and needed <= self._said.values.keys():
                return self._said.values
        missing = ", ".join(f"${number}" for number in sorted(needed - self._said.values.keys()))
        raise WrongDevice(
            f"{self.port.address}: the answer to $$ should end in ok and have all settings, not lack {missing}."
        )

    def _locate(self) -> StatusReport:
        """A report after which the machine position is known."""
        for _ in range(_OFFSET_POLLS):
            status = self._link.poll()
            if self._said.machine is not None:
                return status
        raise NoAnswer(
            f"{self.port.address}: the controller reports work positions ($10) and never their offset (WCO)."
        )

    def _inside_travel(self) -> bool:
        """Whether homing can have led to this position."""
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
            raise PositionUnknown(f"{self.port.address}: the stage does not know where it is; home it first.")
        return position

    def _follow(self, legs: Sequence[Leg]) -> None:
        """Sends jogs one behind another and waits for the end of the last."""
        setup = self._connected()
        for leg in legs:
            check_limits(leg, self._settings, setup)
        at = self._known_position()
        earliest_s = latest_s = self._loop.now
        for leg in legs:
            shortest_s, longest_s = leg_time(leg, at, setup)
            earliest_s += shortest_s
            latest_s += _SLOWER * longest_s + _MARGIN_S
            if not self._link.ask(jog_line(leg, self._settings, setup)):
                self._finish(leg, earliest_s, latest_s)
                self._link.note("lost ok", f"{self.port.address}: a jog was made, and its ok never came.")
            at = leg.end(at)
        self._finish(legs[-1], earliest_s, latest_s)

    def _finish(self, leg: Leg, earliest_s: float, latest_s: float) -> None:
        """Waits for the end of a motion.

        Raises:
            StageFault: It stands elsewhere, or moves, at the latest time.
        """
        sides, idle = list(leg.sides(self._settings, self._connected())), 0
        while idle < 2:
            status = self._link.poll()
            there = all(self._near(side.setup, side.machine_mm) for side in sides)
            ended = status.state is State.IDLE and there and self._loop.now >= earliest_s
            self.counts.false_idle += status.state is State.IDLE and not ended
            idle = idle + 1 if ended else 0
            if not idle and self._loop.now >= latest_s:
                raise StageFault(
                    f"{self.port.address}: the stage should stand at {leg}, and is {self._place()} in state "
                    f"{status.state}."
                )

    def _place(self) -> str:
        if (position := self.position_mm) is None:
            return "at an unknown place"
        return f"at x = {position[0]:z.3f}, y = {position[1]:z.3f} mm"

    def _near(self, axis: AxisSetup, target_mm: float) -> bool:
        machine = self._said.machine
        return machine is not None and abs(machine[axis.number] - target_mm) <= self._tolerance(axis)

    def _tolerance(self, axis: AxisSetup) -> float:
        """Half a motor step and what printing rounds away."""
        return 0.5 / axis.steps_per_mm + _PRINTED_MM

    def _take_status(self, status: StatusReport) -> None:
        self._journal.status(self._loop.now, str(status.state), self.position_mm)
