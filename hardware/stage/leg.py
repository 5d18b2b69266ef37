"""Straight move of the stage: limits, command and duration."""

import math
from collections.abc import Iterator
from typing import NamedTuple

from ..errors import OutOfLimits
from ..rig.settings import AxisSettings, StageSettings
from . import grbl
from .motion_time import move_time
from .setup import AxisSetup, Setup

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


def jog_line(leg: Leg, settings: StageSettings, setup: Setup) -> bytes:
    """Command of a move."""
    to = {side.axis.letter: side.machine_mm for side in leg.sides(settings, setup)}
    return grbl.jog(60.0 * leg.speed_mm_s, x_mm=to.get("X"), y_mm=to.get("Y"), z_mm=to.get("Z"))


def leg_time(leg: Leg, start: Place, setup: Setup) -> tuple[float, float]:
    """Duration of a move in seconds: a lower bound without acceleration, and from rest to rest."""
    way = [there - here for here, there in zip(start, leg.end(start), strict=True)]
    return math.hypot(*way) / leg.speed_mm_s, move_time(way, leg.speed_mm_s, (setup.x.limits, setup.y.limits))
