"""The stage driver connects, byte by byte: which controllers it takes, and what it makes of their first answers."""

import re

import pytest
from solidtouch.hardware.errors import (
    NoAnswer,
    OutOfLimits,
    PortBusy,
    PortError,
    PositionUnknown,
    StageFault,
    WrongDevice,
)
from stage_script import BANNER, PROTECT, READY, SETTINGS, dollar, report, status


def test_a_controller_that_was_homed_before_keeps_its_position(ready):
    stage = ready()

    assert stage.homed
    assert stage.position_mm == (0.0, 0.0)
    assert (*stage.report[:3], stage.report.notes) == ("Grbl 1.1", "Idle", True, ())
    assert stage.report.values[100] == 250.0


def test_a_controller_that_opening_reset_does_not_know_where_it_is(plugged):
    unheard = [(b"?", b"")] * 6
    stage = plugged(*unheard[:-1], (b"?", BANNER, 0.2), dollar(), status(state="Alarm"))
    stage.connect()

    assert not stage.homed
    assert stage.position_mm is None
    with pytest.raises(PositionUnknown, match="position unknown; home the stage first"):
        stage.move(x_mm=1.0)


def test_a_restart_at_opening_costs_the_position_even_if_the_controller_is_idle(plugged):
    stage = plugged((b"?", BANNER), dollar(), status())
    stage.connect()

    assert not stage.homed


def test_a_position_outside_the_travel_is_not_believed(plugged):
    stage = plugged(status(), dollar(), status(61.5))
    stage.connect()

    assert stage.position_mm is None


def test_old_input_is_no_answer(plugged):
    stage = plugged((b"", b"ok\r\nerror:9\r\n<Idle|MP" + report(5.0) + b"ok\r\n"), *READY)
    stage.connect()

    assert stage.position_mm == (0.0, 0.0)


def test_half_a_command_that_was_left_is_refused_and_asked_again(plugged):
    stage = plugged(status(), (b"$$\n", b"error:1\r\n"), *READY)
    stage.connect()

    assert stage.homed


def test_settings_with_a_lost_line_are_asked_again(plugged):
    stage = plugged(status(), dollar(_110=None), dollar(), status(), *PROTECT, status())
    stage.connect()

    assert stage.homed


def test_work_positions_are_understood_once_their_offset_came(plugged):
    work = b"<Idle|WPos:1.000,2.000,0.000|FS:0,0>\r\n"
    offset = b"<Idle|WPos:1.000,2.000,0.000|FS:0,0|WCO:-61.000,-42.000,0.000>\r\n"
    stage = plugged((b"?", work), dollar(_10=0), (b"?", work), (b"?", offset), *PROTECT, (b"?", work))
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
        ({"_101": 5}, r"Y has 5 steps per mm \(\$101\), too few to watch its path; at least 10 are needed"),
        ({"_101": 0}, r"steps of Y must be above 0, got \$101=0"),
    ],
)
def test_a_controller_set_up_otherwise_is_refused(plugged, changed, sentence):
    stage = plugged(status(), dollar(**changed))
    with pytest.raises(WrongDevice, match=sentence):
        stage.connect()

    assert not stage.port.is_open


@pytest.mark.parametrize(
    ("changed", "note"),
    [({"_1": 25}, r"released 25 ms"), ({"_21": 0}, r"\$21=1"), ({"_23": 2}, r"homing ends at y = 159 mm")],
)
def test_what_may_disappoint_is_noted(plugged, changed, note):
    stage = plugged(status(), dollar(**changed), status(), *PROTECT, status())
    stage.connect()

    (text,) = stage.report.notes
    assert re.search(note, text)


def test_homing_beyond_the_object_is_refused_unless_allowed(plugged):
    stage = plugged(status(), dollar(_23=2))
    with pytest.raises(OutOfLimits, match=r"end at y = 159 mm, beyond the object; .* stage.homes_past_object = true"):
        stage.connect(will_home=True)


def test_homing_bits_of_grblhal_are_understood(plugged):
    stage = plugged(status(), dollar(_22=13), status(), *PROTECT, status())
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
    stage = plugged((b"?", b"\r\nGrbl 0.9j ['$' for help]\r\n"), dollar())
    with pytest.raises(WrongDevice, match=r"requires GRBL 1.1, the controller has 0.9j"):
        stage.connect()


def test_silence_ends_at_the_deadline(plugged, clock):
    stage = plugged(*[(b"?", b"")] * 8)
    with pytest.raises(NoAnswer, match="scripted: no answer for 2 s"):
        stage.connect()

    assert pytest.approx(clock.now()) == 2.0
    assert not stage.port.is_open


def test_a_controller_that_does_not_come_to_rest_is_named(plugged):
    held = status(state="Hold:0"), (b"$$\n", b"error:8\r\n")
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
