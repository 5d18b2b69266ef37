"""The rig on an emulated bench: what it does when all is well, and that its finger is off whatever ends a tap."""

import signal
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from solidtouch.hardware.errors import (
    NotAtRest,
    OutOfLimits,
    PortLost,
    PositionUnknown,
    SensorFault,
    SensorOverload,
    StageAlarm,
    StageFault,
    StaleSensor,
)
from solidtouch.hardware.named_rigs import LabelledRig
from solidtouch.hardware.recording.recording import Recorder
from solidtouch.hardware.recording.settings import about_rig
from solidtouch.hardware.rig.open_rig import connected
from solidtouch.hardware.rig.rest import still_pressing
from solidtouch.hardware.rig.rig import TapTally
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.models.io.rig import taps_from_recording

PAPER = PRESETS["paper"]
SMALL = replace(
    PAPER, taxels=PAPER.taxels[:7], rods=PAPER.rods[:3], start_mm=5.0, end_mm=11.0, cell_mm=1.5, spacing_mm=0.25
)
BENCHES = {
    "icub": {},
    "lines": {"kind": "lines"},
    "7 taxels at 25 Hz": {"settings": replace(SMALL, rate_hz=25.0)},
    "7 taxels in lines": {"settings": SMALL, "kind": "lines"},
}


def changed(settings, **tap):
    return msgspec.structs.replace(settings, tap=msgspec.structs.replace(settings.tap, **tap))


def jogs(bench):
    """Jogs sent to the stage."""
    return [data for data in bench.diary.sent(bench.stage_port) if data.startswith(b"$J=")]


def is_jog(command):
    return command[1].startswith(b"$J=")


def interrupt(error):
    def act():
        raise error

    return act


@pytest.fixture(params=BENCHES.values(), ids=BENCHES.keys())
def any_bench(request, make_bench):
    with make_bench(**request.param) as bench:
        yield bench


def test_a_tap_is_what_the_finger_felt(any_bench):
    with any_bench.rig() as rig:
        samples = rig.tap()

    assert (rig.preprocessing.samples, rig.skin.taxels) == samples.shape
    assert any_bench.deviation(samples) < 1e-9
    assert samples.max() > 20
    assert np.abs(samples[: rig.settings.tap.lead_samples]).max() < 3 * rig.settings.sensor.noise_limit
    assert rig.tally.accepted == 1
    assert rig.tally.rejected == 0


def test_taps_keep_to_the_limits_and_end_off_the_object(any_bench):
    stage, tap = any_bench.settings.stage, any_bench.settings.tap
    with any_bench.rig() as rig:
        any_bench.places.clear()
        for delta in (-50, 50, 0):
            rig.move(delta)
            rig.tap()
            assert any_bench.is_clear
    x, y = np.array(any_bench.places).T

    assert stage.x.low_mm < x.min() < x.max() < stage.x.high_mm
    assert stage.y.low_mm < y.min() < y.max() <= tap.depth_mm + 0.01
    assert y.max() > tap.depth_mm - 0.5


def test_a_tap_is_a_press_and_a_release_in_one_go(rig_bench):
    """Nothing is asked between the two, so the release is on its way before the press has ended."""
    with rig_bench.rig() as rig:
        rig.tap()
        commands = rig_bench.diary.sent(rig_bench.stage_port)
    press, release, *polls = commands

    assert b"Y-32.5" in press
    assert b"G91X0.0000Y2.5" in release
    assert {b"?"} == set(polls)


def test_taps_follow_each_other_once_a_second(any_bench):
    with any_bench.rig() as rig:
        for _ in range(5):
            rig.tap()
    pressed_s = np.array([time_s for time_s, _ in any_bench.diary.all("press")])

    np.testing.assert_allclose(np.diff(pressed_s), any_bench.settings.tap.period_s, atol=0.001)


def test_contact_falls_on_the_same_sample_of_each_tap(rig_bench):
    with rig_bench.rig() as rig:
        taps = np.array([rig.tap() for _ in range(6)])
    first = (taps.max(axis=2) > 20).argmax(axis=1)

    assert np.ptp(first) <= 1


def test_moves_are_clipped_to_the_range_and_counted_in_steps(any_bench):
    limits = any_bench.settings.range
    L = limits.where_classes
    with any_bench.rig() as rig:
        start = rig.where_index
        assert rig.room == (start, L - 1 - start)
        for delta, where in ((0, start), (1, start + 1), (-50, 0), (50, L - 1), (-2, L - 3)):
            before = rig.where_index
            assert where - before == rig.move(delta)
            assert rig.room == (where, L - 1 - where)
            assert any_bench.place_mm[0] == pytest.approx(limits.start_mm + (where + 0.5) * limits.cell_mm, abs=0.01)


def test_a_seed_reproduces_every_tap(make_bench):
    def history(seed):
        with make_bench(seed=seed) as bench, bench.rig() as rig:
            taps = []
            for delta in (0, 1, -3):
                rig.move(delta)
                taps.append(rig.tap())
        return np.array(taps)

    first = history(3)

    np.testing.assert_array_equal(first, history(3))
    assert not np.array_equal(first, history(4))


def test_the_period_is_kept_through_moves_that_fit_into_it(rig_bench):
    settings = changed(rig_bench.settings, period_s=2.0)
    with rig_bench.rig(settings=settings) as rig:
        for delta in (0, 1, -2):
            rig.move(delta)
            rig.tap()
    pressed_s = [time_s for time_s, _ in rig_bench.diary.all("press")]

    np.testing.assert_allclose(np.diff(pressed_s), 2.0, atol=0.021)


@pytest.mark.parametrize("lead", [1, 25, 40])
def test_the_first_tap_and_one_after_trouble_have_all_their_samples(rig_bench, lead):
    """All of them are from after the start of the readings, and those before the press from a finger at rest."""
    settings = changed(rig_bench.settings, lead_samples=lead, samples=lead + 30, period_s=0.02 * (lead + 30))
    rig_bench.emulation.control({"object": 4})
    with connected(rig_bench.build()):
        pass
    with connected(rig_bench.build(settings=settings)) as rig:  # it stands where it goes
        assert rig_bench.deviation(rig.tap()) < 1e-9
        rig_bench.once_deep(lambda: rig_bench.diary.when("frame", interrupt(KeyboardInterrupt())))
        rig.go(8.5)
        with pytest.raises(KeyboardInterrupt):
            rig.tap()
        at_rest_s = rig.loop.now
        samples = rig.tap()
    *_, (pressed_s, _) = rig_bench.diary.all("press")

    assert rig_bench.deviation(samples) < 1e-9
    assert rig.tally.rejected == 0
    assert pressed_s > at_rest_s + 0.02 * (lead - 1)
    assert samples.max() > 20


def test_the_samples_before_a_press_come_after_the_end_of_the_last_one(rig_bench):
    """Where these are many, taps follow each other more slowly than asked for."""
    settings = changed(rig_bench.settings, lead_samples=23)
    with rig_bench.rig(settings=settings) as rig:
        for _ in range(3):
            rig.tap()
    pressed_s = [time_s for time_s, _ in rig_bench.diary.all("press")]

    assert (np.diff(pressed_s) > 1.01).all()


def test_the_label_of_a_tap_is_told_with_its_place(rig_bench):
    with rig_bench.rig() as rig:
        rig.label = {"trial": 4}
        rig.tap()

    assert [{"trial": 4, "x_mm": rig.place_mm}] == [label for _, label in rig_bench.diary.all("press")]
    assert rig_bench.diary.all("tap") == [(True, "")]


def test_a_place_beyond_the_range_is_refused_and_nothing_is_sent(rig_bench):
    with rig_bench.rig() as rig:
        for x_mm in (-0.1, 16.1, float("nan"), float("inf")):
            with pytest.raises(OutOfLimits, match=r"outside the range of emulated, 0 to 16 mm"):
                rig.go(x_mm)
        assert rig_bench.diary.sent(rig_bench.stage_port) == []
        rig.go(0.0)
        assert rig.where_index == 0
        rig.go(16.0)
        assert rig.where_index == 15


def test_a_recording_gives_the_taps_that_were_made_live(any_bench, tmp_path):
    """Also where taps were made again, broken off or had no label, at all sizes."""
    about = msgspec.structs.replace(about_rig(any_bench.settings), objects=list(any_bench.emulation.objects))
    path = tmp_path / "taps.mcap"
    with Recorder.create(path, about) as recorder, any_bench.rig(journal=recorder) as rig:
        labelled, live = LabelledRig(rig), []
        labelled.tap()
        labelled.what = 1
        any_bench.once_deep(lambda: any_bench.on("lost_frames", times=1))
        for delta in (0, 1, -2):
            labelled.move(delta)
            live.append(labelled.tap())
            any_bench.once_deep(lambda: any_bench.on("silent_sensor", times=10))
            with pytest.raises(StaleSensor, match="no reading for"):
                labelled.tap()
    taps = taps_from_recording(path)

    assert rig.tally.rejected == 1
    np.testing.assert_array_equal(np.array(live), taps.taps)


ENDS = {
    "a mistake of the program": ZeroDivisionError("division by zero"),
    "Ctrl-C": KeyboardInterrupt(),
    "the end of the process": SystemExit(143),
}


@pytest.mark.parametrize("end", ENDS.values(), ids=ENDS)
@pytest.mark.parametrize("kind", ["icub", "lines"])
def test_whatever_ends_a_tap_the_finger_is_taken_off_first(make_bench, kind, end):
    """The error comes from within, at the deepest point, and the rig can go on afterwards."""
    with make_bench(kind=kind) as bench, bench.rig() as rig:
        bench.once_deep(lambda: bench.diary.when("frame", interrupt(end)))
        with pytest.raises(type(end)):
            rig.tap()
        assert bench.is_clear
        assert max(y for _, y in bench.places) > 1.5

        assert bench.deviation(rig.tap()) < 1e-9


@pytest.mark.parametrize("number", range(4))
def test_ctrl_c_at_any_command_leaves_the_finger_off(rig_bench, number):
    """As a jog is told to the journal it has not been sent yet: no press, a press without release, or both."""
    left = [number]

    def due(command):
        left[0] -= command[0] == rig_bench.stage_port
        return left[0] < 0

    with rig_bench.rig() as rig:
        rig_bench.diary.when("command", interrupt(KeyboardInterrupt()), due)
        with pytest.raises(KeyboardInterrupt):
            rig.tap()
        assert rig_bench.is_clear


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_second_signal_waits_until_the_finger_is_off(rig_bench, number):
    heard = []

    def handler(number, _):
        heard.append(rig_bench.is_clear)
        raise KeyboardInterrupt

    before = signal.signal(number, handler)
    try:
        with rig_bench.rig() as rig:
            rig_bench.once_deep(lambda: signal.raise_signal(number))
            rig_bench.diary.when("command", lambda: signal.raise_signal(number), lambda command: b"\x85" in command)
            with pytest.raises(KeyboardInterrupt):
                rig.tap()
            assert rig_bench.is_clear
    finally:
        signal.signal(number, before)

    assert heard == [False, True]


def test_an_overload_takes_the_finger_off_before_the_deepest_point(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.places.clear()
        rig_bench.diary.when("command", lambda: rig_bench.on("overload", mask=4), is_jog)
        with pytest.raises(SensorOverload, match="taxel 2 saturated and the finger was lifted"):
            rig.tap()
        assert rig_bench.is_clear

    assert max(y for _, y in rig_bench.places) < rig_bench.settings.tap.depth_mm - 0.5


def test_a_finger_deeper_than_it_was_sent_is_taken_off(rig_bench):
    with rig_bench.rig() as rig:
        deeper = rig_bench.settings.tap.depth_mm + 0.3
        path = rig.stage.path
        rig.stage.path = lambda points: path([(points[0][0], deeper, 2.0), points[1]])
        with pytest.raises(StageFault, match=r"deeper than tap\.depth_mm"):
            rig.tap()
        assert rig_bench.is_clear


def test_a_sensor_that_is_lost_while_the_finger_is_taken_off_does_not_keep_it_there(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.once_deep(lambda: rig_bench.on("silent_sensor"))
        unplug = lambda: (rig_bench.off(), rig_bench.on("unplug", times=1, seconds=60.0, port="sensor"))  # noqa: E731
        rig_bench.diary.when("command", unplug, lambda command: command[1] == b"\x85")
        with pytest.raises(StaleSensor, match="no reading for"):
            rig.tap()
        assert rig_bench.struck("unplug") == 1
        assert rig_bench.is_clear


def test_a_stage_that_does_not_obey_leaves_the_finger_to_the_operator(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.on("limit_alarm", times=1)
        with pytest.raises(NotAtRest, match="The finger may still be pressing; lift it by hand") as raised:
            rig.tap()

    assert not rig_bench.is_clear
    assert isinstance(raised.value.__cause__, StageAlarm)


def test_after_trouble_the_finger_is_lifted_before_it_goes_sideways(rig_bench):
    """As when the finger could not be taken off, and the program goes on nevertheless."""
    with rig_bench.rig() as rig:
        rig.stage.move(y_mm=1.8)
        rig_bench.places.clear()
        rig.go(2.5)
        rig.stage.move(x_mm=7.0, y_mm=1.0)
        rig.tap()
    sideways = [y for (x0, _), (x1, y) in zip(rig_bench.places, rig_bench.places[1:], strict=False) if x0 != x1]

    assert max(sideways[:-5]) < 1.1
    assert rig_bench.place_mm[0] == pytest.approx(2.5, abs=0.01)


@pytest.mark.parametrize(("what", "touched"), [(None, 0), (0, 2), (2, 2)])
def test_taps_that_touch_something_are_counted(any_bench, what, touched):
    with any_bench.rig() as rig:
        any_bench.emulation.control({"object": what})
        rig.tap()
        rig.tap()

    assert rig.tally == TapTally(accepted=2, touched=touched)


def test_a_tap_starts_where_the_rig_was_told_to_stand(rig_bench):
    """An interrupted move leaves the stage on its way; the next tap is made where the one before was."""
    with rig_bench.rig() as rig:
        stood = rig.place_mm
        rig_bench.diary.when("status", interrupt(KeyboardInterrupt()), lambda status: status[1] == "Jog")
        with pytest.raises(KeyboardInterrupt):
            rig.go(15.5)
        assert stood < rig_bench.place_mm[0] < 15.5

        rig.tap()
        assert rig_bench.place_mm[0] == pytest.approx(stood, abs=0.01)


def test_a_reading_that_no_finger_can_have_is_not_believed(rig_bench):
    """As after a flipped bit, which no checksum tells."""
    read, jumps = rig_bench.emulation.finger.read, []
    rig_bench.once_deep(lambda: jumps.append(60.0))
    rig_bench.emulation.finger.read = lambda time_s: read(time_s) + (jumps.pop() if jumps else 0.0) * np.eye(12)[5]
    with rig_bench.rig() as rig:
        assert rig_bench.deviation(rig.tap()) < 1e-9
    (first, reason), *_ = rig_bench.diary.all("tap")

    assert not first
    assert reason.startswith("taxel 5 jumped by")


def test_who_guards_the_rig_as_well_does_not_keep_the_finger_on_the_object(rig_bench):
    with rig_bench.rig() as rig, rig.loop.guarded(rig.skin.monitor.check):
        rig_bench.once_deep(lambda: rig_bench.on("silent_sensor"))
        with pytest.raises(StaleSensor, match="no reading for"):
            rig.tap()
        assert rig_bench.is_clear
        rig_bench.off()


def test_taps_that_cannot_be_believed_are_made_again_a_few_times(rig_bench):
    settings = changed(rig_bench.settings, retries=2)
    with rig_bench.rig(settings=settings) as rig:
        rig_bench.on("lost_frames", rate=0.2)
        with pytest.raises(SensorFault, match=r"no plausible tap in 3 attempts: .*lost"):
            rig.tap()
        assert rig_bench.is_clear

    assert rig.tally.rejected == 3
    assert rig.tally.accepted == 0
    assert len(jogs(rig_bench)) >= 6


@pytest.mark.parametrize("speed_mm_s", [0.5, 1.0, 2.0, 3.0])
def test_a_press_longer_than_its_readings_is_no_tap(rig_bench, speed_mm_s):
    """Otherwise the slowest would be taken for taps of nothing."""
    settings = changed(rig_bench.settings, speed_mm_s=speed_mm_s, retries=0)
    with rig_bench.rig(settings=settings) as rig:
        with pytest.raises(SensorFault, match="the finger was still moving when the readings of the tap ended"):
            rig.tap()
        assert rig_bench.is_clear


def test_before_connect_and_after_close_nothing_moves(rig_bench):
    rig = rig_bench.build()
    for _ in range(2):
        for call in (rig.tap, lambda: rig.go(3.0), lambda: rig.move(1)):
            with pytest.raises(PositionUnknown, match="the rig is not connected"):
                call()
        with connected(rig):
            pass
        rig.close()


def test_closing_twice_is_closing_once(rig_bench):
    with rig_bench.rig() as rig:
        rig.close()
        rig.close()

    assert rig_bench.is_clear
    assert rig_bench.open_ports == []


def test_a_rig_is_closed_even_if_its_stage_does_not_obey(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.on("unplug", times=1, port="stage")
        with pytest.raises(PortLost, match="unplugged"):
            rig.close()

    assert rig_bench.open_ports == []


@pytest.mark.parametrize(
    ("trouble", "start"),
    [
        (StageFault("It stopped."), "It stopped. The"),
        (ZeroDivisionError("division by zero"), "division by zero. The"),
        (ValueError(), "ValueError. The"),
        (KeyboardInterrupt(), "Interrupted. The"),
        (SystemExit(143), "Interrupted. The"),
    ],
)
def test_an_operator_who_must_take_the_finger_off_reads_sentences(trouble, start):
    worse = StageFault("It does not stop.")

    assert str(still_pressing(trouble, worse)).startswith(start)
    assert str(still_pressing(trouble, worse)).endswith("by hand. It does not stop.")
    assert str(still_pressing(worse, worse)).endswith("by hand.")
