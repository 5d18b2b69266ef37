"""How the emulated controller moves, in the bytes of a real one."""

from dataclasses import replace

import pytest
from grbl_line import CRITICAL, HOMED, Line
from hypothesis import given
from hypothesis import strategies as st


def test_a_jog_takes_the_time_of_a_trapezoid_and_ends_at_the_nearest_step(line):
    """20 mm at 50 mm/s with 500 mm/s²: 0.1 s to speed up, 15 mm in 0.3 s, 0.1 s to brake."""
    assert line.say(b"$J=G53G90G21X-21.0031F3000\n", 0.002) == b"ok\r\n"
    start = line.now
    assert line.controller.position_mm(start + 0.25) == pytest.approx((-11.0, -1.0, -1.0), abs=0.01)
    line.listen(0.49)
    assert line.controller.position_mm(line.now)[0] == pytest.approx(-21.004, abs=0.03)
    assert line.say(b"?", 0.006).startswith(b"<Jog|")
    line.listen(0.005)
    assert line.place == (-21.004, -1.0, -1.0)
    assert line.status() == "<Idle|MPos:-21.004,-1.000,-1.000|FS:0,0>\r\n"


def test_status_says_speed_and_free_places_while_moving():
    line = Line(replace(HOMED, values={10: 3}))
    line.say(b"$J=X-101F3000\n$J=X-1F3000\n", 0.5)

    assert line.status() == "<Jog|MPos:-23.700,-1.000,-1.000|Bf:13,128|FS:3000,0>\r\n"


def test_feed_is_held_back_by_the_slowest_axis():
    line = Line(replace(HOMED, values={111: 300.0}))
    line.say(b"$J=G91X-40Y-30F3000\n", 0.5)

    assert line.status().endswith("|FS:500,0>\r\n")


def test_two_queued_jogs_run_back_to_back(line):
    assert line.say(b"$J=Y-3.5F1200\n$J=Y-1F1200\n", 0.01) == b"ok\r\nok\r\n"
    deepest = min(line.controller.position_mm(line.now + n / 1000)[1] for n in range(1000))

    assert deepest == pytest.approx(-3.5)
    line.listen(0.3)
    assert line.state() == "Jog"
    line.listen(0.3)
    assert line.status() == "<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n"


def test_relative_inch_and_work_coordinates():
    line = Line(replace(HOMED, work_offset_mm=(-10.0, 0.0, 0.0)))
    for command, place in [
        (b"$J=X-5F3000\n", (-15.0, -1.0, -1.0)),
        (b"$J=G53X-5F3000\n", (-5.0, -1.0, -1.0)),
        (b"$J=G91X-2Y-3F3000\n", (-7.0, -4.0, -1.0)),
        (b"$J=G20G53Y-1F100\n", (-7.0, -25.4, -1.0)),
        (b"G91G0X-1\n", (-8.0, -25.4, -1.0)),
        (b"G90G1X0F2000\n", (-10.0, -25.4, -1.0)),
        (b"G20G53X-0.5\n", (-12.7, -25.4, -1.0)),
    ]:
        assert line.say(command, 3.0) == b"ok\r\n"
        assert line.place == pytest.approx(place, abs=0.002)


def test_small_relative_moves_do_not_add_up_rounding(line):
    for _ in range(20):
        line.say(b"$J=G91X-0.001F3000\n")

    assert line.place == (-1.02, -1.0, -1.0)


def test_idle_is_reported_at_the_old_place_just_after_the_ok_of_a_g1(line):
    """The cycle starts in the next turn of the main loop (protocol.c)."""
    line.controller.receive(b"?", line.now)
    line.listen(0.002)
    assert line.say(b"G1X-50F3000\n", 0.003) == b"ok\r\n"
    ((_, report),) = line.timed(0.0015)
    assert report.startswith(b"<Idle|MPos:-1.000,")
    line.listen(0.05)
    assert line.state() == "Run"


def test_a_dwell_answers_when_all_motion_is_over(line):
    sent = line.now
    line.controller.receive(b"G1X-21F3000\nG4P0.05\n", line.now)

    came = line.timed(2.0)

    assert [data for _, data in came] == [b"ok\r\n", b"ok\r\n"]
    assert came[1][0] == pytest.approx(sent + 0.002 + 0.003 + 0.5 + 0.05, abs=1e-6)


def test_status_is_idle_in_a_dwell(line):
    line.controller.receive(b"G4P2\n", line.now)

    assert line.state() == "Idle"
    assert line.listen(3.0) == b"ok\r\n"


def test_jog_cancel_brakes_flushes_and_ends_idle(line):
    line.say(b"$J=X-101F3000\n$J=X-1F3000\n", 0.5)
    before = line.controller.position_mm(line.now)[0]
    line.controller.receive(b"\x85", line.now)

    assert line.state() == "Jog"
    line.listen(0.15)
    assert line.status().startswith("<Idle|")
    assert line.controller.position_mm(line.now)[0] == pytest.approx(before - 50 * 0.05 - 50**2 / 1000, abs=0.004)
    assert line.listen(5.0) == b""
    assert line.say(b"$J=G91X1F3000\n", 1.0) == b"ok\r\n"
    assert line.controller.position_mm(line.now)[0] == pytest.approx(before - 4.0, abs=0.004)


def test_braking_begins_behind_what_is_prepared_and_the_speed_reported_is_there(line):
    """Measured on GRBL 1.1h at 25 mm/s: 1.67 to 1.88 mm from the byte to rest, of which braking takes 0.63 mm."""
    line.say(b"$J=X-101F1500\n", 0.5)
    before = line.controller.position_mm(line.now)[0]
    line.say(b"\x85", 0.02)

    assert "|FS:" in line.status()
    assert float(line.status().split("FS:")[1].split(",")[0]) < 1500
    line.listen(0.2)
    assert before - line.controller.position_mm(line.now)[0] == pytest.approx(25 * 0.05 + 25**2 / 1000, abs=0.004)


def test_a_line_sent_while_a_jog_is_cancelled_waits_for_rest(line):
    line.say(b"$J=X-101F3000\n", 0.5)

    came = [line.say(b"\x85$J=G91X1F3000\n", 0.14), line.listen(0.02)]

    assert came == [b"", b"ok\r\n"]


def test_a_hold_brakes_and_resume_goes_on(line):
    line.say(b"G1X-101F3000\nG1X-51F3000\n", 0.5)
    assert line.say(b"!", 0.04) == b""
    assert line.state() == "Hold:1"
    line.listen(0.1)
    assert line.state() == "Hold:0"
    here = line.controller.position_mm(line.now)
    assert line.say(b"\n", 1.0) == b""
    assert line.controller.position_mm(line.now) == here
    assert line.say(b"~", 0.05) == b"ok\r\n"
    assert line.state() == "Run"
    line.listen(5.0)
    assert line.place == (-51.0, -1.0, -1.0)


def test_a_hold_cancels_a_jog(line):
    line.say(b"$J=X-101F3000\n", 0.5)
    line.say(b"!", 0.2)

    assert line.state() == "Idle"


def test_a_move_goes_on_while_nobody_listens(line):
    line.controller.receive(b"$J=X-101F3000\n", line.now)
    line.controller.closed(line.now + 1.0)
    line.controller.opened(line.now + 9.0)

    assert line.controller.position_mm(line.now + 9.0) == pytest.approx((-101.0, -1.0, -1.0))


@given(times=st.lists(st.floats(0.0, 2.0), min_size=1, max_size=20))
def test_asking_for_the_place_changes_nothing(times):
    asked, left = Line(), Line()
    for line in (asked, left):
        line.say(b"$J=X-21Y-9F3000\n$J=X-1F3000\n", 0.1)
    for time_s in sorted(times):
        asked.controller.position_mm(asked.now + time_s)

    assert asked.timed(2.0) == left.timed(2.0)
    assert asked.status() == left.status()


def test_a_jog_without_axis_words_goes_to_machine_zero_onto_the_switches(line):
    """Measured on GRBL 1.1h: the axis words may be lost on the wire."""
    line.say(b"$J=X-50Y-40F3000\n", 3.0)
    assert line.say(b"$J=G53G90G21F3000\n", 3.0) == b"ok\r\nALARM:1\r\n" + CRITICAL

    assert line.place == pytest.approx((0.0, 0.0, 0.0), abs=0.1)


@pytest.mark.parametrize(("onto", "axis"), [(b"Y0", "Y"), (b"X-200", "X")])
def test_a_switch_at_an_end_of_the_travel_stops_a_move_onto_it_and_one_off_it(line, onto, axis):
    assert line.say(b"$J=" + onto + b"F3000\n", 6.0) == b"ok\r\nALARM:1\r\n" + CRITICAL
    line.say(b"\x18")
    assert f"|Pn:{axis}" in line.status()
    line.say(b"$X\n")
    assert line.say(b"$J=G91" + axis.encode() + (b"5" if b"-" in onto else b"-5") + b"F600\n", 2.0).endswith(CRITICAL)

    line.say(b"\x18")
    assert "|Pn:" not in line.status()


def test_without_hard_limits_a_switch_stops_nothing(line):
    line.say(b"$21=0\n")
    assert line.say(b"$J=Y0F600\n", 1.0) == b"ok\r\n"

    assert line.status() == "<Idle|MPos:-1.000,0.000,-1.000|FS:0,0|Pn:Y>\r\n"


def test_half_a_step_is_one(line):
    """As GRBL 1.1h rounds; an even number of steps would be nearest to the first in Python."""
    line.say(b"$J=X-2.01Y-2.002Z-2.0019F3000\n", 1.0)

    assert line.place == (-2.012, -2.004, -2.0)


def test_machine_coordinates_are_never_distances(line):
    line.say(b"$J=G53G91X-50F3000\n", 3.0)

    assert line.place == (-50.0, -1.0, -1.0)


def test_digits_behind_the_eighth_do_not_count(line):
    for number, x_mm in [(b"-0000000.9", -0.9), (b"-00000002.9", -2.0), (b"-0000005.55", -5.5)]:
        line.say(b"$J=X" + number + b"F3000\n", 1.0)
        assert line.place == (x_mm, -1.0, -1.0)


def test_a_door_cancels_a_jog_and_a_resume_closes_it(line):
    line.say(b"$J=X-101F3000\n", 0.5)

    assert line.say(b"\x84", 0.2) == b"[MSG:Check Door]\r\n"
    assert line.state() == "Door:0"
    here = line.place
    assert line.say(b"$J=X-5F3000\n", 0.5) == b""
    assert line.place == here
    assert line.say(b"~", 1.0) == b"ok\r\n"
    assert line.place == (-5.0, -1.0, -1.0)


def test_check_mode_moves_nothing_and_ends_in_a_restart(line):
    line.say(b"$C\n")

    assert line.state() == "Check"
    assert line.say(b"G0X-50\n$J=X-50F3000\n", 1.0) == b"ok\r\nerror:8\r\n"
    assert line.place == (-1.0, -1.0, -1.0)
    assert line.say(b"$C\n") == b"[MSG:Disabled]\r\nok\r\n\r\nGrbl 1.1h ['$' for help]\r\n"
    assert line.state() == "Idle"


def test_homing_with_more_text_moves_nothing_and_stays_in_its_state(line):
    assert line.say(b"$H$I\n", 6.0) == b"error:3\r\n"
    assert line.state() == "Home"
    assert line.say(b"$J=X-50F3000\n", 1.0) == b"error:8\r\n"
    assert b"ALARM:6" in line.say(b"\x18", 1.0)
