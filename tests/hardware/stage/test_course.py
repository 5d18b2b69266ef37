"""What a report says about the course of a motion."""

import pytest
from solidtouch.hardware.errors import StageFault
from solidtouch.hardware.stage.course import MotionCourse
from solidtouch.hardware.stage.grbl import State, StatusReport
from solidtouch.hardware.stage.leg import AxisLimits
from stage_script import PROTECT, back, dollar, jog, report, status

LIMITS = [AxisLimits(50.0, 500.0), AxisLimits(50.0, 500.0), None]


@pytest.fixture
def course():
    """10 mm along x at 20 mm/s from (0, 0, -1), which takes 0.4 mm to speed up."""
    made = MotionCourse((0.0, 0.0, -1.0))
    made.add((10.0, 0.0, -1.0), 20.0, LIMITS)
    return made


@pytest.mark.parametrize(
    ("at", "feed", "objection"),
    [
        ((5.0, 0.0, -1.0), 1200, None),
        ((5.0, 0.04, -1.0), 1220, None),
        ((5.0, 0.06, -1.0), 1200, "left its commanded path by 0.06 mm"),
        ((10.07, 0.0, -1.0), 0, "left its commanded path by 0.07 mm"),
        ((-0.07, 0.0, -1.0), 0, "left its commanded path by 0.07 mm"),
        ((5.0, 0.0, -1.1), 1200, "left its commanded path by 0.10 mm"),
        ((5.0, 0.0, -1.0), 1240, "moved at 20.67 mm/s instead of 20"),
        ((0.1, 0.0, -1.0), 2000, "moved at 33.33 mm/s instead of 20"),
        ((5.0, 0.0, -1.0), 1160, "moved at 19.33 mm/s instead of 20"),
        ((0.3, 0.0, -1.0), 600, None),
        ((8.5, 0.0, -1.0), 600, None),
    ],
)
def test_what_cannot_belong_to_a_motion(course, at, feed, objection):
    found = course.objection(StatusReport(State.JOG, machine=at, other=(("FS", f"{feed},0"),)), at)

    assert objection == found


def test_a_report_without_a_speed_is_judged_by_its_place(course):
    assert course.objection(StatusReport(State.JOG), (5.0, 0.0, -1.0)) is None
    assert course.objection(StatusReport(State.JOG), (5.0, 1.0, -1.0)) is not None


def test_a_limit_of_an_axis_slows_the_motion():
    course = MotionCourse((0.0, 0.0, 0.0))
    course.add((30.0, 40.0, 0.0), 50.0, [AxisLimits(50.0, 500.0), AxisLimits(20.0, 500.0), None])
    at = (15.0, 20.0, 0.0)

    assert course.objection(StatusReport(State.JOG, other=(("FS", "1500,0"),)), at) is None
    assert course.objection(StatusReport(State.JOG, other=(("FS", "3000,0"),)), at) is not None


def test_a_stage_that_leaves_its_path_is_stopped_and_says_where(ready, journal):
    away = status(5.0, 1.0, state="Jog")
    stage = ready(jog(x_mm=10.0), status(1.0, state="Jog"), away, away, (b"\x85", b""), *[status(5.0, 1.5)] * 2)
    with pytest.raises(
        StageFault, match=r"left its commanded path by 1.00 mm .* was stopped; it is at x = 5.000, y = 1"
    ):
        stage.move(x_mm=10.0)


def test_one_damaged_report_stops_nothing(ready):
    stage = ready(jog(x_mm=1.0), (b"?", report(9.0), 0.01), *[status(0.5, state="Jog")] * 3, status(1.0), status(1.0))
    stage.move(x_mm=1.0)

    assert stage.position_mm == (1.0, 0.0)


def test_a_press_is_known_by_the_end_of_its_release(ready):
    """It went 0.1 mm less deep, so the release ends 0.1 mm beyond, which is no place on the path."""
    stage = ready(
        jog(0.0, 2.0, 720), back(0.0, -2.0), *[status(0.0, -0.1)] * 2, (b"\x85", b""), *[status(0.0, -0.1)] * 2
    )
    with pytest.raises(StageFault, match=r"left its commanded path by 0.10 mm"):
        stage.path([(0.0, 2.0, 12.0), (0.0, 0.0, 12.0)])


def test_a_controller_that_keeps_its_motion_mode_is_refused(plugged):
    wrong = PROTECT[0], (b"$G\n", b"[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]\r\nok\r\n")
    stage = plugged(status(), dollar(), status(), *wrong * 3, status())
    with pytest.raises(StageFault, match=r"does not confirm G80 and G21 \(state Idle\)"):
        stage.connect()


def test_an_unlocked_controller_has_no_position(ready):
    """One flipped bit turns homing into unlocking."""
    stage = ready((b"$H\n", b"[MSG:Caution: Unlocked]\r\nok\r\n", 0.01))
    with pytest.raises(StageFault, match="unlocked without homing, so the position is unknown"):
        stage.home()

    assert stage.position_mm is None


def test_an_ok_at_once_is_no_homing(ready):
    """One lost byte turns homing into a request for help."""
    stage = ready((b"$H\n", b"[HLP:$$ $# $G]\r\nok\r\n", 0.01), status(3.0))
    with pytest.raises(StageFault, match="answered without homing"):
        stage.home()


def read_for(loop, seconds):
    """Waits as for readings, 50 per second."""
    for _ in range(round(50 * seconds)):
        loop.sleep(0.02)


def test_a_stage_that_moves_without_a_command_is_noticed(ready, loop):
    stage = ready(jog(x_mm=0.1), *[status(0.1)] * 2, status(0.1), status(0.4), status(0.5))
    stage.move(x_mm=0.1)
    with loop.guarded(stage.check), pytest.raises(StageFault, match=r"moved without a command; it is at x = 0.500"):
        read_for(loop, 1.0)


def test_a_stage_at_rest_is_asked_ten_times_a_second(ready, loop):
    stage = ready(jog(x_mm=0.1), *[status(0.1)] * 2, *[status(0.1)] * 4)
    stage.move(x_mm=0.1)
    with loop.guarded(stage.check):
        read_for(loop, 0.4)

    assert stage.position_mm == (pytest.approx(0.1), 0.0)
