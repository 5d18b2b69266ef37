"""The stage driver byte by byte: what it sends, and what it makes of the answers."""

import re

import pytest
from solidtouch.hardware.errors import (
    CommandRefused,
    NoAnswer,
    OutOfLimits,
    PortBusy,
    PortError,
    PortLost,
    PositionUnknown,
    RigError,
    StageAlarm,
    StageFault,
    WriteTimeout,
    WrongDevice,
)
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.link.loop import Loop
from solidtouch.hardware.rig.settings import AxisSettings, StageSettings
from solidtouch.hardware.stage.stage import Stage

X = AxisSettings(letter="X", origin_mm=-60.0, low_mm=-1.0, high_mm=17.0, speed_mm_s=20.0)
Y = AxisSettings(letter="Y", origin_mm=-40.0, low_mm=-2.0, high_mm=3.0, speed_mm_s=12.0, direction=-1)
SETTINGS = StageSettings(port="scripted", x=X, y=Y, boot_s=2.0, homing_s=30.0)
VALUES = {1: 255, 10: 1, 13: 0, 20: 1, 21: 1, 22: 1, 23: 0, 27: 1.0}
VALUES |= {first + i: value for first, value in ((100, 250), (110, 3000), (120, 500), (130, 200)) for i in range(3)}
BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
VERSION = b"$I\n", b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"


def report(x_mm=0.0, y_mm=0.0, state="Idle", more="|FS:0,0"):
    """A status report of a place in the rig frame."""
    return f"<{state}|MPos:{X.machine_mm(x_mm):.3f},{Y.machine_mm(y_mm):.3f},0.000{more}>\r\n".encode()


def status(*place, **options):
    return b"?", report(*place, **options), 0.01


def dollar(**changed):
    values = VALUES | {int(name[1:]): value for name, value in changed.items()}
    lines = "".join(f"${number}={value:.3f}\r\n" for number, value in values.items() if value is not None)
    return b"$$\n", lines.encode() + b"ok\r\n"


def jog(x_mm=None, y_mm=None, feed=1200.0, answer=b"ok\r\n"):
    words = "".join(f"{axis.letter}{axis.machine_mm(mm):.4f}" for axis, mm in ((X, x_mm), (Y, y_mm)) if mm is not None)
    return f"$J=G53G90G21{words}F{feed:.3f}\n".encode(), answer


class Notes(NoJournal):
    """Keeps events, reports and commands."""

    def __init__(self):
        self.events, self.reports, self.sent = [], [], []

    def event(self, *told, **_):
        self.events.append(told[1])

    def status(self, *told):
        self.reports.append(told[1:])

    def command(self, *told):
        self.sent.append(told[2])


READY = status(), VERSION, dollar(), status()


@pytest.fixture
def journal():
    return Notes()


@pytest.fixture
def plugged(scripted, loop, journal):
    """A function that makes a stage on a port with a script."""

    def make(*exchanges, settings=SETTINGS):
        return Stage(settings, loop, journal, scripted(*exchanges))

    return make


@pytest.fixture
def ready(plugged):
    """A function that makes a stage that stands at the origin of the rig frame and knows it."""

    def make(*exchanges):
        stage = plugged(*READY, *exchanges)
        stage.connect()
        return stage

    return make


def test_a_controller_that_was_homed_before_keeps_its_position(ready):
    stage = ready()

    assert stage.homed
    assert stage.position_mm == (0.0, 0.0)
    assert (*stage.report[:3], stage.report.notes) == ("Grbl 1.1h.20190830", "Idle", True, ())
    assert stage.report.values[100] == 250.0


def test_a_controller_that_opening_reset_does_not_know_where_it_is(plugged):
    unheard = [(b"?", b"")] * 6
    stage = plugged(*unheard[:-1], (b"?", BANNER, 0.2), VERSION, dollar(), status(state="Alarm"))
    stage.connect()

    assert not stage.homed
    assert stage.position_mm is None
    with pytest.raises(PositionUnknown, match="position unknown; home the stage first"):
        stage.move(x_mm=1.0)


def test_a_restart_at_opening_costs_the_position_even_if_the_controller_is_idle(plugged):
    stage = plugged((b"?", BANNER), VERSION, dollar(), status())
    stage.connect()

    assert not stage.homed


def test_a_position_outside_the_travel_is_not_believed(plugged):
    stage = plugged(status(), VERSION, dollar(), status(61.5))
    stage.connect()

    assert stage.position_mm is None


def test_old_input_is_no_answer(plugged):
    stage = plugged((b"", b"ok\r\nerror:9\r\n<Idle|MP" + report(5.0) + b"ok\r\n"), *READY)
    stage.connect()

    assert stage.position_mm == (0.0, 0.0)


def test_half_a_command_that_was_left_is_refused_and_asked_again(plugged):
    stage = plugged(status(), (b"$I\n", b"error:1\r\n"), *READY)
    stage.connect()

    assert stage.homed


def test_settings_with_a_lost_line_are_asked_again(plugged):
    stage = plugged(status(), VERSION, dollar(_110=None), dollar(), status())
    stage.connect()

    assert stage.homed


def test_work_positions_are_understood_once_their_offset_came(plugged):
    work = b"<Idle|WPos:1.000,2.000,0.000|FS:0,0>\r\n"
    offset = b"<Idle|WPos:1.000,2.000,0.000|FS:0,0|WCO:-61.000,-42.000,0.000>\r\n"
    stage = plugged((b"?", work), VERSION, dollar(_10=0), (b"?", work), (b"?", offset))
    stage.connect()

    assert stage.position_mm == (0.0, 0.0)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"_13": 1}, r"inches \(\$13=1\); send \$13=0"),
        ({"_22": 0}, r"homing is off \(\$22=0\).*send \$22=1"),
        ({"_20": 0}, r"\(\$20=0\); send \$20=1"),
        ({"_110": 600}, r"speed_mm_s=20 exceeds the maximum of X, 10 mm/s \(\$110=600 mm/min\).*send \$110=1200"),
        ({"_131": 40}, r"limits of stage.y are -43 to -38 mm.*travel of Y, -40 to 0 mm \(\$131=40\)"),
        ({"_101": 0}, r"steps of Y must be above 0, got \$101=0"),
    ],
)
def test_a_controller_set_up_otherwise_is_refused(plugged, changed, sentence):
    stage = plugged(status(), VERSION, dollar(**changed))
    with pytest.raises(WrongDevice, match=sentence):
        stage.connect()

    assert not stage.port.is_open


@pytest.mark.parametrize(
    ("changed", "note"),
    [({"_1": 25}, r"released 25 ms"), ({"_21": 0}, r"\$21=1"), ({"_23": 2}, r"homing ends at y = 159 mm")],
)
def test_what_may_disappoint_is_noted(plugged, changed, note):
    stage = plugged(status(), VERSION, dollar(**changed), status())
    stage.connect()

    (text,) = stage.report.notes
    assert re.search(note, text)


def test_homing_bits_of_grblhal_are_understood(plugged):
    stage = plugged(status(), VERSION, dollar(_22=13), status())
    stage.connect()

    assert stage.homed


@pytest.mark.parametrize(
    ("sent", "sentence"),
    [
        (b"12,34,56\r\n", "device sent '12,34,56'; check the port and its baud rate"),
        (b"\x80\xfe\x00\r", "sent noise"),
        (b"\xf0" * 500, "sent noise"),
    ],
)
def test_another_device_is_refused(plugged, sent, sentence):
    stage = plugged((b"", sent), *[(b"?", b"")] * 8)
    with pytest.raises(WrongDevice, match=sentence):
        stage.connect()


def test_another_version_is_refused(plugged):
    stage = plugged(status(), (b"$I\n", b"[VER:0.9j.20160303:]\r\nok\r\n"))
    with pytest.raises(WrongDevice, match=r"requires GRBL 1.1, the controller has 0.9j"):
        stage.connect()


def test_silence_ends_at_the_deadline(plugged, clock):
    stage = plugged(*[(b"?", b"")] * 8)
    with pytest.raises(NoAnswer, match="scripted: no answer for 2 s"):
        stage.connect()

    assert pytest.approx(clock.now()) == 2.0
    assert not stage.port.is_open


def test_a_controller_that_does_not_come_to_rest_is_named(plugged):
    held = status(state="Hold:0"), (b"$I\n", b"error:8\r\n")
    stage = plugged(*held * 200, settings=SETTINGS)
    with pytest.raises(StageFault, match="in state Hold for 2 s"):
        stage.connect()
    stage.port.exchanges.clear()


def test_a_busy_port_is_tried_for_a_while(plugged, clock, monkeypatch):
    stage = plugged(*READY)
    opened = stage.port.open

    def busy():
        if clock.now() < 9.0:
            raise PortBusy("scripted: another program has the port open.")
        opened()

    monkeypatch.setattr(stage.port, "open", busy)
    stage.connect()

    assert stage.homed


def test_a_port_that_stays_busy_is_given_up(plugged, clock, monkeypatch):
    stage = plugged()

    def busy():
        raise PortBusy("scripted: another program has the port open.")

    monkeypatch.setattr(stage.port, "open", busy)
    with pytest.raises(PortBusy, match="another program"):
        stage.connect()
    assert 15.0 <= clock.now() < 16.0


def test_a_missing_port_is_no_reason_to_wait(plugged, clock, monkeypatch):
    stage = plugged()

    def missing():
        raise PortError("scripted: no such port.")

    monkeypatch.setattr(stage.port, "open", missing)
    with pytest.raises(PortError, match="no such port"):
        stage.connect()
    assert clock.now() == 0.0


def test_a_move_ends_when_two_reports_say_idle_at_the_target(ready, journal):
    stage = ready(
        jog(x_mm=10.0), status(1.0, state="Jog"), *[status(9.0, state="Jog")] * 4, status(10.0), status(10.002)
    )
    stage.move(x_mm=10.0)

    assert (pytest.approx(10.002), 0.0) == stage.position_mm
    assert ("Jog", (pytest.approx(9.0), 0.0)) in journal.reports
    assert b"$J=G53G90G21X-50.0000F1200.000\n" in journal.sent


def test_reports_are_asked_for_at_most_ten_times_a_second(ready, clock):
    stage = ready(jog(x_mm=10.0), *[status(5.0, state="Jog")] * 10, status(10.0), status(10.0))
    before = clock.now()
    stage.move(x_mm=10.0)

    assert 1.1 <= clock.now() - before <= 1.25


def test_idle_before_the_way_can_have_been_made_does_not_count(ready):
    """A press and its release end where they began."""
    press = jog(0.0, 2.0, 720.0), jog(0.0, 0.0, 720.0)
    early = [status()] * 3
    stage = ready(*press, *early, status(0.0, 1.0, state="Jog"), status(), status())
    stage.path([(0.0, 2.0, 12.0), (0.0, 0.0, 12.0)])

    assert stage.counts.false_idle == len(early)


def test_idle_elsewhere_does_not_count(ready):
    stage = ready(jog(y_mm=1.0, feed=720.0), *[status(0.0, 0.5)] * 3, status(0.0, 1.0), status(0.0, 1.0))
    stage.move(y_mm=1.0)

    assert stage.counts.false_idle == 3


def test_a_move_that_ends_elsewhere_is_told(ready):
    stage = ready(jog(x_mm=10.0), *[status(4.0)] * 19)
    with pytest.raises(StageFault, match=r"be at x = 10 mm, but is at x = 4.000, y = 0.000 mm \(state Idle\)"):
        stage.move(x_mm=10.0)


def test_a_torn_report_is_asked_for_again(ready):
    torn = b"?", b"<Idle|MPos:-50.000,[MSG:Pgm End]-40.000,0.000|FS:0,0>\r\n", 0.01
    stage = ready(jog(x_mm=10.0), *[torn] * 5, status(10.0), torn, status(10.0))
    stage.move(x_mm=10.0)

    assert 6 == stage.counts.unknown == stage.counts.silent_polls


def test_a_lost_ok_is_made_up_for_by_the_position(ready, journal):
    stage = ready(jog(x_mm=1.0, answer=b""), *[status(1.0)] * 4)
    stage.move(x_mm=1.0)

    assert stage.counts.unanswered == 1
    assert "lost ok" in journal.events


def test_a_lost_ok_of_a_press_ends_before_the_release_is_sent(ready):
    stage = ready(jog(0.0, 1.0, 720.0, b""), *[status(0.0, 1.0)] * 2, VERSION, jog(0.0, 0.0, 720.0), *[status()] * 2)
    stage.path([(0.0, 1.0, 12.0), (0.0, 0.0, 12.0)])

    assert stage.position_mm == (0.0, 0.0)


def test_a_lost_command_is_not_sent_again(ready, journal):
    stage = ready(jog(x_mm=10.0, answer=b""), *[status(0.0)] * 14)
    with pytest.raises(StageFault, match=r"is at x = 0\.000"):
        stage.move(x_mm=10.0)

    assert sum(data.startswith(b"$J") for data in journal.sent) == 1


def test_an_extra_ok_answers_nothing(ready):
    stage = ready(
        jog(x_mm=0.1, answer=b"ok\r\nok\r\n"), *[status(0.1)] * 2, (b"", b"ok\r\n"), jog(x_mm=0.2), *[status(0.2)] * 2
    )
    stage.move(x_mm=0.1)
    stage.move(x_mm=0.2)

    assert stage.counts.extra_answers == 2


def test_a_refused_move_is_told_and_not_repeated(ready):
    stage = ready(jog(x_mm=10.0, answer=b"error:15\r\n"))
    with pytest.raises(CommandRefused, match=r"refused \$J=.* error:15, the jog would leave the travel") as caught:
        stage.move(x_mm=10.0)

    assert caught.value.code == 15
    assert stage.counts.refused == 1


@pytest.mark.parametrize(
    ("move", "sentence"),
    [
        ({"x_mm": 17.5}, r"x = 17.5 mm is outside the limits of the stage, -1 to 17 mm"),
        ({"x_mm": 1.0, "y_mm": -2.5}, r"y = -2.5 mm is outside"),
        ({"y_mm": float("nan")}, r"y = nan mm is outside"),
        ({"x_mm": 1.0, "speed_mm_s": 51.0}, r"at most 50 mm/s, the maximum rate of the controller, got 51"),
        ({"x_mm": 1.0, "speed_mm_s": 0.0}, r"above 0"),
        ({"x_mm": 1.0, "speed_mm_s": float("nan")}, r"got nan"),
    ],
)
def test_nothing_is_sent_beyond_the_limits(ready, move, sentence):
    stage = ready()
    with pytest.raises(OutOfLimits, match=sentence):
        stage.move(**move)


def test_all_points_of_a_path_are_checked_before_any_is_sent(ready):
    stage = ready()
    with pytest.raises(OutOfLimits, match="y = 4 mm"):
        stage.path([(0.0, 1.0, 12.0), (0.0, 4.0, 12.0)])


def test_a_move_needs_somewhere_to_go(ready):
    stage = ready()
    with pytest.raises(ValueError, match="x_mm or y_mm"):
        stage.move()
    with pytest.raises(ValueError, match="needs at least one point"):
        stage.path([])


def test_a_silent_controller_is_given_up(ready, clock):
    stage = ready(jog(x_mm=10.0), *[(b"?", b"")] * 20)
    with pytest.raises(NoAnswer, match="no answer from the controller to 20 status requests"):
        stage.move(x_mm=10.0)

    assert stage.counts.silent_polls == 20


ALARM = b"ALARM:1\r\n[MSG:Reset to continue]\r\n"


def test_an_alarm_stops_everything(ready):
    stage = ready(jog(x_mm=10.0), status(3.0, state="Jog"), (b"", ALARM, 0.05), (b"\x85", b""))
    with pytest.raises(StageAlarm, match="ALARM:1, a limit switch was hit, and lost its position") as caught:
        stage.move(x_mm=10.0)

    assert 1 == caught.value.code == stage.counts.alarms
    assert stage.position_mm is None
    for use in (lambda: stage.move(x_mm=1.0), stage.stop, lambda: stage.check(0.0)):
        with pytest.raises(StageAlarm, match="ALARM:1"):
            use()


def test_homing_after_an_alarm_resets_the_controller_first(ready):
    stage = ready(
        jog(x_mm=10.0),
        (b"", ALARM),
        (b"\x18", b"ok\r\n" + BANNER + b"[MSG:'$H'|'$X' to unlock]\r\n", 0.1),
        status(state="Alarm"),
        (b"$H\n", b"ok\r\n", 20.0),
        *[status()] * 2,
    )
    with pytest.raises(StageAlarm, match="ALARM:1"):
        stage.move(x_mm=10.0)
    stage.home()

    assert stage.homed
    assert stage.counts.resets == 0


def test_an_alarm_whose_message_was_lost_shows_in_the_report(ready):
    stage = ready(jog(x_mm=10.0), status(3.0, state="Alarm"))
    with pytest.raises(StageAlarm, match="stopped with an alarm; clear its path"):
        stage.move(x_mm=10.0)


def test_a_restart_costs_the_position(ready, journal):
    stage = ready(jog(x_mm=10.0), status(3.0, state="Jog"), (b"", BANNER, 0.05))
    with pytest.raises(StageFault, match=r"restarted by itself \(Grbl 1.1h\)"):
        stage.move(x_mm=10.0)

    assert stage.position_mm is None
    assert stage.counts.resets == 1
    assert "reset" in journal.events


def test_a_restart_between_moves_is_seen_by_the_guard(ready, loop):
    stage = ready((b"", BANNER, 0.5))
    with loop.guarded(stage.check), pytest.raises(StageFault, match="restarted"):
        loop.sleep(1.0)


def test_homing_is_silent_and_ends_in_a_known_position(plugged, journal):
    stage = plugged(
        status(), VERSION, dollar(), status(state="Alarm"), (b"$H\n", b"ok\r\n", 25.0), status(59.0), status(59.0)
    )
    stage.connect()
    stage.home()

    assert stage.position_mm == (59.0, 0.0)


def test_a_switch_that_is_not_found_is_an_alarm(plugged):
    failed = b"ALARM:9\r\n" + BANNER
    stage = plugged(status(), VERSION, dollar(), status(state="Alarm"), (b"$H\n", failed, 5.0))
    stage.connect()
    with pytest.raises(StageAlarm, match="ALARM:9, homing found no switch"):
        stage.home()

    assert stage.counts.resets == 0
    assert not stage.homed


def test_a_homing_whose_ok_is_lost_counts_if_it_ended_at_home(ready, journal):
    home = status(59.0, -39.0)
    stage = ready((b"$H\n", b""), home, home)
    stage.home()

    assert stage.homed
    assert "lost ok" in journal.events


@pytest.mark.parametrize("answer", [status(), (b"?", b"")])
def test_a_homing_that_does_not_end_is_stopped(ready, answer):
    stage = ready((b"$H\n", b""), *[answer] * (1 if answer[1] else 20), (b"\x18", b""))
    with pytest.raises(NoAnswer, match=r"homing did not end within 30 s|to 20 status requests"):
        stage.home()

    assert stage.position_mm is None


def test_an_interrupted_homing_is_stopped(ready, loop):
    def interrupt(now_s):
        if now_s > 3.0:
            raise KeyboardInterrupt

    stage = ready((b"$H\n", b""), (b"\x18", b""))
    with loop.guarded(interrupt), pytest.raises(KeyboardInterrupt):
        stage.home()

    with pytest.raises(StageAlarm, match="homing was interrupted"):
        stage.move(x_mm=1.0)


def test_stopping_says_cancel_until_the_controller_is_idle_twice(ready):
    stage = ready(
        (b"\x85", b""),
        status(state="Jog"),
        (b"\x85", b"ok\r\n"),
        status(),
        status(state="Jog"),
        (b"\x85", b""),
        *[status(1.0)] * 2,
    )
    stage.stop()

    assert stage.position_mm == (1.0, 0.0)


def test_a_stage_that_does_not_stop_is_told(ready):
    stage = ready((b"\x85", b""), *[status(state="Run"), (b"\x85", b"")] * 200)
    with pytest.raises(StageFault, match=r"did not stop \(state Run\)"):
        stage.stop()
    stage.port.exchanges.clear()


def test_a_guard_that_objects_leaves_a_stage_that_can_be_stopped_and_moved(ready, loop):
    """The answer to the cancelled jog comes late."""

    def objects(now_s):
        if stage.port.sent > before:
            raise SensorTrouble("a taxel is overloaded.")

    stage = ready(
        jog(0.0, 2.0, 720.0, b""),
        (b"\x85", b"ok\r\n", 0.02),
        status(0.0, 1.0, state="Jog"),
        (b"\x85", b""),
        *[status(0.0, 1.2)] * 2,
        jog(y_mm=0.0, feed=720.0),
        *[status()] * 3,
    )
    before = stage.port.sent
    with loop.guarded(objects):
        with pytest.raises(SensorTrouble, match="overloaded"):
            stage.path([(0.0, 2.0, 12.0), (0.0, 0.0, 12.0)])
        with loop.unguarded():
            stage.stop()
            stage.move(y_mm=0.0)

    assert stage.position_mm == (0.0, 0.0)
    assert stage.counts.extra_answers == 1


class SensorTrouble(RigError):
    """Something else on the rig."""


def test_a_lost_port_costs_the_position(ready):
    stage = ready(jog(x_mm=10.0), (b"?", PortLost("scripted: the port was lost.")))
    with pytest.raises(PortLost, match="was lost"):
        stage.move(x_mm=10.0)

    assert stage.position_mm is None
    with pytest.raises(PortLost, match="scripted"):
        stage.stop()
    stage.close()


def test_a_write_that_timed_out_leaves_the_place_unknown_until_a_report(ready):
    late = WriteTimeout("scripted: the device took no bytes.")
    stage = ready(
        (jog(x_mm=10.0)[0], late), (b"\x85", b""), *[status(4.0)] * 2, VERSION, jog(x_mm=0.0), *[status()] * 3
    )
    with pytest.raises(WriteTimeout, match="took no bytes"):
        stage.move(x_mm=10.0)

    assert stage.position_mm is None
    stage.stop()
    assert stage.position_mm == (4.0, 0.0)
    stage.move(x_mm=0.0)


def test_closing_never_fails(plugged):
    stage = plugged()
    stage.close()
    stage.close()

    assert stage.position_mm is None
    with pytest.raises(PositionUnknown, match="not connected"):
        stage.stop()


def test_two_devices_share_a_loop_after_one_is_lost(ready, loop, scripted):
    """What is left can still be brought to rest."""
    other = scripted(address="sensor")
    other.open()
    loop.attach(other, lambda *_: None)
    stage = ready(jog(x_mm=0.1), *[status(0.1)] * 2)
    other.failure = PortLost("sensor: the port was lost.")
    with pytest.raises(PortLost, match="sensor"):
        loop.turn(loop.now)
    stage.move(x_mm=0.1)

    assert isinstance(loop, Loop)
