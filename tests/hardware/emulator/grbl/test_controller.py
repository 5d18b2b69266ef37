"""What the emulated controller answers, in the bytes of a real one."""

from dataclasses import replace

import pytest
from grbl_answers import ANSWERS
from grbl_line import HOMED, Line
from solidtouch.hardware.emulator.grbl.report import Counters


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


@pytest.mark.parametrize("byte", [b"\x85", b"~", b"\x90", b"\xff", b"\x80"])
def test_bytes_that_mean_nothing_at_rest_change_nothing(line, byte):
    assert line.say(byte + b"\n") == b"ok\r\n"
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
