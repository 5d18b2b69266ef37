"""Course of a motion: the path that was commanded, against which every status report is checked.

A command may be damaged on its way to the controller and still be a valid command, of another motion. A report shows
where the stage really is, and how fast; the course says whether it belongs to the commanded motion.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from .grbl import StatusReport, Vector
from .leg import AxisLimits

CORRIDOR_MM = 0.05
"""Largest distance of the stage from its commanded path, above half a motor step."""
SPEED_TOLERANCE = 0.02
_SPEED_MARGIN_MM_S = 0.1  # a report has whole mm/min
_AHEAD_S = 0.08  # reported speed is that of the newest prepared segment, up to 60 ms ahead (stepper.c)


class _Line(NamedTuple):
    start: Vector
    end: Vector
    speed_mm_s: float
    ramp_mm: float

    def along_mm(self, at: Vector) -> float:
        """Distance from the start of the nearest point."""
        length = math.dist(self.start, self.end)
        if length == 0.0:
            return 0.0
        way = sum((b - a) * (p - a) for a, b, p in zip(self.start, self.end, at, strict=True))
        return min(max(way / length, 0.0), length)

    def distance_mm(self, at: Vector) -> float:
        """Distance from the line."""
        length = math.dist(self.start, self.end) or 1.0
        share = self.along_mm(at) / length
        return math.dist(at, [a + (b - a) * share for a, b in zip(self.start, self.end, strict=True)])

    def cruises(self, at: Vector) -> bool:
        """Whether the speed reported here is the commanded one, as it is away from both ends."""
        left_mm = math.dist(self.start, self.end) - self.along_mm(at)
        ends_mm = self.ramp_mm + _AHEAD_S * self.speed_mm_s
        return self.along_mm(at) > self.ramp_mm and left_mm > ends_mm


class MotionCourse:
    """Commanded motion in machine coordinates, in mm.

    Args:
        start: Position before it.

    Attributes:
        end: Position at its end.
    """

    def __init__(self, start: Vector) -> None:
        self.end = start
        self._lines: list[_Line] = []

    def add(self, end: Vector, speed_mm_s: float, axes: Sequence[AxisLimits | None]) -> None:
        """Appends a straight move.

        Args:
            end: Its end.
            speed_mm_s: Commanded speed.
            axes: Limits of X, Y and Z; None where unknown.
        """
        way = [b - a for a, b in zip(self.end, end, strict=True)]
        length = math.hypot(*way) or 1.0
        shares = [(abs(mm) / length, axis) for mm, axis in zip(way, axes, strict=True) if mm and axis]
        speed = min([speed_mm_s, *(axis.rate_mm_s / share for share, axis in shares)])
        slowest = min([math.inf, *(axis.acceleration_mm_s2 / share for share, axis in shares)])
        self._lines.append(_Line(self.end, end, speed, speed**2 / (2 * slowest)))
        self.end = end

    def objection(self, report: StatusReport, at: Vector) -> str | None:
        """Why a report cannot belong to this motion, as a clause; None if it can.

        Args:
            report: The report.
            at: Machine position in it.
        """
        lines = self._lines or [_Line(self.end, self.end, 0.0, 0.0)]
        distance = min(line.distance_mm(at) for line in lines)
        if distance > CORRIDOR_MM:
            return f"left its commanded path by {distance:.2f} mm"
        if (speed := _speed_mm_s(report)) is None:
            return None
        near = [line for line in lines if line.distance_mm(at) <= CORRIDOR_MM]
        most = max(line.speed_mm_s for line in near)
        if speed > (1 + SPEED_TOLERANCE) * most + _SPEED_MARGIN_MM_S:
            return f"moved at {speed:.2f} mm/s instead of {most:g}"
        least = min(line.speed_mm_s if line.cruises(at) else 0.0 for line in near)
        if speed < (1 - SPEED_TOLERANCE) * least - _SPEED_MARGIN_MM_S and report.state == "Jog":
            return f"moved at {speed:.2f} mm/s instead of {least:g}"
        return None


def _speed_mm_s(report: StatusReport) -> float | None:
    """Reported speed along the path; None if the controller reports none."""
    text = report.field("FS") or report.field("F") or ""
    rate = text.partition(",")[0]
    return float(rate) / 60 if rate.isdecimal() else None
