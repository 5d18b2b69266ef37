"""Faults of the fingertip and how the whole rig handles them; numbers are rows of docs/reference/faults.md."""

import re

import msgspec
import numpy as np
import pytest
from solidtouch.hardware.errors import (
    BaselineRefused,
    NoAnswer,
    SensorFault,
    SensorOverload,
    StaleSensor,
    WrongDevice,
)
from solidtouch.hardware.rig.open_rig import connected


def with_acks(settings, acks):
    return msgspec.structs.replace(settings, sensor=msgspec.structs.replace(settings.sensor, acks=acks))


def assert_made_again(bench, rig, reason):
    """The tap with the fault is not believed, and the one after it is what the finger felt."""
    assert bench.deviation(rig.tap()) < 1e-9
    (first, why), second = bench.diary.all("tap")
    assert not first
    assert re.search(reason, why)
    assert second == (True, "")


def tap_until_trouble(rig, most=10):
    for _ in range(most):
        rig.tap()


@pytest.mark.parametrize("acks", ["auto", "none"])
def test_fault_22_no_acks(rig_bench, acks):
    rig_bench.on("no_acks")
    with rig_bench.rig(settings=with_acks(rig_bench.settings, acks)) as rig:
        assert rig_bench.deviation(rig.tap()) < 1e-9


@pytest.mark.parametrize(
    ("fault", "error", "sentence"),
    [
        ("no_acks", NoAnswer, r"did not answer the command 'no time stamps \(Z0\)'"),
        ("bell", WrongDevice, r"the adapter refused the command"),
    ],
)
def test_fault_22_acks_that_are_counted_on(rig_bench, fault, error, sentence):
    rig_bench.on(fault)
    with pytest.raises(error, match=sentence), rig_bench.rig(settings=with_acks(rig_bench.settings, "strict")):
        pass
    assert rig_bench.open_ports == []


def test_fault_23_left_open(rig_bench):
    rig_bench.on("left_open", times=1)
    with rig_bench.rig() as rig:
        assert rig_bench.struck("left_open") == 1
        assert rig_bench.deviation(rig.tap()) < 1e-9
        assert rig.skin.counts.refused == 0


@pytest.mark.parametrize("count", [1, 2])
def test_fault_24_lost_frames(rig_bench, count):
    with rig_bench.rig() as rig:
        rig_bench.once_deep(lambda: rig_bench.on("lost_frames", times=1, count=count))
        assert_made_again(rig_bench, rig, rf"^{count} readings? lost$")
        assert rig.skin.counts.lost == count
        assert ("lost", f"{count} reading{'s' * (count > 1)} lost") in rig_bench.diary.all("event")


@pytest.mark.parametrize("after", [0, 1, 39, 40])
def test_fault_24_lost_frames_around_press_and_end(rig_bench, after):
    """Lost is the first reading after the press, the next, the last of the tap, or the one behind it."""
    with rig_bench.rig() as rig:
        left = [after]

        def due(_):
            left[0] -= 1
            return left[0] < 0

        start = lambda: rig_bench.diary.when("frame", lambda: rig_bench.on("lost_frames", times=1), due)  # noqa: E731
        if after:
            rig_bench.diary.when("press", start)
        else:
            rig_bench.diary.when("press", lambda: rig_bench.on("lost_frames", times=1))
        assert rig_bench.deviation(rig.tap()) < 1e-9
        rig.loop.sleep(1.0)
        assert rig_bench.struck("lost_frames") == 1
        assert rig.skin.counts.lost == 1
        if after < 39:
            assert rig.tally.rejected == 1


def test_fault_25_lost_half(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.once_deep(lambda: rig_bench.on("lost_half", times=1))
        assert_made_again(rig_bench, rig, "^1 reading lost$")
        assert rig.skin.counts.unpaired == 1


def test_fault_25_swapped_halves(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.on("swapped_halves", rate=0.5)
        assert rig_bench.deviation(rig.tap()) < 1e-9
        assert rig.tally.rejected == 0
        assert rig.skin.counts.unpaired == 0


@pytest.mark.parametrize("kind", ["icub", "lines"])
def test_fault_26_silence(make_bench, kind):
    with make_bench(kind=kind) as bench, bench.rig() as rig:
        bench.once_deep(lambda: bench.on("silent_sensor"))
        with pytest.raises(StaleSensor, match=r"no reading for .* ms, expected one every 20 ms"):
            rig.tap()
        assert bench.is_clear
        assert rig.skin.counts.stale == 1
        assert bench.diary.all("tap") == []


def test_fault_26_silence_from_the_beginning(rig_bench):
    rig_bench.on("silent_sensor")
    with pytest.raises(NoAnswer, match="no readings from board 14, triangle 0"), rig_bench.rig():
        pass
    assert rig_bench.open_ports == []
    assert rig_bench.is_clear


def test_fault_27_stuck(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.once_deep(lambda: rig_bench.on("stuck"))
        with pytest.raises(SensorFault, match="the last 26 readings are identical; the sensor is stuck"):
            rig.tap()
        assert rig_bench.is_clear
        assert rig.skin.counts.stuck > 0


def test_fault_28_taxel_error(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.once_deep(lambda: rig_bench.on("taxel_error", times=1, mask=1 << 3))
        with pytest.raises(SensorFault, match="taxel 3 is saturated and reported as broken"):
            rig.tap()
        assert rig_bench.is_clear
        assert rig.skin.counts.invalid == 1


def test_fault_28_all_taxels_are_gone(rig_bench):
    """At rest, so that it is the sensor that fails and not a taxel."""
    with rig_bench.rig() as rig:
        rig_bench.on("taxel_error")
        rig.loop.sleep(0.3)
        with pytest.raises(SensorFault, match=r"all taxels were invalid in the last \d+ readings"):
            rig.tap()
        assert rig_bench.is_clear


def test_fault_28_overload(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.places.clear()
        rig_bench.diary.when("press", lambda: rig_bench.on("overload", times=3, mask=4))
        with pytest.raises(SensorOverload, match="taxel 2 saturated and the finger was lifted"):
            rig.tap()
        assert rig_bench.is_clear
    assert max(y for _, y in rig_bench.places) < rig_bench.settings.tap.depth_mm - 0.5


def test_fault_29_recalibration_while_pressed(rig_bench):
    """The tap is not believed, and as the board now reads wrongly at rest, no other one is made."""
    with rig_bench.rig() as rig:
        rig_bench.once_deep(lambda: rig_bench.on("recalibrate", times=1))
        with pytest.raises(BaselineRefused, match=r"calibrat.* free the finger and restart"):
            rig.tap()
        ((accepted, reason),) = rig_bench.diary.all("tap")
        assert not accepted
        assert "taxel" in reason
        assert rig_bench.is_clear


@pytest.fixture
def on_the_object(rig_bench):
    """Settings whose place where nothing should be touched is on the object; the stage stands before its middle."""
    with rig_bench.rig():
        pass
    tap = msgspec.structs.replace(rig_bench.settings.tap, clear_mm=2.2)
    return msgspec.structs.replace(rig_bench.settings, tap=tap)


def test_fault_29_start_while_something_touches(rig_bench, on_the_object):
    """The board has calibrated under load, which shows when the load is gone."""
    lift = lambda: rig_bench.emulation.control({"object": None})  # noqa: E731
    lift()
    with connected(rig_bench.build(settings=on_the_object)) as rig:
        rig.go(8.0)
    rig_bench.diary.when("command", lift, lambda command: command[1] == b"t20E20700\r")
    with (
        pytest.raises(BaselineRefused, match=r"calibration under load.* free the finger and restart"),
        rig_bench.rig(settings=on_the_object),
    ):
        pass
    assert rig_bench.open_ports == []


def test_fault_29_something_touches_before_a_tap(rig_bench, on_the_object):
    rig_bench.diary.when("command", lambda: rig_bench.emulation.control({"object": None}))
    with rig_bench.rig(settings=on_the_object) as rig:
        rig_bench.emulation.control({"object": 4})
        rig.loop.sleep(0.5)
        with pytest.raises(BaselineRefused, match="something touches the finger"):
            rig.tap()
        assert rig_bench.diary.all("press") == []


def test_fault_30_drift(make_bench):
    """The baseline goes with it, further than the rest before a tap may differ, and all taps are believed."""
    with make_bench(place_mm=None) as bench, bench.rig() as rig:
        before, start_s = rig.skin.monitor.baseline, bench.clock.now()
        bench.on("drift", counts_per_s=0.2)
        tap_until_trouble(rig, 60)
        drift = 0.2 * (bench.clock.now() - start_s)
        np.testing.assert_allclose(rig.skin.monitor.baseline - before, drift, atol=3.0)

    assert rig.tally.rejected == 0
    assert drift > 2 * rig.settings.sensor.noise_limit


@pytest.mark.slow
def test_fault_30_drift_to_the_end_of_the_range(rig_bench):
    """There a taxel would no longer show a touch, so no tap is made."""
    with rig_bench.rig() as rig:
        rig_bench.on("drift", counts_per_s=-0.3)
        with pytest.raises(BaselineRefused, match="the end of its range"):
            tap_until_trouble(rig, 60)
        assert rig.tally.accepted > 20
        assert rig_bench.is_clear


def test_fault_30_drift_that_is_too_fast(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.on("drift", counts_per_s=60.0)
        with pytest.raises(SensorFault, match=re.escape(rig_bench.settings.sensor.port)):
            tap_until_trouble(rig)
        assert rig_bench.is_clear


def test_fault_31_old_class_and_others_on_the_bus(rig_bench):
    rig_bench.on("old_class")
    rig_bench.on("foreign")
    with rig_bench.rig() as rig:
        assert rig_bench.deviation(rig.tap()) < 1e-9
        assert rig.tally.rejected == 0
        assert rig.skin.counts.foreign > 100
        assert rig.skin.counts.lost == 0


def test_fault_31_another_board(rig_bench):
    sensor = msgspec.structs.replace(rig_bench.settings.sensor, triangle=1)
    rig_bench.on("foreign")
    settings = msgspec.structs.replace(rig_bench.settings, sensor=msgspec.structs.replace(sensor, board=13))
    with (
        pytest.raises((WrongDevice, NoAnswer), match="no readings from board 13, triangle 1"),
        rig_bench.rig(settings=settings),
    ):
        pass
