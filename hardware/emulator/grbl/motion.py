"""Motion of an emulated stage: straight lines with trapezoidal speed profiles, in whole motor steps.

Lines run back to back, and the machine comes to rest between them. Real controllers pass through the junction of two
lines in the same direction; a tap, which reverses, is not affected.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

Vector = tuple[float, float, float]
"""x, y, z in millimetres or steps."""
Steps = tuple[int, int, int]

_SINGLE = np.float32

BLOCKS = 15
"""Lines that a controller queues, including the current one (planner.h)."""


class MotionLimits(NamedTuple):
    """Limits of the axes.

    Attributes:
        steps_per_mm: Steps of the motor per millimetre.
        speed_mm_s: Highest speed.
        acceleration_mm_s2: Acceleration, the same for speeding up and for braking.
    """

    steps_per_mm: Vector
    speed_mm_s: Vector
    acceleration_mm_s2: Vector

    def steps(self, place_mm: Vector) -> Steps:
        """Steps nearest to a position; half a step, in single precision, counts as one, as in GRBL."""
        x, y, z = (
            _rounded(float(_SINGLE(mm) * _SINGLE(steps))) for mm, steps in zip(place_mm, self.steps_per_mm, strict=True)
        )
        return x, y, z

    def mm(self, place: Vector) -> Vector:
        """Position in mm of a position in steps."""
        (x, y, z), (per_x, per_y, per_z) = place, self.steps_per_mm
        return x / per_x, y / per_y, z / per_z


class Trapezoid(NamedTuple):
    """Distance over time from rest to rest.

    Attributes:
        length_mm: Total distance.
        peak_mm_s: Highest speed reached.
        acceleration_mm_s2: Acceleration, the same for speeding up and for braking.
        duration_s: Time from rest to rest.
    """

    length_mm: float
    peak_mm_s: float
    acceleration_mm_s2: float
    duration_s: float

    def travelled_mm(self, time_s: float) -> float:
        """Distance travelled at a time since the start, in mm."""
        left_s, ramp_s = self.duration_s - time_s, self.peak_mm_s / self.acceleration_mm_s2
        if time_s <= 0.0 or left_s <= 0.0:
            return 0.0 if time_s <= 0.0 else self.length_mm
        if time_s < ramp_s:
            return self.acceleration_mm_s2 * time_s * time_s / 2
        if left_s < ramp_s:
            return self.length_mm - self.acceleration_mm_s2 * left_s * left_s / 2
        return self.peak_mm_s * (time_s - ramp_s / 2)

    def speed_mm_s(self, time_s: float) -> float:
        """Speed at a time since the start, in mm/s."""
        ramp_s = min(time_s, self.duration_s - time_s)
        return max(0.0, min(self.peak_mm_s, self.acceleration_mm_s2 * ramp_s))

    def braked(self, time_s: float) -> "Trapezoid":
        """The same profile up to a time, then the shortest to rest: again a trapezoid."""
        braking_mm = self.speed_mm_s(time_s) ** 2 / (2 * self.acceleration_mm_s2)
        length_mm = min(self.length_mm, self.travelled_mm(time_s) + braking_mm)
        return trapezoid(length_mm, self.peak_mm_s, self.acceleration_mm_s2)


def trapezoid(length_mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> Trapezoid:
    """Fastest profile from rest to rest; a triangle if too short to reach the speed."""
    peak_mm_s = min(speed_mm_s, math.sqrt(length_mm * acceleration_mm_s2))
    duration_s = length_mm / peak_mm_s + peak_mm_s / acceleration_mm_s2 if peak_mm_s > 0.0 else 0.0
    return Trapezoid(length_mm, peak_mm_s, acceleration_mm_s2, duration_s)


class Move(NamedTuple):
    """One line.

    Attributes:
        start: Start, in steps.
        end: End, in steps; may lie between two steps after braking.
        start_s: Start time.
        end_s: End time.
        profile: Distance over time.
        speed_mm_s: Requested speed.
    """

    start: Steps
    end: Vector
    start_s: float
    end_s: float
    profile: Trapezoid
    speed_mm_s: float

    def at(self, time_s: float) -> Steps:
        """Position in steps at a time."""
        (a, b, c), (x, y, z) = self.start, self.end
        share = self.profile.travelled_mm(time_s - self.start_s) / self.profile.length_mm
        return round(a + (x - a) * share), round(b + (y - b) * share), round(c + (z - c) * share)

    def braked(self, time_s: float) -> "Move":
        """The same line with braking from a time on."""
        profile = self.profile.braked(time_s - self.start_s)
        share = profile.length_mm / self.profile.length_mm
        x, y, z = (a + (b - a) * share for a, b in zip(self.start, self.end, strict=True))
        return self._replace(end=(x, y, z), end_s=self.start_s + profile.duration_s, profile=profile)


class Planner:
    """Queue of lines.

    Args:
        axes: Limits of the axes; to be changed at rest only.
        place: Start position, in steps.
    """

    def __init__(self, axes: MotionLimits, place: Steps) -> None:
        self.axes = axes
        self._place = place
        self._moves: deque[Move] = deque()
        self._held: deque[tuple[Vector, float]] = deque()

    def at(self, time_s: float) -> Steps:
        """Position in steps, at a time that is not past."""
        for move in self._moves:
            if time_s < move.end_s:
                return move.at(time_s)
        return _nearest(self._moves[-1].end) if self._moves else self._place

    def speed_mm_s(self, time_s: float) -> float:
        """Speed in mm/s, at a time that is not past."""
        move = next((move for move in self._moves if time_s < move.end_s), None)
        return move.profile.speed_mm_s(time_s - move.start_s) if move else 0.0

    def velocity_mm_s(self, time_s: float) -> Vector:
        """Signed speed of each axis in mm/s."""
        move = self.current(time_s)
        if move is None or move.start_s > time_s:
            return 0.0, 0.0, 0.0
        share_per_s = move.profile.speed_mm_s(time_s - move.start_s) / move.profile.length_mm
        (a, b, c), (x, y, z) = self.axes.mm(move.start), self.axes.mm(move.end)
        return (x - a) * share_per_s, (y - b) * share_per_s, (z - c) * share_per_s

    def current(self, time_s: float) -> Move | None:
        """Current or next line, None at rest; drops the lines before it."""
        while self._moves and self._moves[0].end_s <= time_s:
            self._place = _nearest(self._moves.popleft().end)
        return self._moves[0] if self._moves else None

    def waiting(self, time_s: float) -> int:
        """Number of unfinished lines."""
        self.current(time_s)
        return len(self._moves) + len(self._held)

    @property
    def held(self) -> bool:
        """Whether lines are held until `resume`."""
        return bool(self._held)

    def end_s(self) -> float:
        """End time of the last line that is not held; minus infinity if there is none."""
        return self._moves[-1].end_s if self._moves else -math.inf

    def add(self, end: Vector, speed_mm_s: float, time_s: float) -> None:
        """Appends a line that starts at a time or after those before it; does nothing if already there.

        Args:
            end: Target, in steps.
            speed_mm_s: Highest speed; reduced to the limits of the axes.
            time_s: Earliest start.
        """
        if self._held:
            self._held.append((end, speed_mm_s))
            return
        start = _nearest(self._moves[-1].end) if self._moves else self._place
        way = [b - a for a, b in zip(self.axes.mm(start), self.axes.mm(end), strict=True)]
        length_mm = math.hypot(*way)
        if length_mm == 0.0:
            return
        shares = [abs(mm) / length_mm for mm in way]
        speed = min(speed_mm_s, _least(self.axes.speed_mm_s, shares))
        profile = trapezoid(length_mm, speed, _least(self.axes.acceleration_mm_s2, shares))
        self._append(start, end, max(time_s, self.end_s()), profile, speed_mm_s)

    def add_timed(self, end: Steps, duration_s: float, time_s: float) -> None:
        """Appends a line of a given duration, regardless of the limits of the axes."""
        start = self.at(max(time_s, self.end_s()))
        length_mm = math.dist(self.axes.mm(start), self.axes.mm(end))
        if length_mm > 0.0:
            profile = trapezoid(length_mm, math.inf, 4 * length_mm / duration_s**2)
            self._append(start, end, time_s, profile, math.inf)

    def _append(self, start: Steps, end: Vector, start_s: float, profile: Trapezoid, speed_mm_s: float) -> None:
        self._moves.append(Move(start, end, start_s, start_s + profile.duration_s, profile, speed_mm_s))

    def hold(self, time_s: float, ahead_s: float = 0.0) -> None:
        """Brakes, and keeps the remaining lines for `resume`.

        Args:
            time_s: Time now.
            ahead_s: Time of motion that is prepared already: it is made before the braking.
        """
        self.current(time_s)
        brake_s = time_s + ahead_s
        self._held.extend((move.end, move.speed_mm_s) for move in self._moves if move.end_s > brake_s)
        started = [move for move in self._moves if move.start_s < brake_s]
        self._moves = deque(move if move.end_s <= brake_s else move.braked(brake_s) for move in started)

    def resume(self, time_s: float) -> None:
        """Resumes the lines that `hold` kept."""
        held, self._held = self._held, deque()
        for end, speed_mm_s in held:
            self.add(end, speed_mm_s, time_s)

    def cancel(self, time_s: float, ahead_s: float = 0.0) -> None:
        """Brakes as `hold`, and drops the remaining lines."""
        self.hold(time_s, ahead_s)
        self._held.clear()

    def stop(self, time_s: float) -> None:
        """Stops at once, and drops the remaining lines."""
        self.set(self.at(time_s))

    def set(self, place: Steps) -> None:
        """Sets the current position, and drops the remaining lines."""
        self._place = place
        self._moves.clear()
        self._held.clear()


def _least(limits: Vector, shares: list[float]) -> float:
    """Highest value along a line at which no axis exceeds its limit."""
    return min(limit / share for limit, share in zip(limits, shares, strict=True) if share > 0.0)


def _rounded(steps: float) -> int:
    return int(math.copysign(math.floor(abs(steps) + 0.5), steps))


def _nearest(place: Vector) -> Steps:
    x, y, z = place
    return round(x), round(y), round(z)
