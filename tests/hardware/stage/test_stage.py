"""The stage driver byte by byte: what it sends, and what it makes of the answers."""

import pytest
from solidtouch.hardware.errors import (
    CommandRefused,
    NoAnswer,
    OutOfLimits,
    PortLost,
    PositionUnknown,
    RigError,
    StageAlarm,
    StageFault,
    WriteTimeout,
)
from solidtouch.hardware.link.loop import Loop
from stage_script import BANNER, PROTECT, back, dollar, jog, status


def test_a_move_ends_when_two_reports_say_idle_at_the_target(ready, journal):
    stage = ready(
        jog(x_mm=10.0), status(1.0, state="Jog"), *[status(9.0, state="Jog")] * 17, status(10.0), status(10.002)
    )
    stage.move(x_mm=10.0)

    assert (pytest.approx(10.002), 0.0) == stage.position_mm
    assert ("Jog", (pytest.approx(9.0), 0.0)) in journal.reports
    assert b"$J=G53X-50.0000Y-40.0000Z0.0000F1200\n" in journal.sent


def test_reports_of_a_motion_are_asked_for_33_times_a_second(ready, clock):
    stage = ready(jog(x_mm=10.0), *[status(5.0, state="Jog")] * 18, status(10.0), status(10.0))
    before = clock.now()
    stage.move(x_mm=10.0)

    assert 0.55 <= clock.now() - before <= 0.65


def test_idle_before_the_way_can_have_been_made_does_not_count(ready):
    """A press and its release end where they began."""
    press = jog(0.0, 2.0, 720), back(0.0, -2.0)
    early = [status()] * 10
    stage = ready(*press, *early, status(0.0, 1.0, state="Jog"), status(), status())
    stage.path([(0.0, 2.0, 12.0), (0.0, 0.0, 12.0)])

    assert stage.counts.false_idle == len(early)


def test_idle_elsewhere_does_not_count(ready):
    stage = ready(jog(y_mm=1.0, feed=720), *[status(0.0, 0.5)] * 3, status(0.0, 1.0), status(0.0, 1.0))
    stage.move(y_mm=1.0)

    assert stage.counts.false_idle == 3


def test_a_move_that_ends_elsewhere_is_told(ready):
    stage = ready(jog(x_mm=10.0), *[status(4.0)] * 20)
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
    stage = ready(jog(0.0, 1.0, 720, b""), *[status(0.0, 1.0)] * 2, dollar(), back(0.0, -1.0), *[status()] * 2)
    stage.path([(0.0, 1.0, 12.0), (0.0, 0.0, 12.0)])

    assert stage.position_mm == (0.0, 0.0)


def test_a_lost_command_is_not_sent_again(ready, journal):
    stage = ready(jog(x_mm=10.0, answer=b""), *[status(0.0)] * 21)
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
    stage = ready(jog(x_mm=10.0), status(3.0, state="Jog"), (b"", ALARM, 0.005), (b"\x85", b""))
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
        status(),
        *PROTECT,
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
    stage = ready(jog(x_mm=10.0), status(3.0, state="Jog"), (b"", BANNER, 0.005))
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
        status(),
        dollar(),
        status(state="Alarm"),
        (b"$H\n", b"ok\r\n", 25.0),
        status(59.0),
        *PROTECT,
        *[status(59.0)] * 2,
    )
    stage.connect()
    stage.home()

    assert stage.position_mm == (59.0, 0.0)


def test_a_switch_that_is_not_found_is_an_alarm(plugged):
    failed = b"ALARM:9\r\n" + BANNER
    stage = plugged(status(), dollar(), status(state="Alarm"), (b"$H\n", failed, 5.0))
    stage.connect()
    with pytest.raises(StageAlarm, match="ALARM:9, homing found no switch"):
        stage.home()

    assert stage.counts.resets == 0
    assert not stage.homed


def test_a_homing_whose_ok_is_lost_counts_if_it_ended_at_home(ready, journal):
    home = status(59.0, -39.0)
    stage = ready((b"$H\n", b""), home, dollar(), *PROTECT, home, home)
    stage.home()

    assert stage.homed
    assert "lost ok" in journal.events


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (status(), "homing did not end within 30 s"),
        ((b"?", b""), "no answer from the controller to 20 status requests"),
    ],
)
def test_a_homing_that_does_not_end_is_stopped(ready, answer, message):
    stage = ready((b"$H\n", b""), *[answer] * (1 if answer[1] else 20), (b"\x18", b""))
    with pytest.raises(NoAnswer, match=message):
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


def test_a_stage_is_at_rest_where_two_reports_agree(ready):
    """One of them alone may be damaged."""
    stage = ready((b"\x85", b""), status(-62.0), *[status(2.0)] * 2)
    stage.stop()

    assert stage.position_mm == (2.0, 0.0)


def test_a_stage_that_does_not_stop_is_told(ready):
    stage = ready((b"\x85", b""), *[status(state="Run"), (b"\x85!", b"")] * 200)
    with pytest.raises(StageFault, match=r"did not stop \(state Run\); it is at x = 0.000, y = 0.000 mm"):
        stage.stop()
    stage.port.exchanges.clear()


def test_a_guard_that_objects_leaves_a_stage_that_can_be_stopped_and_moved(ready, loop):
    """The answer to the cancelled jog comes late."""

    def objects(now_s):
        if stage.port.sent > before:
            raise SensorTrouble("a taxel is overloaded.")

    stage = ready(
        jog(0.0, 2.0, 720, b""),
        (b"\x85", b"ok\r\n", 0.02),
        status(0.0, 1.0, state="Jog"),
        (b"\x85", b""),
        *[status(0.0, 1.2)] * 2,
        jog(y_mm=0.0, feed=720),
        *[status()] * 5,
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
        (jog(x_mm=10.0)[0], late), (b"\x85", b""), *[status(4.0)] * 2, dollar(), jog(x_mm=0.0), *[status()] * 8
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
