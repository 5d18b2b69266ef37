"""Faults of the stage and how the whole rig handles them; numbers are rows of docs/reference/faults.md."""

import re

import pytest
from solidtouch.hardware.errors import CommandRefused, NoAnswer, NotAtRest, PositionUnknown, StageFault, WriteTimeout
from solidtouch.hardware.stage.course import MotionCourse
from solidtouch.hardware.stage.grbl import JOG_CANCEL

from benchmarks.checks import damage


def lines(bench):
    """Whole lines sent to the stage, without those that only act at once."""
    return [data for data in bench.diary.sent(bench.stage_port) if data.endswith(b"\n")]


def is_jog(command):
    return command[1].startswith(b"$J=")


def assert_true(bench, samples):
    assert bench.deviation(samples) < 1e-9
    assert bench.is_clear


def assert_lost(bench, rig):
    """Where the stage is is not known, it does not move, and nothing frees or homes it by itself."""
    assert rig.stage.position_mm is None
    place_mm = bench.place_mm
    with pytest.raises(StageFault, match=re.escape(bench.stage_port)):
        rig.stage.move(y_mm=0.0)
    assert place_mm == bench.place_mm
    assert not any(line.startswith((b"$H", b"$X")) for line in lines(bench))


def test_fault_05_torn_status(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.on("torn_status", rate=0.5)
        assert_true(rig_bench, rig.tap())
        assert rig_bench.struck("torn_status") > 2
        assert rig.stage.counts.unknown + rig.stage.counts.dropped > 0


def test_fault_09_reset_on_open(rig_bench):
    rig_bench.on("reset_on_open")
    with pytest.raises(PositionUnknown, match=r"home it \(--home\)"), rig_bench.rig():
        pass
    assert lines(rig_bench) == [b"$$\n"]

    with rig_bench.rig(home=True) as rig:
        assert_true(rig_bench, rig.tap())


def test_fault_10_brown_out(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.once_deep(lambda: rig_bench.on("brown_out", times=1))
        with pytest.raises(NotAtRest, match=r"restarted by itself .* lift it by hand"):
            rig.tap()
        assert rig.stage.counts.resets == 1
        assert_lost(rig_bench, rig)

    with rig_bench.rig(home=True) as rig:
        assert_true(rig_bench, rig.tap())


@pytest.mark.parametrize("number", [1, 2], ids=["press", "release"])
def test_fault_13_lost_ok(rig_bench, number):
    with rig_bench.rig() as rig:
        sent = []
        strike = lambda: rig_bench.on("lost_ok", times=1)  # noqa: E731
        rig_bench.diary.when(
            "command", strike, lambda command: is_jog(command) and len(sent.append(1) or sent) == number
        )
        samples = rig.tap()
        assert_true(rig_bench, samples)
        assert rig.stage.counts.unanswered == 1
        assert rig_bench.diary.all("tap") == [
            (False, "an answer of the stage was lost, so the press lasted too long"),
            (True, ""),
        ]
        press, release, *rest = [line for line in lines(rig_bench) if line.startswith(b"$J=")]

    assert press != release
    assert rest == [press, release]
    assert any("a jog ended without an ok" in text for kind, text in rig_bench.diary.all("event") if kind == "lost ok")


def test_fault_14_extra_ok(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.on("extra_ok")
        assert_true(rig_bench, rig.tap())
        assert rig.stage.counts.extra_answers >= 2
        assert not any(b"\r" in line for line in lines(rig_bench))


@pytest.mark.parametrize("number", [1, 2], ids=["press", "release"])
@pytest.mark.parametrize("code", [9, 15])
def test_fault_15_refused_move(rig_bench, number, code):
    with rig_bench.rig() as rig:
        sent = []
        strike = lambda: rig_bench.on("refuse_move", times=1, code=code)  # noqa: E731
        rig_bench.diary.when(
            "command", strike, lambda command: is_jog(command) and len(sent.append(1) or sent) == number
        )
        with pytest.raises(CommandRefused, match=rf"refused \$J=.* error:{code}, ") as raised:
            rig.tap()
        assert raised.value.code == code
        assert rig_bench.is_clear
        assert rig.stage.counts.refused == 1
        jogs = [line for line in lines(rig_bench) if line.startswith(b"$J=")]
        assert len(jogs) in (number, number + 1)  # one more if the finger had left
        assert rig_bench.diary.all("tap") == []
        assert_true(rig_bench, rig.tap())


def test_fault_16_limit_alarm(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.on("limit_alarm", times=1)
        with pytest.raises(
            NotAtRest, match=r"ALARM:1, .* lost its position; clear its path, then home it\. The finger may"
        ):
            rig.tap()
        assert rig.stage.counts.alarms == 1
        assert_lost(rig_bench, rig)

    with pytest.raises(NoAnswer, match="locked by an alarm until its reset button is pressed"), rig_bench.rig():
        pass
    assert not any(b"$X" in line for line in lines(rig_bench))
    with rig_bench.rig(home=True) as rig:
        assert_true(rig_bench, rig.tap())


def test_fault_17_silent_status(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.on("silent_status", times=5)
        assert_true(rig_bench, rig.tap())
        assert rig.stage.counts.silent_polls >= 5
        rig_bench.on("silent_status")
        before_s = rig_bench.clock.now()
        with pytest.raises(NotAtRest, match="no answer from the controller to 20 status requests") as raised:
            rig.tap()
        assert isinstance(raised.value.__cause__, NoAnswer)
        assert rig_bench.clock.now() - before_s < 15
        rig_bench.off()


@pytest.mark.parametrize("seconds", [0.05, 0.3])
def test_fault_18_false_idle(rig_bench, seconds):
    with rig_bench.rig() as rig:
        rig_bench.on("false_idle", seconds=seconds)
        rig.go(12.5)
        assert rig_bench.place_mm[0] == pytest.approx(12.5, abs=0.01)
        assert_true(rig_bench, rig.tap())


def test_fault_19_receive_buffer(rig_bench):
    """A path of many points goes through 128 bytes, as no line is sent before the last one was answered."""
    points = [(1.0 + 0.5 * (i % 20), -0.1 * (i % 7), 12.0) for i in range(14)]
    with rig_bench.rig() as rig:
        rig.stage.path(points)
        assert rig_bench.place_mm == pytest.approx(points[-1][:2], abs=0.01)
        assert rig.stage.counts.unanswered == 0
        assert len(lines(rig_bench)) == 14
        assert max(map(len, lines(rig_bench))) < 80


def test_fault_20_settings_are_never_written(rig_bench):
    with rig_bench.rig(home=True) as rig:
        rig.tap()
    sent = lines(rig_bench)

    assert sent
    assert not any(re.match(rb"\$\d", line) for line in sent)


@pytest.mark.parametrize("number", [1, 2], ids=["press", "release"])
@pytest.mark.parametrize("arrives", [True, False])
def test_fault_21_write_timeout(rig_bench, number, arrives):
    """Whether the line arrived or not, it is not sent again, and the finger ends off the object."""
    with rig_bench.rig() as rig:
        write, jogs = rig.stage.port.write, []

        def blocked(data):
            jogs.append(data) if data.startswith(b"$J=") else None
            if len(jogs) != number or data != jogs[-1]:
                write(data)
                return
            write(data if arrives else data[:10])
            raise WriteTimeout(f"{rig_bench.stage_port}: the device took no bytes for 1 s.")

        rig.stage.port.write = blocked
        with pytest.raises(WriteTimeout, match="took no bytes for 1 s"):
            rig.tap()
        assert len(jogs) in (number, number + 1)  # one more if the finger had left
        assert jogs[number - 1] not in jogs[number:]
        assert rig_bench.is_clear
        assert_true(rig_bench, rig.tap())


def test_fault_21_deaf(rig_bench):
    """A line that is read late is not sent again; the tap is."""
    with rig_bench.rig() as rig:
        rig_bench.diary.when("command", lambda: rig_bench.on("deaf", times=1, port="stage", seconds=0.7), is_jog)
        assert_true(rig_bench, rig.tap())
        assert rig.tally.rejected == 1
        assert rig.stage.counts.unanswered == 1
        jogs = [line for line in lines(rig_bench) if line.startswith(b"$J=")]
        assert len(jogs) == 4
        assert JOG_CANCEL not in rig_bench.diary.sent(rig_bench.stage_port)


def test_fault_33_damaged_commands():
    """A sample of what `make faults` does with every byte of every command."""
    tally = damage.run(positions=2, stride=83)

    assert not tally.failed, tally.examples
    assert all(tally.cases[kind] > tally.done[kind] > 0 for kind in damage.KINDS)
    assert tally.strayed_mm > 0.1


def test_fault_33_without_a_look_at_the_path(monkeypatch):
    """A lost digit is then noticed at the end only."""
    monkeypatch.setattr(MotionCourse, "objection", lambda *_: None)
    rig, tally = damage.paper_rig(), damage.Tally()
    *_, go = [action for action in damage.collection(rig, 2) if action.name == "go"]
    writes, sound = damage.reference(rig, go)
    assert writes[0].startswith(b"$J=G53X-30.5")
    damage.check(rig, go, damage.Damage(0, "lost", 8, 0), sound, writes[0], tally)

    assert tally.strayed_mm > 5.0
    assert tally.failed
