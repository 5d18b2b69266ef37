"""One straight move of the stage: its limits, its command and its time."""

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
    """What a move means for one axis.

    Attributes:
        name: `"x"` or `"y"`.
        to_mm: Target in the rig frame.
        axis: How the axis lies.
        setup: What the controller knows of it.
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
        x_mm: Where to along x; None leaves it.
        y_mm: Where to along y; None leaves it.
        speed_mm_s: Speed along the way.
    """

    x_mm: float | None
    y_mm: float | None
    speed_mm_s: float

    def sides(self, settings: StageSettings, setup: Setup) -> Iterator[Side]:
        """The axes that have a target."""
        if self.x_mm is not None:
            yield Side("x", self.x_mm, settings.x, setup.x)
        if self.y_mm is not None:
            yield Side("y", self.y_mm, settings.y, setup.y)

    def end(self, start: Place) -> Place:
        """Where it leads to."""
        return start[0] if self.x_mm is None else self.x_mm, start[1] if self.y_mm is None else self.y_mm

    def __str__(self) -> str:
        named = (("x", self.x_mm), ("y", self.y_mm))
        return ", ".join(f"{name} = {mm:g}" for name, mm in named if mm is not None) + " mm"


def check_limits(leg: Leg, settings: StageSettings, setup: Setup) -> None:
    """Whether the rig may make a move.

    Raises:
        OutOfLimits: Its target lies outside the limits, or it is faster than an axis.
    """
    for name, to_mm, axis, found in leg.sides(settings, setup):
        if not axis.low_mm - _ROUNDING <= to_mm <= axis.high_mm + _ROUNDING:
            raise OutOfLimits(
                f"{settings.port}: {name} = {to_mm:g} mm lies outside the limits of the stage, {axis.low_mm:g} to "
                f"{axis.high_mm:g} mm."
            )
        if not 0 < leg.speed_mm_s <= found.limits.rate_mm_s + _ROUNDING:
            raise OutOfLimits(
                f"{settings.port}: the speed along {name} must lie above 0 and at most at {found.limits.rate_mm_s:g} "
                f"mm/s, the rate of the controller, not at {leg.speed_mm_s:g}."
            )


def jog_line(leg: Leg, settings: StageSettings, setup: Setup) -> bytes:
    """The command of a move."""
    to = {side.axis.letter: side.machine_mm for side in leg.sides(settings, setup)}
    return grbl.jog(60.0 * leg.speed_mm_s, x_mm=to.get("X"), y_mm=to.get("Y"), z_mm=to.get("Z"))


def leg_time(leg: Leg, start: Place, setup: Setup) -> tuple[float, float]:
    """Time in seconds that a move takes at least, if nothing had to accelerate, and from rest to rest."""
    way = [there - here for here, there in zip(start, leg.end(start), strict=True)]
    return math.hypot(*way) / leg.speed_mm_s, move_time(way, leg.speed_mm_s, (setup.x.limits, setup.y.limits))
