"""Check that the settings of a GRBL controller (`$$`) suit a rig.

The rig never changes a setting: they are stored in the controller, other programs rely on them, and bytes that arrive
during a write are lost. Messages say what to send instead.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..errors import WrongDevice
from ..rig.settings import AxisSettings, StageSettings
from .motion_time import AxisLimits

IDLE_DELAY, REPORT, INCHES, SOFT_LIMITS, HARD_LIMITS, HOMING, HOMING_SIDE, PULL_OFF = 1, 10, 13, 20, 21, 22, 23, 27
STEPS, RATE, ACCELERATION, TRAVEL = 100, 110, 120, 130
"""Numbers of settings; these four are for X, followed by Y and Z (setting_codes_en_US.csv)."""

_ALWAYS_ON = 255
_ROUNDING = 1e-6


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


def check_setup(settings: StageSettings, values: Mapping[int, float]) -> Setup:
    """Axes of a controller with settings that suit the rig.

    Args:
        settings: Settings of the stage.
        values: Settings of the controller by number, at least `needed_settings`.

    Raises:
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
    return Setup(x, y, tuple(_notes(settings, y, values)))


def _axis(port: str, name: str, axis: AxisSettings, values: Mapping[int, float]) -> AxisSetup:
    index = "XYZ".index(axis.letter)
    for first, what in ((STEPS, "steps"), (RATE, "rate"), (ACCELERATION, "acceleration"), (TRAVEL, "travel")):
        if not values[first + index] > 0:
            raise WrongDevice(
                f"{port}: the {what} of {axis.letter} must be above 0, got ${first + index}={values[first + index]:g}."
            )
    rate, travel = values[RATE + index] / 60.0, values[TRAVEL + index]
    if axis.speed_mm_s > rate + _ROUNDING:
        raise WrongDevice(
            f"{port}: stage.{name}.speed_mm_s={axis.speed_mm_s:g} exceeds the maximum of {axis.letter}, {rate:g} mm/s "
            f"(${RATE + index}={values[RATE + index]:g} mm/min); lower it or send "
            f"${RATE + index}={60 * axis.speed_mm_s:g}."
        )
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
