"""Straight moves of the stage within the settings of its controller: limits, command and duration.

The rig never changes a setting: they are stored in the controller, other programs rely on them, and bytes that arrive
during a write are lost. Messages say what to send instead.

GRBL slows a straight move until no axis exceeds its limits (planner.c). Successive moves take at most the sum of their
durations, as a controller may pass from one to the next without stopping.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from ..errors import OutOfLimits, WrongDevice
from ..rig.settings import AxisSettings, RigFile, StageSettings
from . import grbl

IDLE_DELAY, REPORT, INCHES, SOFT_LIMITS, HARD_LIMITS, HOMING, HOMING_SIDE, PULL_OFF = 1, 10, 13, 20, 21, 22, 23, 27
STEPS, RATE, ACCELERATION, TRAVEL = 100, 110, 120, 130
"""Numbers of settings; these four are for X, followed by Y and Z (setting_codes_en_US.csv)."""

_ALWAYS_ON = 255
_BEYOND_MM = 0.05
_LEAST_STEPS = 10.0  # half a step within the corridor of a path


class AxisLimits(NamedTuple):
    """Limits of an axis in the controller.

    Attributes:
        rate_mm_s: Maximum speed.
        acceleration_mm_s2: Maximum acceleration.
    """

    rate_mm_s: float
    acceleration_mm_s2: float


class AxisSetup(NamedTuple):
    """Settings of an axis in the controller.

    Attributes:
        number: 0, 1, 2 for X, Y, Z.
        steps_per_mm: Motor steps per mm.
        limits: Rate and acceleration.
        travel_mm: Travel; machine coordinates range from `-travel_mm` to 0.
        home_mm: Machine coordinate at which homing ends.
    """

    number: int
    steps_per_mm: float
    limits: AxisLimits
    travel_mm: float
    home_mm: float


class Setup(NamedTuple):
    """Both axes of the rig.

    Attributes:
        x: The axis along the finger.
        y: The axis of the tap.
        notes: Warnings, one sentence each.
    """

    x: AxisSetup
    y: AxisSetup
    notes: tuple[str, ...]


def needed_settings(settings: StageSettings) -> frozenset[int]:
    """Numbers of the settings required in an answer to `$$`."""
    indices = ["XYZ".index(axis.letter) for axis in (settings.x, settings.y)]
    return frozenset(
        {INCHES, REPORT, SOFT_LIMITS, HOMING, HOMING_SIDE, PULL_OFF}
        | {first + index for first in (STEPS, RATE, ACCELERATION, TRAVEL) for index in indices}
    )


def check_setup(settings: StageSettings, values: Mapping[int, float], will_home: bool = False) -> Setup:
    """Axes of a controller with settings that suit the rig.

    Args:
        settings: Settings of the stage.
        values: Settings of the controller by number, at least `needed_settings`.
        will_home: Whether the stage is to be homed.

    Raises:
        OutOfLimits: Homing would end beyond the object, and the settings do not allow it.
        WrongDevice: A setting does not suit; the message names it and what to send.
    """
    port = settings.port
    if values[INCHES]:
        raise WrongDevice(f"{port}: the controller reports inches ($13={values[INCHES]:g}); send $13=0.")
    if not int(values[HOMING]) & 1:
        raise WrongDevice(
            f"{port}: homing is off ($22={values[HOMING]:g}), so the position is never known; fit limit switches and "
            f"send $22=1."
        )
    if not values[SOFT_LIMITS]:
        raise WrongDevice(f"{port}: soft limits are off ($20=0); send $20=1.")
    x = _axis(port, "x", settings.x, values)
    y = _axis(port, "y", settings.y, values)
    home_mm = settings.y.rig_mm(y.home_mm)
    if will_home and home_mm > settings.y.high_mm and not settings.homes_past_object:
        raise OutOfLimits(
            f"{port}: homing would end at y = {home_mm:g} mm, beyond the object; correct stage.y.direction or the side "
            f"of the switch ($23), or set stage.homes_past_object = true if the path is clear."
        )
    return Setup(x, y, tuple(_notes(settings, y, values)))


def _axis(port: str, name: str, axis: AxisSettings, values: Mapping[int, float]) -> AxisSetup:
    index = "XYZ".index(axis.letter)
    for first, what in ((STEPS, "steps"), (RATE, "rate"), (ACCELERATION, "acceleration"), (TRAVEL, "travel")):
        if not values[first + index] > 0:
            raise WrongDevice(
                f"{port}: the {what} of {axis.letter} must be above 0, got ${first + index}={values[first + index]:g}."
            )
    if values[STEPS + index] < _LEAST_STEPS:
        raise WrongDevice(
            f"{port}: {axis.letter} has {values[STEPS + index]:g} steps per mm (${STEPS + index}), too few to watch "
            f"its path; at least {_LEAST_STEPS:g} are needed."
        )
    rate, travel = values[RATE + index] / 60.0, values[TRAVEL + index]
    _check_rate(port, f"stage.{name}.speed_mm_s", axis.speed_mm_s, axis, values)
    ends = sorted((axis.machine_mm(axis.low_mm), axis.machine_mm(axis.high_mm)))
    if ends[0] < -travel - _ROUNDING or ends[1] > _ROUNDING:
        raise WrongDevice(
            f"{port}: the limits of stage.{name} are {ends[0]:g} to {ends[1]:g} mm in machine coordinates, outside the "
            f"travel of {axis.letter}, {-travel:g} to 0 mm (${TRAVEL + index}={travel:g}); change the limits or "
            f"origin_mm."
        )
    low_side = int(values[HOMING_SIDE]) >> index & 1
    home = values[PULL_OFF] - travel if low_side else -values[PULL_OFF]
    limits = AxisLimits(rate, values[ACCELERATION + index])
    return AxisSetup(index, values[STEPS + index], limits, travel, home)


def check_tap_speed(settings: RigFile, values: Mapping[int, float]) -> None:
    """Checks that the controller makes taps as fast as the settings ask for.

    Args:
        settings: Settings of the rig.
        values: Settings of the controller by number.

    Raises:
        WrongDevice: The speed of a tap is above the maximum rate of y.
    """
    if settings.tap.speed_mm_s is not None:
        _check_rate(settings.stage.port, "tap.speed_mm_s", settings.tap.speed_mm_s, settings.stage.y, values)


def _check_rate(port: str, key: str, speed_mm_s: float, axis: AxisSettings, values: Mapping[int, float]) -> None:
    number = RATE + "XYZ".index(axis.letter)
    most_mm_s = values[number] / 60.0
    if speed_mm_s > most_mm_s + _ROUNDING:
        raise WrongDevice(
            f"{port}: {key}={speed_mm_s:g} exceeds the maximum of {axis.letter}, {most_mm_s:g} mm/s "
            f"(${number}={values[number]:g} mm/min); lower it or send ${number}={60 * speed_mm_s:g}."
        )


def _notes(settings: StageSettings, y: AxisSetup, values: Mapping[int, float]) -> Sequence[str]:
    notes = []
    if values.get(IDLE_DELAY, _ALWAYS_ON) != _ALWAYS_ON:
        notes.append(f"the motors are released {values[IDLE_DELAY]:g} ms after each move; $1=255 keeps them on")
    if not values.get(HARD_LIMITS, 1):
        notes.append("limit switches do not stop the stage; $21=1 enables this")
    if (home_mm := settings.y.rig_mm(y.home_mm)) > settings.y.high_mm:
        notes.append(
            f"homing ends at y = {home_mm:g} mm, beyond high_mm on the side of the object; keep the path clear"
        )
    return notes


def trapezoid_time(distance_mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> float:
    """Duration in seconds from rest to rest; short moves do not reach their speed.

    Args:
        distance_mm: Distance, at least 0.
        speed_mm_s: Cruising speed, above 0.
        acceleration_mm_s2: Acceleration and deceleration, above 0.
    """
    ramps_mm = speed_mm_s**2 / acceleration_mm_s2
    if distance_mm < ramps_mm:
        return 2.0 * math.sqrt(distance_mm / acceleration_mm_s2)
    return distance_mm / speed_mm_s + speed_mm_s / acceleration_mm_s2


def move_time(way_mm: Sequence[float], speed_mm_s: float, axes: Sequence[AxisLimits]) -> float:
    """Duration in seconds of a straight move from rest to rest.

    Args:
        way_mm: Displacement along each axis.
        speed_mm_s: Speed along the path, which the limits of the axes may lower.
        axes: Limits of each axis.
    """
    distance = math.hypot(*way_mm)
    if distance == 0:
        return 0.0
    shares = [(abs(mm) / distance, axis) for mm, axis in zip(way_mm, axes, strict=True) if mm]
    speed = min(speed_mm_s, *(axis.rate_mm_s / share for share, axis in shares))
    return trapezoid_time(distance, speed, min(axis.acceleration_mm_s2 / share for share, axis in shares))


Place = tuple[float, float]
"""x and y in mm of the rig frame."""

_ROUNDING = 1e-6


class Side(NamedTuple):
    """Component of a move along one axis.

    Attributes:
        name: `"x"` or `"y"`.
        to_mm: Target in the rig frame.
        axis: Settings of the axis.
        setup: Settings of the axis in the controller.
    """

    name: str
    to_mm: float
    axis: AxisSettings
    setup: AxisSetup

    @property
    def machine_mm(self) -> float:
        """Target in machine coordinates."""
        return self.axis.machine_mm(self.to_mm)


class Leg(NamedTuple):
    """A straight move in the rig frame.

    Attributes:
        x_mm: Target along x; None to keep x.
        y_mm: Target along y; None to keep y.
        speed_mm_s: Speed along the path.
    """

    x_mm: float | None
    y_mm: float | None
    speed_mm_s: float

    def sides(self, settings: StageSettings, setup: Setup) -> Iterator[Side]:
        """Components along the axes that have a target."""
        if self.x_mm is not None:
            yield Side("x", self.x_mm, settings.x, setup.x)
        if self.y_mm is not None:
            yield Side("y", self.y_mm, settings.y, setup.y)

    def end(self, start: Place) -> Place:
        """End point in mm of the rig frame."""
        return start[0] if self.x_mm is None else self.x_mm, start[1] if self.y_mm is None else self.y_mm

    def __str__(self) -> str:
        named = (("x", self.x_mm), ("y", self.y_mm))
        return ", ".join(f"{name} = {mm:g}" for name, mm in named if mm is not None) + " mm"


def check_limits(leg: Leg, settings: StageSettings, setup: Setup) -> None:
    """Checks that a move is within the limits of the rig.

    Raises:
        OutOfLimits: The target is outside the limits, or the speed above that of an axis.
    """
    for name, to_mm, axis, found in leg.sides(settings, setup):
        if not axis.low_mm - _ROUNDING <= to_mm <= axis.high_mm + _ROUNDING:
            raise OutOfLimits(
                f"{settings.port}: {name} = {to_mm:g} mm is outside the limits of the stage, {axis.low_mm:g} to "
                f"{axis.high_mm:g} mm."
            )
        if not 0 < leg.speed_mm_s <= found.limits.rate_mm_s + _ROUNDING:
            raise OutOfLimits(
                f"{settings.port}: the speed along {name} must be above 0 and at most {found.limits.rate_mm_s:g} mm/s, "
                f"the maximum rate of the controller, got {leg.speed_mm_s:g}."
            )


def check_side(settings: StageSettings, y_mm: float) -> None:
    """Checks that the way from here to a place clear of the object cannot lead through the object.

    Raises:
        OutOfLimits: The finger is beyond the limits of y on the side of the object, and the settings do not allow it.
    """
    high_mm = settings.y.high_mm
    if y_mm > high_mm + _BEYOND_MM and not settings.homes_past_object:
        raise OutOfLimits(
            f"{settings.port}: the finger is at y = {y_mm:.1f} mm, beyond stage.y.high_mm = {high_mm:g} on the side of "
            f"the object; take it back by hand and home it, or set stage.homes_past_object = true."
        )


def machine_end(leg: Leg, start: grbl.Vector, settings: StageSettings, setup: Setup) -> grbl.Vector:
    """End of a move in machine coordinates; axes without a target stay."""
    to = {side.setup.number: side.machine_mm for side in leg.sides(settings, setup)}
    x, y, z = (round(to.get(axis, mm), 4) for axis, mm in enumerate(start))
    return x, y, z


def leg_time(leg: Leg, start: Place, setup: Setup) -> tuple[float, float]:
    """Duration of a move in seconds: a lower bound without acceleration, and from rest to rest."""
    way = [there - here for here, there in zip(start, leg.end(start), strict=True)]
    return math.hypot(*way) / leg.speed_mm_s, move_time(way, leg.speed_mm_s, (setup.x.limits, setup.y.limits))
