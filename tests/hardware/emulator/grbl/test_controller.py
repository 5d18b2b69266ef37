"""What the emulated controller does, in the bytes of a real one."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.grbl.controller import Controller, ControllerSettings
from solidtouch.hardware.emulator.grbl.report import Counters

HOMED = ControllerSettings(homed=True)
BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
UNLOCK = b"[MSG:'$H'|'$X' to unlock]\r\n"
CRITICAL = b"[MSG:Reset to continue]\r\n"
PERIODIC = (b"|WCO:0.000,0.000,0.000", b"|Ov:100,100,100")


class Line:
    """A serial line to a controller, and the time; answers come event by event, as the bench would step them."""

    def __init__(self, settings=HOMED):
        self.switches = Switches()
        self.controller = Controller(self.switches, settings)
        self.now = 10.0
        self.controller.opened(self.now)

    def say(self, data, seconds=0.1):
        self.controller.receive(data, self.now)
        return self.listen(seconds)

    def listen(self, seconds):
        return b"".join(data for _, data in self.timed(seconds))

    def timed(self, seconds):
        """Times and bytes of what comes in the next seconds."""
        end = self.now + seconds
        came = []
        while True:
            due = self.controller.next_event_s()
            assert due >= self.now
            self.now = min(due, end)
            if data := self.controller.step(self.now):
                came.append((self.now, data))
            if due > end:
                return came

    def status(self):
        """A report without the fields that come now and then."""
        report = self.say(b"?", 0.05)
        for field in PERIODIC:
            report = report.replace(field, b"")
        return report.decode()

    def state(self):
        return self.status()[1:].partition("|")[0]

    @property
    def place(self):
        """Where the machine truly stands."""
        x, y, z = (round(mm, 6) for mm in self.controller.position_mm(self.now))
        return x, y, z


@pytest.fixture
def line():
    return Line()


@pytest.fixture
def unhomed():
    return Line(ControllerSettings())


ANSWERS = {
    "empty": (b"\n", b"ok\r\n"),
    "carriage return and line feed": (b"\r\n", b"ok\r\nok\r\n"),
    "comment": (b"(wait; for) ; it\n", b"ok\r\n"),
    "folded": (b" g 0 x-1 (one) y - 1\n", b"ok\r\n"),
    "units and modes": (b"G21G90G94G17\n", b"ok\r\n"),
    "spindle off": (b"M5\n", b"ok\r\n"),
    "no letter": (b"1\n", b"error:1\r\n"),
    "real-time byte inside": (b"G0~X-1\n", b"ok\r\n"),
    "no number": (b"G0X\n", b"error:2\r\n"),
    "two points": (b"G0X1.2.3\n", b"error:1\r\n"),
    "unknown dollar": (b"$Q\n", b"error:3\r\n"),
    "check mode": (b"$C\n", b"error:3\r\n"),
    "jog without sign": (b"$J X-1F100\n", b"error:3\r\n"),
    "negative feed": (b"G1X-1F-5\n", b"error:4\r\n"),
    "setting without number": (b"$10=x\n", b"error:3\r\n"),
    "setting without value": (b"$10=\n", b"error:2\r\n"),
    "setting negative": (b"$110=-1\n", b"error:4\r\n"),
    "setting unknown": (b"$99=1\n", b"error:3\r\n"),
    "pulse too short": (b"$0=2\n", b"error:6\r\n"),
    "longest line": (b"G0" + b"X-1" + b"Y-1.".ljust(74, b"0") + b"\n", b"ok\r\n"),
    "line too long": (b"G0" + b"X-1" + b"Y-1.".ljust(75, b"0") + b"\n", b"error:11\r\n"),
    "arc": (b"G2X-1Y-1I1F100\n", b"error:20\r\n"),
    "unknown letter": (b"Q1\n", b"error:20\r\n"),
    "two modes": (b"G90G91\n", b"error:21\r\n"),
    "no feed": (b"G1X-1\n", b"error:22\r\n"),
    "fraction": (b"G0.5\n", b"error:23\r\n"),
    "word twice": (b"G0X-1X-2\n", b"error:25\r\n"),
    "no axis": (b"G1F100\n", b"error:26\r\n"),
    "dwell without time": (b"G4\n", b"error:28\r\n"),
    "unused word": (b"G0X-1I3\n", b"error:36\r\n"),
    "jog": (b"$J=G53G90G21X-2.5F600\n", b"ok\r\n"),
    "jog without feed": (b"$J=X-1\n", b"error:22\r\n"),
    "jog without axis": (b"$J=F100\n", b"error:26\r\n"),
    "jog beyond the travel": (b"$J=X-200.001F100\n", b"error:15\r\n"),
    "jog above zero": (b"$J=G91Y1.001F100\n", b"error:15\r\n"),
    "jog to the end": (b"$J=X-200F100\n", b"ok\r\n"),
    "jog with G1": (b"$J=G1X-1F100\n", b"error:16\r\n"),
    "jog with dwell": (b"$J=G4P1X-1F100\n", b"error:16\r\n"),
    "jog with spindle": (b"$J=X-1F100S5\n", b"error:36\r\n"),
    "parser state": (b"$G\n", b"[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]\r\nok\r\n"),
    "build": (b"$I\n", b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"),
    "unlock when idle": (b"$X\n", b"ok\r\n"),
    "shortest pulse": (b"$0=3\n", b"ok\r\n"),
    "help": (b"$\n", b"[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]\r\nok\r\n"),
}


@pytest.mark.parametrize(("command", "answer"), ANSWERS.values(), ids=ANSWERS)
def test_lines_are_answered_like_this_whole_and_byte_by_byte(command, answer):
    whole, bytewise = Line(), Line()
    for byte in command[:-1]:
        bytewise.controller.receive(bytes([byte]), bytewise.now)

    assert whole.say(command) == answer
    assert bytewise.say(command[-1:]) == answer


def test_settings_are_printed_and_kept(line):
    printed = line.say(b"$$\n").decode().split("\r\n")

    assert printed[0] == "$0=10"
    assert {"$10=1", "$13=0", "$20=1", "$22=1", "$27=1.000", "$100=250.000", "$110=3000.000", "$130=200.000"} <= {
        *printed
    }
    assert printed[-2:] == ["ok", ""]
    assert line.say(b"$110=600.5\n") == b"ok\r\n"
    line.say(b"\x18")
    assert b"$110=600.500\r\n" in line.say(b"$$\n")


def test_offsets_are_printed():
    line = Line(replace(HOMED, work_offset_mm=(-100.0, -50.5, 0.0)))

    assert b"[G54:-100.000,-50.500,0.000]\r\n[G55:0.000,0.000,0.000]\r\n" in line.say(b"$#\n")


def test_writing_a_setting_loses_what_arrives_meanwhile(line):
    """Interrupts are off (interface.md, EEPROM issues)."""
    assert line.say(b"$110=600\n$111=600\n") == b"ok\r\n"
    line.controller.receive(b"$112=600\n", line.now)
    assert line.timed(0.004) == []
    assert line.say(b"?", 0.05) == b"ok\r\n"


def test_soft_limits_need_homing(line):
    assert line.say(b"$22=0\n") == b"ok\r\n"
    assert b"$20=0\r\n" in line.say(b"$$\n")
    assert line.say(b"$20=1\n") == b"error:10\r\n"
    assert line.say(b"$H\n") == b"error:5\r\n"


def test_status_comes_within_its_time_and_once_for_two_requests(line):
    sent = line.now
    line.controller.receive(b"??", line.now)

    ((time_s, report),) = line.timed(1.0)

    assert time_s == pytest.approx(sent + 0.006)
    assert report == b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n"


def test_status_is_answered_in_the_middle_of_a_line_which_goes_on(line):
    line.say(b"$J=X-2")
    assert line.state() == "Idle"
    assert line.say(b"0F60?0\n", 0.004) == b"ok\r\n"
    assert line.listen(0.1).startswith(b"<Jog|")
    line.listen(10.0)
    assert line.place == (-20.0, -1.0, -1.0)


@pytest.mark.parametrize(
    ("settings", "report"),
    [
        ({10: 0}, "<Idle|WPos:9.000,-11.000,-1.000|FS:0,0>"),
        ({10: 1}, "<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>"),
        ({10: 3}, "<Idle|MPos:-1.000,-1.000,-1.000|Bf:15,128|FS:0,0>"),
        ({13: 1}, "<Idle|MPos:-0.0394,-0.0394,-0.0394|FS:0.0,0>"),
        ({23: 2}, "<Idle|MPos:-1.000,-199.000,-1.000|FS:0,0>"),
    ],
)
def test_settings_change_what_status_says(settings, report):
    line = Line(replace(HOMED, values=settings, work_offset_mm=(-10.0, 10.0, 0.0)))
    for _ in range(2):
        line.say(b"?")

    assert line.status() == report + "\r\n"


def test_offset_and_overrides_come_in_every_tenth_report_at_rest(line):
    reports = [line.say(b"?") for _ in range(21)]

    assert [n for n, report in enumerate(reports) if b"|WCO:" in report] == [0, 10, 20]
    assert [n for n, report in enumerate(reports) if b"|Ov:" in report] == [1, 11]


def test_offset_comes_in_every_30th_and_overrides_in_every_20th_report_while_busy():
    counters = Counters()
    due = [counters.due("Jog") for _ in range(61)]

    assert [n for n, (offset, _) in enumerate(due) if offset] == [0, 30, 60]
    assert [n for n, (_, override) in enumerate(due) if override] == [1, 21, 41]


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


def test_states_that_refuse(line):
    line.say(b"$J=X-50F3000\n", 0.1)
    assert line.say(b"G0X-1\n", 0.01) == b"error:9\r\n"
    assert line.say(b"$H\n", 0.01) == b"error:8\r\n"
    assert line.say(b"$1=1\n", 0.01) == b"error:8\r\n"
    assert line.say(b"$$\n", 0.01).endswith(b"ok\r\n")
    line.listen(3.0)
    line.say(b"G0X-1\n", 0.1)
    assert line.state() == "Run"
    assert line.say(b"$J=X-50F3000\n", 0.01) == b"error:8\r\n"
    assert line.say(b"$$\n", 0.01) == b"error:8\r\n"


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


def test_the_sixteenth_line_is_answered_when_a_place_is_free(line):
    answers = b"".join(line.say(b"$J=G91X-1F600\n", 0.002) for _ in range(16))

    assert answers == b"ok\r\n" * 15
    ((time_s, answer),) = line.timed(1.0)
    assert answer == b"ok\r\n"
    assert time_s == pytest.approx(10.0 + 0.002 + 0.1 + 0.02, abs=1e-6)


def test_the_receive_buffer_drops_what_does_not_fit(line):
    line.say(b"G4P5\n")
    line.controller.receive(b"\n" * 200, line.now)

    assert line.listen(10.0) == b"ok\r\n" * 129


def test_a_line_without_end_takes_no_memory_and_is_too_long(line):
    for _ in range(200):
        assert line.say(b"X" * 1000, 0.001) == b""

    assert line.say(b"\n\n") == b"error:11\r\nok\r\n"


def test_jog_cancel_brakes_flushes_and_ends_idle(line):
    line.say(b"$J=X-101F3000\n$J=X-1F3000\n", 0.5)
    before = line.controller.position_mm(line.now)[0]
    line.controller.receive(b"\x85", line.now)

    assert line.state() == "Jog"
    line.listen(0.1)
    assert line.status().startswith("<Idle|")
    assert line.controller.position_mm(line.now)[0] == pytest.approx(before - 50**2 / 1000, abs=0.004)
    assert line.listen(5.0) == b""
    assert line.say(b"$J=G91X1F3000\n", 1.0) == b"ok\r\n"
    assert line.controller.position_mm(line.now)[0] == pytest.approx(before - 1.5, abs=0.004)


@pytest.mark.parametrize("byte", [b"\x85", b"~", b"\x90", b"\xff", b"\x80"])
def test_bytes_that_mean_nothing_at_rest_change_nothing(line, byte):
    assert line.say(byte + b"\n") == b"ok\r\n"
    assert line.state() == "Idle"


def test_a_line_sent_while_a_jog_is_cancelled_waits_for_rest(line):
    line.say(b"$J=X-101F3000\n", 0.5)

    came = [line.say(b"\x85$J=G91X1F3000\n", 0.09), line.listen(0.02)]

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
    assert line.say(b"\x18", 1.0) == BANNER + UNLOCK
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


def test_answers_get_lost_doubled_or_refused(line):
    line.switches.on("lost_ok", times=1)
    assert line.say(b"\n") == b""
    line.switches.on("extra_ok", times=1)
    assert line.say(b"\n") == b"ok\r\nok\r\n"
    line.switches.on("refuse_move", times=1, code=24)
    assert line.say(b"$G\n").endswith(b"ok\r\n")
    assert line.say(b"$J=X-5F3000\n", 1.0) == b"error:24\r\n"
    assert line.place == (-1.0, -1.0, -1.0)
    assert line.say(b"$J=X-5F3000\n", 1.0) == b"ok\r\n"


def test_status_is_silent_or_torn_by_a_message(line):
    line.switches.on("silent_status", times=1)
    assert line.say(b"?") == b""
    line.switches.on("torn_status", times=1)
    torn = line.say(b"?")
    assert b"[MSG:Pgm End]\r\n" in torn
    assert torn.replace(b"[MSG:Pgm End]\r\n", b"").startswith(b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0")
    assert line.state() == "Idle"


def test_false_idle_is_prolonged_and_a_jog_can_be_cancelled_in_it(line):
    line.switches.on("false_idle", seconds=0.5)
    assert line.say(b"$J=X-5F3000\n", 0.2) == b"ok\r\n"
    assert line.status() == "<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n"
    assert line.say(b"\x85", 1.0) == b""
    assert line.place == (-1.0, -1.0, -1.0)
    line.say(b"$J=X-41F3000\n", 0.7)
    assert line.state() == "Jog"
    line.listen(1.0)
    assert line.place == (-41.0, -1.0, -1.0)


def test_grblhal_says_its_name():
    line = Line(replace(HOMED, firmware="GrblHAL", version="1.1f", receive_bytes=1024))

    assert line.say(b"\x18") == b"\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n"


def test_a_move_goes_on_while_nobody_listens(line):
    line.controller.receive(b"$J=X-101F3000\n", line.now)
    line.controller.closed(line.now + 1.0)
    line.controller.opened(line.now + 9.0)

    assert line.controller.position_mm(line.now + 9.0) == pytest.approx((-101.0, -1.0, -1.0))


COMMANDS = st.sampled_from(
    [
        *(b"$J=G91X-1F3000\n", b"$J=X-9Y-9F900\n", b"G1X-3F600\n", b"G0Y-3\n", b"G1X-900\n", b"G4P0.1\n", b"G0X1"),
        *(b"$$\n", b"$H\n", b"$X\n", b"$110=60\n", b"$22=0\n", b"$130=0\n", b"G91\n", b"G20\n", b"\r\n"),
        *(b"?", b"!", b"~", b"\x85", b"\x18"),
    ]
)
FAULTS = [
    "torn_status",
    "brown_out",
    "lost_ok",
    "extra_ok",
    "refuse_move",
    "limit_alarm",
    "silent_status",
    "false_idle",
]


@settings(max_examples=150, deadline=None)
@given(
    parts=st.lists(st.tuples(st.one_of(COMMANDS, st.binary(max_size=30)), st.floats(0.0, 1.0)), max_size=25),
    faults=st.sets(st.sampled_from(FAULTS)),
)
def test_nothing_makes_it_raise_hang_or_grow(parts, faults):
    line = Line()
    for name in faults:
        line.switches.on(name, rate=0.2)
    for data, seconds in parts:
        before = line.now
        for _ in range(3):
            assert len(line.say(data, seconds)) < 20000
        assert line.now == pytest.approx(before + 3 * seconds)
        assert all(map(math.isfinite, line.controller.position_mm(line.now)))
    line.switches.clear()
    line.say(b"~\x85\n", 60.0)
    line.say(b"\x18", 3.0)
    line.say(b"\x18", 3.0)
    assert line.say(b"\n\n", 1.0) == b"ok\r\nok\r\n"
    assert line.state() in {"Idle", "Alarm"}


@settings(max_examples=50, deadline=None)
@given(parts=st.lists(COMMANDS.filter(lambda data: data != b"\x18"), max_size=6))
def test_byte_by_byte_equals_whole(parts):
    whole, bytewise = Line(), Line()
    data = b"".join(parts)[:120]
    for byte in data:
        bytewise.controller.receive(bytes([byte]), bytewise.now)
        assert bytewise.controller.step(bytewise.now) == b""

    assert whole.say(data, 30.0) == bytewise.say(b"", 30.0)
    assert whole.controller.position_mm(whole.now) == bytewise.controller.position_mm(bytewise.now)


@given(times=st.lists(st.floats(0.0, 2.0), min_size=1, max_size=20))
def test_asking_for_the_place_changes_nothing(times):
    asked, left = Line(), Line()
    for line in (asked, left):
        line.say(b"$J=X-21Y-9F3000\n$J=X-1F3000\n", 0.1)
    for time_s in sorted(times):
        asked.controller.position_mm(asked.now + time_s)

    assert asked.timed(2.0) == left.timed(2.0)
    assert asked.status() == left.status()
