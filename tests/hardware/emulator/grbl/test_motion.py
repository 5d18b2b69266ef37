"""Laws of the motion of an emulated stage."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solidtouch.hardware.emulator.grbl.motion import MotionLimits, Planner, trapezoid

AXES = MotionLimits((250.0, 80.0, 400.0), (50.0, 30.0, 10.0), (500.0, 200.0, 100.0))
PLACES = st.tuples(*(st.integers(-40000, 0) for _ in range(3)))
ANYWHERE = st.floats(0.0, 1.0)


@given(length=st.floats(1e-3, 300.0), speed=st.floats(0.01, 200.0), acceleration=st.floats(1.0, 5000.0))
def test_a_trapezoid_takes_the_time_of_two_ramps_and_a_cruise(length, speed, acceleration):
    profile = trapezoid(length, speed, acceleration)

    if length >= speed**2 / acceleration:
        expected_s = 2 * speed / acceleration + (length - speed**2 / acceleration) / speed
    else:
        expected_s = 2 * math.sqrt(length / acceleration)

    assert profile.duration_s == pytest.approx(expected_s)
    assert profile.travelled_mm(0.0) == 0.0
    assert profile.travelled_mm(profile.duration_s) == length
    assert profile.travelled_mm(profile.duration_s / 2) == pytest.approx(length / 2)


@given(length=st.floats(0.1, 300.0), speed=st.floats(1.0, 200.0), acceleration=st.floats(10.0, 5000.0), share=ANYWHERE)
def test_way_is_the_integral_of_speed_and_speed_that_of_the_acceleration(length, speed, acceleration, share):
    profile = trapezoid(length, speed, acceleration)
    step_s = 1e-3 * min(profile.duration_s, profile.peak_mm_s / acceleration)
    time_s = share * (profile.duration_s - step_s)

    way_mm = profile.travelled_mm(time_s + step_s) - profile.travelled_mm(time_s)
    gain = profile.speed_mm_s(time_s + step_s) - profile.speed_mm_s(time_s)

    assert way_mm / step_s == pytest.approx(profile.speed_mm_s(time_s + step_s / 2), abs=1e-3 * speed)
    assert profile.speed_mm_s(time_s) <= speed
    assert abs(gain) <= acceleration * step_s * (1 + 1e-6) + 1e-9


@given(length=st.floats(0.1, 300.0), speed=st.floats(1.0, 200.0), acceleration=st.floats(10.0, 5000.0), share=ANYWHERE)
def test_braking_changes_nothing_before_it_and_comes_to_rest_in_the_shortest_way(length, speed, acceleration, share):
    profile = trapezoid(length, speed, acceleration)
    time_s = share * profile.duration_s
    now_mm_s = profile.speed_mm_s(time_s)

    braked = profile.braked(time_s)

    assert braked.travelled_mm(time_s) == pytest.approx(profile.travelled_mm(time_s), abs=1e-6)
    assert braked.travelled_mm(time_s / 2) == pytest.approx(profile.travelled_mm(time_s / 2), abs=1e-6)
    assert braked.speed_mm_s(time_s) == pytest.approx(now_mm_s, abs=1e-5)
    assert braked.duration_s == pytest.approx(time_s + now_mm_s / acceleration, abs=1e-5)
    assert braked.length_mm <= length


@settings(max_examples=40)
@given(ends=st.lists(PLACES, min_size=1, max_size=4), speed=st.floats(1.0, 100.0))
def test_lines_run_back_to_back_end_at_their_targets_and_respect_every_axis(ends, speed):
    planner = Planner(AXES, (0, 0, 0))
    for end in ends:
        planner.add(end, speed, time_s=1.0)
    end_s = planner.end_s()
    times = [1.0 + (end_s - 1.0) * n / 500 for n in range(501)] if end_s > 1.0 else [1.0]

    places = [AXES.mm(planner.at(time_s)) for time_s in times]

    assert planner.at(end_s + 1e-9) == ends[-1]
    for time_s, before, after in zip(times[1:], places, places[1:], strict=False):
        step_s = time_s - times[0] if time_s == times[1] else times[1] - times[0]
        for a, b, limit, steps in zip(before, after, AXES.speed_mm_s, AXES.steps_per_mm, strict=True):
            assert abs(b - a) <= min(limit, speed) * step_s * (1 + 1e-6) + 1 / steps + 1e-9


@given(end=PLACES, share=ANYWHERE)
def test_a_hold_and_a_resume_end_where_the_line_would_have_ended(end, share):
    planner = Planner(AXES, (0, 0, 0))
    planner.add(end, 40.0, time_s=0.0)
    planner.add((-100, -100, -100), 40.0, time_s=0.0)
    hold_s = share * planner.end_s()
    before = planner.at(hold_s)

    planner.hold(hold_s)
    still_s = max(hold_s, planner.end_s())

    assert max(abs(a - b) for a, b in zip(planner.at(hold_s), before, strict=True)) <= 1
    assert planner.current(still_s) is None
    planner.resume(still_s + 1.0)
    assert planner.at(planner.end_s() + 1.0) == (-100, -100, -100)
    assert not planner.held


@given(end=PLACES, share=ANYWHERE)
def test_a_cancelled_line_brakes_within_the_way_and_is_forgotten(end, share):
    planner = Planner(AXES, (0, 0, 0))
    planner.add(end, 40.0, time_s=0.0)
    cancel_s = share * max(0.0, planner.end_s())

    planner.cancel(cancel_s)
    place = planner.at(max(cancel_s, planner.end_s()))

    assert all(b <= a + 0.5 <= 1 for a, b in zip(place, end, strict=True))
    assert planner.waiting(max(cancel_s, planner.end_s())) == 0
    planner.resume(cancel_s + 10.0)
    assert planner.waiting(cancel_s + 10.0) == 0


def test_the_slowest_axis_sets_speed_and_acceleration_of_a_line():
    """Along (3, 4) the second axis, 30 mm/s and 200 mm/s², allows 37.5 mm/s and 250 mm/s²."""
    planner = Planner(AXES, (0, 0, 0))

    planner.add(AXES.steps((-30.0, -40.0, 0.0)), 1000.0, time_s=0.0)

    assert planner.end_s() == pytest.approx(50.0 / 37.5 + 37.5 / 250.0)
    assert planner.velocity_mm_s(0.5) == pytest.approx((-22.5, -30.0, 0.0))


def test_a_line_without_way_takes_no_time():
    planner = Planner(AXES, (-5, -5, -5))

    planner.add((-5, -5, -5), 10.0, time_s=0.0)

    assert planner.waiting(0.0) == 0
    assert planner.end_s() == -math.inf


def test_a_timed_line_takes_its_time():
    planner = Planner(AXES, (0, 0, 0))

    planner.add_timed((-25000, -8000, 0), 3.0, time_s=2.0)

    assert planner.end_s() == pytest.approx(5.0)
    assert planner.at(3.5) == (-12500, -4000, 0)


def test_a_dead_stop_stays_where_it_is():
    planner = Planner(AXES, (0, 0, 0))
    planner.add((-25000, 0, 0), 50.0, time_s=0.0)
    place = planner.at(1.0)

    planner.stop(1.0)

    assert planner.at(9.0) == place
    assert planner.velocity_mm_s(9.0) == (0.0, 0.0, 0.0)
