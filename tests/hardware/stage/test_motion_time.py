"""The time of a move, against a simulation of it in small steps."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.hardware.stage.leg import AxisLimits, move_time, trapezoid_time

MM = st.floats(0.0, 300.0)
SPEED = st.floats(0.1, 200.0)
ACCELERATION = st.floats(1.0, 5000.0)


@pytest.mark.parametrize(
    ("distance", "speed", "acceleration", "seconds"),
    [(0.0, 10.0, 100.0, 0.0), (10.0, 10.0, 100.0, 1.1), (1.0, 10.0, 100.0, 0.2), (0.25, 10.0, 100.0, 0.1)],
)
def test_known_moves(distance, speed, acceleration, seconds):
    assert seconds == pytest.approx(trapezoid_time(distance, speed, acceleration))


@given(st.floats(0.1, 50.0), st.floats(1.0, 50.0), st.floats(5.0, 500.0))
def test_the_distance_is_covered_in_that_time(distance, speed, acceleration):
    total, steps = trapezoid_time(distance, speed, acceleration), 4000
    dt = total / steps
    times = ((i + 0.5) * dt for i in range(steps))
    covered = sum(min(speed, acceleration * min(t, total - t)) for t in times) * dt

    assert distance == pytest.approx(covered, rel=1e-3)


@given(MM, MM, SPEED, ACCELERATION)
def test_a_longer_way_takes_longer(one, other, speed, acceleration):
    short, long = sorted((one, other))
    assert trapezoid_time(short, speed, acceleration) <= trapezoid_time(long, speed, acceleration) + 1e-9


@given(MM, SPEED, SPEED, ACCELERATION, ACCELERATION)
def test_along_one_axis_only_its_own_limits_count(distance, speed, rate, acceleration, other):
    axes = AxisLimits(rate, acceleration), AxisLimits(0.1, other)

    assert trapezoid_time(distance, min(speed, rate), acceleration) == pytest.approx(
        move_time((-distance, 0.0), speed, axes)
    )


def test_a_slow_axis_slows_a_slanting_move():
    axes = AxisLimits(10.0, 1e6), AxisLimits(1.0, 1e6)

    assert pytest.approx(move_time((3.0, 4.0), 100.0, axes), rel=1e-4) == 4.0


def test_no_way_takes_no_time():
    assert math.isclose(0.0, move_time((0.0, 0.0), 5.0, (AxisLimits(1, 1), AxisLimits(1, 1))))
