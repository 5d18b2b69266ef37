"""Duration of a move: a trapezoidal speed profile within the rate and acceleration of each axis.

GRBL slows a straight move until no axis exceeds its limits (planner.c). Successive moves take at most the sum of their
durations, as a controller may pass from one to the next without stopping.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple


class AxisLimits(NamedTuple):
    """Limits of an axis in the controller.

    Attributes:
        rate_mm_s: Maximum speed.
        acceleration_mm_s2: Maximum acceleration.
    """

    rate_mm_s: float
    acceleration_mm_s2: float


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
