"""Resets, homing and alarms of the emulated controller, in the bytes of a real one."""

import math

import pytest
from grbl_line import BANNER, CRITICAL, UNLOCK, Line
from solidtouch.hardware.emulator.grbl.controller import ControllerSettings


def test_a_reset_at_rest_keeps_place_and_state(line):
    line.say(b"$J=X-5F3000\n", 1.0)

    assert line.say(b"G0X\x18") == BANNER
    assert line.status() == "<Idle|MPos:-5.000,-1.000,-1.000|FS:0,0>\r\n"
    assert line.say(b"\n") == b"ok\r\n"


def test_a_reset_in_motion_stops_dead_and_costs_the_position(line):
    line.say(b"$J=X-101F3000\n", 0.5)
    believed = float(line.status().split(":")[1].split(",")[0])
    sent = line.now
    line.controller.receive(b"\x18", line.now)

    came = line.timed(1.0)

    assert [data for _, data in came] == [b"ALARM:3\r\n", BANNER + UNLOCK]
    assert came[1][0] - sent == pytest.approx(0.504)
    assert line.state() == "Alarm"
    assert line.say(b"G0X-1\n") == b"error:9\r\n"
    assert line.say(b"$J=X-1F100\n") == b"error:8\r\n"
    assert line.controller.position_mm(line.now)[0] < believed
    assert line.say(b"$X\n") == b"[MSG:Caution: Unlocked]\r\nok\r\n"
    assert line.state() == "Idle"


def test_bytes_right_behind_a_reset_are_lost(line):
    assert line.say(b"\x18\n\n") == BANNER


def test_a_line_in_progress_is_answered_between_reset_and_banner(line):
    line.say(b"G1X-101F3000\nG4P1\n", 0.5)

    assert line.say(b"\x18", 1.0) == b"ALARM:3\r\nok\r\n" + BANNER + UNLOCK


def test_only_a_reset_ends_sleep(line):
    assert line.say(b"$SLP\n") == b"ok\r\n[MSG:Sleeping]\r\n"
    assert line.state() == "Sleep"
    assert line.say(b"~$X\n", 1.0) == b""

    assert line.say(b"\x18", 1.0) == BANNER + UNLOCK
    assert line.state() == "Alarm"


def test_the_end_of_a_program_restores_modes_after_its_motion(line):
    line.say(b"G91G1F6000\nX-10\n", 0.01)

    assert line.say(b"M30\n", 2.0).endswith(b"[MSG:Pgm End]\r\nok\r\n")
    assert line.place[0] == -11.0
    assert b"[GC:G1 G54 G17 G21 G90" in line.say(b"$G\n")
    assert line.say(b"M0\n") == b"error:20\r\n"


def test_homing_is_silent_and_ends_off_the_switches(unhomed):
    """A status asked for meanwhile comes just before the `ok`."""
    assert unhomed.status() == "<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
    assert unhomed.place == (-100.0, -100.0, -100.0)
    sent = unhomed.now
    assert unhomed.say(b"$H\n", 2.0) == b""
    assert unhomed.place == pytest.approx((-50.5, -50.5, -50.5), abs=0.2)

    assert unhomed.say(b"??", 1.0) == b""
    ((time_s, answer),) = unhomed.timed(3.0)

    assert time_s == pytest.approx(sent + 4.002)
    assert answer.startswith(b"<Home|MPos:-1.000,-1.000,-1.000|FS:0,0")
    assert answer.endswith(b">\r\nok\r\n")
    assert unhomed.place == (-1.0, -1.0, -1.0)
    assert unhomed.state() == "Idle"


@pytest.mark.parametrize(("homed", "believed"), [(True, "-30.000,-2.000,-7.000"), (False, "0.000,0.000,0.000")])
def test_it_starts_where_it_is_told_and_knows_that_only_if_homed(homed, believed):
    line = Line(ControllerSettings(homed=homed, start_mm=(-30.0, -2.0, -7.0)))

    assert line.place == (-30.0, -2.0, -7.0)
    assert f"|MPos:{believed}|" in line.status()


def test_a_reset_while_homing_is_alarm_6(unhomed):
    unhomed.say(b"$H\n", 1.0)

    assert unhomed.say(b"\x18", 1.0) == b"ALARM:6\r\nok\r\n" + BANNER + UNLOCK
    assert unhomed.state() == "Alarm"


def test_a_g1_beyond_the_travel_is_a_critical_alarm(line):
    came = line.say(b"G1X-201F100\n", 0.3)
    assert came == b"ALARM:2\r\n"
    assert line.say(b"\x18", 1.0) == CRITICAL  # not seen while the alarm is printed
    assert line.say(b"?\n$X\n!~", 5.0) == b""

    assert line.say(b"\x18", 1.0) == b"ok\r\n" + BANNER + UNLOCK
    assert line.status() == "<Alarm|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n"


def test_a_limit_switch_in_motion_locks_until_reset_and_homing(line):
    line.switches.on("limit_alarm", times=1)

    assert line.say(b"$J=X-41F3000\n", 3.0) == b"ok\r\nALARM:1\r\n" + CRITICAL
    assert line.controller.position_mm(line.now)[0] == pytest.approx(-21.0, abs=0.2)
    assert line.say(b"?\n", 1.0) == b""
    assert line.say(b"\x18", 1.0) == BANNER + b"[MSG:Check Limits]\r\n" + UNLOCK
    assert line.status().startswith("<Alarm|MPos:-21.000,-1.000,-1.000|FS:0,0|Pn:X")
    assert line.say(b"$H\n", 5.0) == b"ok\r\n"
    assert line.status() == "<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n"
    assert line.switches.tally() == {"limit_alarm": 1}


def test_opening_resets_boards_that_do_that(line):
    line.say(b"$J=X-41F3000\n", 2.0)
    line.switches.on("reset_on_open", times=1)
    line.controller.closed(line.now)
    line.controller.opened(line.now)

    assert line.say(b"?\n$$\n", 1.4) == b""
    assert line.listen(0.2) == BANNER + UNLOCK
    assert line.status() == "<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
    assert line.place == (-41.0, -1.0, -1.0)
    assert line.say(b"$H\n", 5.0) == b"ok\r\n"
    assert line.place == (-1.0, -1.0, -1.0)


def test_opening_says_nothing_otherwise(line):
    line.controller.closed(line.now)
    line.controller.opened(line.now)

    assert line.listen(5.0) == b""
    assert line.controller.next_event_s() == math.inf


def test_a_brown_out_restarts_in_the_middle_of_a_move(line):
    line.say(b"$J=X-101F3000\n", 0.5)
    line.switches.on("brown_out", times=1)

    assert line.say(b"?", 2.0) == BANNER + UNLOCK
    assert line.status() == "<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
    assert -27.0 < line.controller.position_mm(line.now)[0] < -23.0


def test_without_homing_a_restart_is_not_locked():
    line = Line(ControllerSettings(values={20: 0, 22: 0}))
    line.switches.on("brown_out", times=1)

    assert line.say(b"\n", 2.0) == BANNER
    assert line.state() == "Idle"
