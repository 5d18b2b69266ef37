"""The fingertip's driver on an emulated adapter and board, with every fault of sensor and port.

Each fault either changes no reading that is believed, or is counted and named, or stops with the error that it should.
"""

import math
import re

import numpy as np
import pytest
from skin_start import start
from solidtouch.hardware.emulator.adapter import Adapter
from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.finger import Finger
from solidtouch.hardware.emulator.skin_board import SkinBoard
from solidtouch.hardware.emulator.wire import Wire
from solidtouch.hardware.errors import (
    BaselineRefused,
    NoAnswer,
    PortBusy,
    PortLost,
    SensorFault,
    StaleSensor,
    WrongDevice,
)
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.rig.settings import IcubSettings
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.hardware.skin.fingertip import Fingertip

AWAY_MM, PRESSED_MM = 0.0, 2.6


class Behind:
    """An adapter behind a wire that has faults."""

    def __init__(self, adapter, wire):
        self.adapter = adapter
        self.wire = wire

    def opened(self, time_s):
        self.adapter.opened(time_s)

    def closed(self, time_s):
        self.adapter.closed(time_s)
        self.wire.clear()

    def receive(self, data, time_s):
        self.adapter.receive(data, time_s)

    def next_event_s(self):
        return min(self.adapter.next_event_s(), self.wire.next_event_s())

    def step(self, time_s):
        if time_s >= self.adapter.next_event_s():
            self.wire.send(self.adapter.step(time_s), time_s)
        return self.wire.arrived(time_s)


class Heard(NoJournal):
    def __init__(self):
        self.events = []

    def event(self, _, kind, text, **__):
        self.events.append((kind, text))


class Bench:
    """A fingertip that is held at `y_mm`, its driver, and the readings that the driver hands out."""

    def __init__(self, loop, wired):
        self.loop = loop
        self.y_mm = AWAY_MM
        self.faults = Switches(seed=4)
        self.journal = Heard()
        self.wired = wired
        self.frames = []

    def tip(self, **settings):
        finger = Finger(PRESETS["paper"], lambda _: (8.0, self.y_mm), seed=0, session=0, what=1)
        adapter = Adapter(self.faults, SkinBoard(self.faults, finger, triangle=settings.get("triangle", 0)))
        port = self.wired(Behind(adapter, Wire("sensor", self.faults)), address="skin")
        self.skin = Fingertip(IcubSettings(port="skin", **settings), self.loop, self.journal, port)
        self.skin.on_frame = self.frames.append
        return self.skin

    def started(self, **settings):
        start(self.tip(**settings))
        return self.skin

    def readings(self, n=50):
        del self.frames[:]
        with self.loop.guarded(self.skin.monitor.check):
            self.loop.wait_for(lambda: len(self.frames) >= n, 10.0, "too few readings")
        return self.frames[:n]


@pytest.fixture
def bench(loop, wired):
    return Bench(loop, wired)


@pytest.mark.parametrize("acks", ["auto", "none", "strict"])
def test_without_faults_nothing_is_wrong(bench, acks):
    skin = bench.started(acks=acks)
    before = skin.counts.frames
    frames = bench.readings()

    assert skin.monitor.verdict(frames) is None
    assert before == 51
    assert np.diff([frame.time_s for frame in frames]) == pytest.approx(0.02)
    assert skin.monitor.baseline == pytest.approx([15.0] * 12, abs=6.0)
    counts = skin.counts
    assert (counts.lost, counts.unpaired, counts.foreign, counts.dropped, counts.refused) == (0, 0, 0, 0, 0)
    assert (counts.stale, counts.stuck, counts.saturated, counts.invalid) == (0, 0, 0, 0)


def test_a_touch_raises_values_and_lowers_what_is_sent(bench):
    skin = bench.started()
    bench.y_mm = PRESSED_MM
    frame = bench.readings()[-1]

    assert (frame.values - skin.monitor.baseline).max() > 30.0
    assert np.array_equal(frame.raw, 255 - frame.values)


def test_taxels_come_in_the_order_of_the_settings(bench):
    order = [11, 3, 0, 7]
    skin = bench.started(order=order)
    bench.y_mm = PRESSED_MM
    few = bench.readings()[-1].raw
    again = Bench(bench.loop, bench.wired)
    again.started()
    again.y_mm = PRESSED_MM

    assert skin.taxels == 4
    assert few == pytest.approx(again.readings()[-1].raw[order], abs=6.0)


def test_stopped_it_is_silent_and_can_start_again(bench, loop):
    skin = bench.started()
    skin.stop()
    skin.stop()
    n = len(bench.frames)
    loop.sleep(1.0)
    assert len(bench.frames) == n
    assert not skin.port.is_open

    start(skin)
    assert skin.monitor.verdict(bench.readings()) is None


# Faults that change nothing that is believed


@pytest.mark.parametrize(
    ("fault", "options"),
    [
        ("split", {"size": 1, "delay_s": 0.0001}),
        ("split", {"rate": 0.2}),
        ("late", {"rate": 0.2, "delay_s": 0.04}),
        ("no_acks", {}),
        ("left_open", {}),
        ("swapped_halves", {"rate": 0.5}),
        ("old_class", {}),
        ("foreign", {}),
    ],
)
def test_harmless_faults_lose_nothing(bench, fault, options):
    bench.faults.on(fault, **options)
    skin = bench.started()

    assert [skin.monitor.verdict(bench.readings()) for _ in range(4)] == [None] * 4
    assert (skin.counts.lost, skin.counts.unpaired, skin.counts.dropped) == (0, 0, 0)
    assert (skin.counts.foreign > 0) == (fault == "foreign")


def test_a_period_of_209_ms_works(bench):
    skin = bench.started(period_ms=209)

    assert skin.monitor.verdict(bench.readings(12)) is None


def test_an_adapter_without_acks_is_no_strict_one(bench):
    bench.faults.on("no_acks")
    with pytest.raises(NoAnswer, match=r'skin: the adapter did not answer .*Z0.*acks = "none"'):
        bench.started(acks="strict")


# Faults that are counted and named


@pytest.mark.parametrize(
    ("fault", "options", "reason"),
    [
        ("lost_frames", {"count": 1}, "1 reading lost"),
        ("lost_frames", {"count": 2}, "2 readings lost"),
        ("lost_half", {}, "1 reading lost"),
        ("merge", {}, "[12] readings? lost"),
        ("drop_bytes", {}, "1 reading lost"),
    ],
)
def test_a_loss_spoils_its_tap_and_no_other(bench, fault, options, reason):
    skin = bench.started()
    bench.readings(10)
    bench.faults.on(fault, times=1, **options)

    assert re.fullmatch(reason, str(skin.monitor.verdict(bench.readings())))
    assert skin.monitor.verdict(bench.readings()) is None
    assert options.get("count", 1) <= skin.counts.lost <= options.get("count", 2)
    assert any(kind == "lost" for kind, _ in bench.journal.events)


def test_a_loss_at_the_very_end_of_a_tap_is_found(bench):
    """The 49th reading is lost, the 50th comes in its place."""
    skin = bench.started()
    bench.readings(48)
    frames = list(bench.frames)
    bench.faults.on("lost_frames", times=1)
    frames += bench.readings(2)

    assert skin.monitor.verdict(frames) == "1 reading lost"


@pytest.mark.parametrize("fault", ["lost_frames", "lost_half", "merge", "drop_bytes"])
def test_no_tap_with_a_loss_is_believed(bench, fault):
    """A tap whose readings took longer than they should has a gap; a line end lost may cost two readings."""
    skin = bench.started()
    wrong = []
    for _ in range(30):
        bench.faults.on(fault, rate=0.01)
        frames = bench.readings()
        bench.faults.off(fault)
        gap_s = frames[-1].time_s - frames[0].time_s
        if skin.monitor.verdict(frames) is None and gap_s > 0.99:
            wrong.append(gap_s)

    assert wrong == []
    assert bench.faults.tally()[fault] > 5
    assert 0 < skin.counts.lost <= 2 * bench.faults.tally()[fault]


def test_an_error_of_the_board_makes_taxels_invalid(bench):
    skin = bench.started()
    bench.faults.on("taxel_error", times=2, mask=1 << 3)

    assert skin.monitor.verdict(bench.readings()).endswith("invalid in 2 of 50 readings")
    assert skin.counts.invalid == 2


def test_a_flipped_bit_never_raises(bench):
    skin = bench.started()
    bench.faults.on("flip_bits", rate=0.2, count=3)
    for _ in range(5):
        skin.monitor.verdict(bench.readings(20))

    assert skin.counts.dropped > 0


def test_an_overload_is_seen_on_its_first_reading(bench):
    skin = bench.started()
    bench.faults.on("overload", mask=1 << 5)
    frame = bench.readings(1)[0]

    assert skin.monitor.overloaded(frame)
    assert int(np.argmax(frame.values)) == 5
    assert skin.counts.saturated == 1


def test_slow_drift_is_followed(bench):
    """Two minutes at 12 counts a minute: more than the rest may differ from the baseline."""
    skin = bench.started()
    before = skin.monitor.baseline
    bench.faults.on("drift", counts_per_s=0.2)
    for _ in range(60):
        skin.monitor.check_rest(bench.readings(10))
        bench.readings(90)

    assert skin.monitor.baseline - before == pytest.approx([24.0] * 12, abs=3.0)


def test_noise_between_two_programs_on_the_port_is_counted(bench):
    skin = bench.started()
    bench.skin._adapter.receive(b"AT\r\nATE1 E0\r\n\xff\xfe\r", bench.loop.now)

    assert skin.monitor.verdict(bench.readings()) is None


# Faults that stop the rig


@pytest.mark.parametrize(
    ("fault", "error", "sentence"),
    [
        ("silent_sensor", StaleSensor, "skin: no reading for"),
        ("stuck", SensorFault, "skin: the last 26 readings are identical"),
        ("taxel_error", SensorFault, "all taxels were invalid in the last 3 readings"),
    ],
)
def test_silent_frozen_and_invalid_readings_stop_the_rig(bench, fault, error, sentence):
    bench.started()
    bench.faults.on(fault)

    with pytest.raises(error, match=sentence):
        bench.readings()


def test_a_calibration_under_load_is_refused_before_the_next_tap(bench):
    skin = bench.started()
    bench.y_mm = PRESSED_MM
    bench.readings()
    bench.faults.on("recalibrate", times=1)
    bench.readings()
    bench.y_mm = AWAY_MM
    bench.readings()

    with pytest.raises(BaselineRefused, match=r"skin: taxels? .* without contact"):
        skin.monitor.check_rest(bench.readings(10))
    with pytest.raises(BaselineRefused, match=r"skin: taxels? .* without contact"):
        skin.monitor.measure_baseline()


def test_a_baseline_is_not_measured_while_a_finger_is_pressed(bench):
    skin = bench.started()
    bench.y_mm = PRESSED_MM
    bench.readings()

    with pytest.raises(BaselineRefused, match="free the finger and restart"):
        skin.monitor.measure_baseline()


def test_a_finger_that_lifts_off_during_the_baseline_is_refused(bench, loop):
    """The board calibrated at 0.7 s, under load; the baseline is measured from 1.2 s on."""
    bench.y_mm = PRESSED_MM
    skin = bench.tip()

    def lift(now_s):
        bench.y_mm = AWAY_MM if now_s > 1.6 else PRESSED_MM

    with loop.guarded(lift), pytest.raises(BaselineRefused, match="skin: taxel"):
        start(skin)


def test_what_is_not_slcan_is_another_device_or_speed(bench):
    other = r"skin: .* sensor\.baud is wrong"
    silent = r"skin: .* check sensor\.baud"
    for acks, error, message in (
        ("auto", WrongDevice, other),
        ("none", WrongDevice, other),
        ("strict", NoAnswer, silent),
    ):
        bench.faults.on("garbage")
        bench.faults.on("left_open")
        with pytest.raises(error, match=message):
            bench.started(acks=acks)
        assert not bench.skin.port.is_open


@pytest.mark.parametrize("acks", ["auto", "strict"])
def test_a_bell_names_the_command(bench, acks):
    bench.faults.on("bell")
    with pytest.raises(WrongDevice, match="skin: the adapter refused the command"):
        bench.started(acks=acks)

    assert bench.skin.counts.refused > 0
    assert not bench.skin.port.is_open


def test_a_sensor_that_sends_nothing_gives_no_answer(bench):
    bench.faults.on("silent_sensor")
    with pytest.raises(NoAnswer, match=r"skin: no readings from board 14, triangle 0 within 1\.6 s"):
        bench.started()


def test_another_board_is_named(bench):
    bench.faults.on("foreign")
    skin = bench.tip()
    skin._sensor = skin._sensor._replace(triangle=7)
    with pytest.raises(WrongDevice, match="no readings from board 14, triangle 7, but from board 1, triangle 0"):
        start(skin)


@pytest.mark.parametrize("error", [PortLost("skin: unplugged."), PortBusy("skin: busy.")])
def test_a_lost_port_stops_everything_and_stop_does_not_raise(bench, error):
    skin = bench.started()
    skin.port.failure = error
    with pytest.raises(type(error), match="skin"):
        bench.readings()

    skin.stop()


def test_an_interrupted_start_lets_go_of_the_port(bench, monkeypatch):
    skin = bench.tip()

    def interrupted(now_s):
        if now_s > 1.5:
            raise KeyboardInterrupt

    with bench.loop.guarded(interrupted), pytest.raises(KeyboardInterrupt):
        start(skin)

    assert not skin.port.is_open
    assert math.isinf(skin.port.next_event_s()) or b"C\r" in skin.port.log[-12:]
