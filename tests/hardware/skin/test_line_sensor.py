"""The driver of a sensor that sends lines: its start, its clock, and what it refuses."""

import math

import numpy as np
import pytest
from skin_start import start
from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.finger import Finger
from solidtouch.hardware.emulator.line_array import LineArray
from solidtouch.hardware.errors import BaselineRefused, NoAnswer, PortBusy, SensorFault, StaleSensor, WrongDevice
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.rig.settings import LineSettings
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.hardware.skin.fingertip import make_skin
from solidtouch.hardware.skin.line_sensor import LineSensor

PERIOD_MS = 20
SETTINGS = LineSettings(
    port="skin", taxels=3, rate_hz=50.0, idle_low=90.0, idle_high=110.0, noise_limit=4.0, overload=1000.0
)


class Lines:
    """Reboots for a second, prints a comment, then a line every 20 ms; `line` makes it from its number."""

    def __init__(self, line=None, boot_s=1.0):
        rng = np.random.default_rng(1)
        values = 100 + np.rint(rng.normal(size=(4096, 3))).astype(int)
        self.values = values
        self.line = line or self.usual
        self.boot_s = boot_s
        self.start_s = math.inf
        self.n = 0
        self.gone = set()

    def usual(self, n):
        return f"{PERIOD_MS * n},{','.join(map(str, self.values[n % 4096]))}\r\n".encode()

    def opened(self, time_s):
        self.start_s = time_s + self.boot_s
        self.n = 0

    def closed(self, _):
        self.start_s = math.inf

    def receive(self, data, time_s):
        pass

    def next_event_s(self):
        return self.start_s + 0.001 * PERIOD_MS * self.n

    def step(self, time_s):
        data = b""
        while self.next_event_s() <= time_s:
            data += b"# three taxels\r\n" if self.n == 0 else b""
            data += b"" if self.n in self.gone else self.line(self.n)
            self.n += 1
        return data


@pytest.fixture
def make(loop, wired):
    def sensor(device, **changes):
        settings = LineSettings(**{field: getattr(SETTINGS, field) for field in SETTINGS.__struct_fields__} | changes)
        return LineSensor(settings, loop, NoJournal(), wired(device, address="skin"))

    return sensor


def readings(sensor, loop, n):
    frames = []
    sensor.on_frame = frames.append
    loop.wait_for(lambda: len(frames) >= n, 10.0, "too few")
    return frames


def test_it_starts_and_reads(make, loop):
    device = Lines()
    sensor = make(device)
    start(sensor)
    frames = readings(sensor, loop, 50)
    sensor.monitor.check(loop.now)

    assert sensor.monitor.baseline == pytest.approx([100.0] * 3, abs=0.6)
    assert np.diff([frame.device_ms for frame in frames]) == pytest.approx(PERIOD_MS)
    assert np.array_equal(frames[-1].raw, device.values[device.n - 1])
    assert sensor.monitor.verdict(frames) is None
    assert (sensor.counts.lost, sensor.counts.dropped, sensor.counts.stuck) == (0, 0, 0)
    assert (sensor.taxels, sensor.rate_hz) == (3, 50.0)

    sensor.stop()
    assert not sensor.port.is_open
    sensor.monitor.check(loop.now + 10.0)


def test_values_can_fall_under_load_and_be_taken_in_another_order(make, loop):
    device = Lines()
    sensor = make(device, rising=False, overload=50.0, order=[2, 0])
    start(sensor)
    frame = readings(sensor, loop, 1)[0]

    assert np.array_equal(frame.raw, device.values[device.n - 1][[2, 0]])
    assert np.array_equal(frame.values, -frame.raw)
    assert not sensor.monitor.overloaded(frame)
    device.line = lambda n: b"%d,100,100,50\n" % (PERIOD_MS * n)
    assert sensor.monitor.overloaded(readings(sensor, loop, 1)[0])


def test_a_lost_reading_is_known_at_once(make, loop):
    device = Lines()
    sensor = make(device)
    start(sensor)
    device.gone = {device.n + 20, device.n + 21}
    frames = readings(sensor, loop, 50)

    assert sensor.counts.lost == 2
    assert sensor.monitor.verdict(frames) == "2 readings lost"
    assert sensor.monitor.verdict(frames[25:]) is None


def test_the_counter_of_the_sensor_may_start_again(make, loop):
    device = Lines(lambda n: b"%d,%d,100,100\n" % ((2**32 - 1500 + PERIOD_MS * n) % 2**32, 99 + n % 3))
    sensor = make(device)
    start(sensor)
    frames = readings(sensor, loop, 50)

    assert np.diff([frame.device_ms for frame in frames]) == pytest.approx(PERIOD_MS)
    assert sensor.counts.lost == 0


@pytest.mark.parametrize("wrong_ms", [4_000_000, 0])
def test_a_time_that_makes_no_sense_spoils_its_tap_only(make, loop, wrong_ms):
    device = Lines()
    sensor = make(device)
    start(sensor)
    at = device.n + 10
    device.line = lambda n: b"%d,100,101,99\n" % wrong_ms if n == at else device.usual(n)
    bad, good = readings(sensor, loop, 50), readings(sensor, loop, 50)

    assert sensor.monitor.verdict(bad[:50]) == "2 readings lost"
    assert sensor.monitor.verdict(good) is None


def test_lines_read_late_are_no_loss(make, loop, clock):
    device = Lines()
    sensor = make(device)
    start(sensor)
    clock.time_s += 2.0
    sensor.port.step()

    assert sensor.monitor.verdict(readings(sensor, loop, 100)) is None
    assert sensor.counts.lost == 0


def test_silence_is_stale(make, loop):
    device = Lines()
    sensor = make(device)
    start(sensor)
    device.line = lambda _: b""

    with loop.guarded(sensor.monitor.check), pytest.raises(StaleSensor, match="skin: no reading for"):
        loop.sleep(1.0)


def test_a_sensor_that_stands_still_is_stuck_only_if_it_may_not(make, loop):
    for stuck, expected in ((0, None), (25, "stuck for 50 readings")):
        device = Lines()
        sensor = make(device, stuck_readings=stuck)
        start(sensor)
        device.line = lambda n: b"%d,100,100,100\n" % (PERIOD_MS * n)

        assert sensor.monitor.verdict(readings(sensor, loop, 50)) == expected
        sensor.stop()


@pytest.mark.parametrize(
    ("line", "error", "message"),
    [
        (lambda _: b"", NoAnswer, "skin: received no line of a time and 3 values within 5.1 s"),
        (lambda n: b"%d,1,2,3,4\n" % n, WrongDevice, "skin: received lines of 4 values, expected sensor.taxels = 3"),
        (lambda _: b"\x00\xff\xfe\x10garbage", WrongDevice, "skin: received no lines .* sensor.baud is wrong"),
        (lambda _: b"<Idle|MPos:0,0,0>\r\n", WrongDevice, "skin: received no lines"),
        (lambda n: b"%d,50,100,%d\n" % (20 * n, n % 3), BaselineRefused, "skin: taxels 0, 2 not at rest"),
        (lambda n: b"%d,100,100,%d\n" % (36 * n, 99 + n % 3), SensorFault, "skin: 27.8 readings per second"),
    ],
)
def test_it_refuses_to_start_and_lets_go_of_the_port(make, loop, line, error, message):
    sensor = make(Lines(line))
    with pytest.raises(error, match=message):
        start(sensor)

    assert not sensor.port.is_open
    loop.turn(loop.now)


def test_a_busy_port_is_tried_for_a_while(make, loop, monkeypatch):
    sensor = make(Lines())
    open_now, tries = sensor.port.open, []

    def busy_at_first():
        tries.append(loop.now)
        if len(tries) < 5:
            raise PortBusy("skin: busy.")
        open_now()

    monkeypatch.setattr(sensor.port, "open", busy_at_first)
    start(sensor)

    assert len(tries) == 5


def test_a_port_that_stays_busy_is_told(make, monkeypatch):
    sensor = make(Lines())

    def busy():
        raise PortBusy("skin: busy.")

    monkeypatch.setattr(sensor.port, "open", busy)
    with pytest.raises(PortBusy, match="skin: busy"):
        start(sensor)


def test_settings_choose_the_driver(loop):
    skin = make_skin(SETTINGS, loop, NoJournal())

    assert isinstance(skin, LineSensor)
    assert skin.taxels == 3


@pytest.mark.parametrize(
    ("fault", "options", "verdict"),
    [
        ("lost_frames", {"times": 1, "count": 3}, "3 readings lost"),
        ("drift", {"counts_per_s": 0.2}, None),
        ("stuck", {}, "stuck for"),
    ],
)
def test_an_emulated_array_with_faults(loop, wired, fault, options, verdict):
    faults = Switches(seed=2)
    finger = Finger(PRESETS["paper"], lambda _: (8.0, 0.0), seed=0, session=0, what=1)
    settings = LineSettings(port="skin", taxels=12, rate_hz=50.0, noise_limit=4.0, stuck_readings=25)
    sensor = LineSensor(settings, loop, NoJournal(), wired(LineArray(faults, finger, 50.0), address="skin"))
    start(sensor)
    assert sensor.monitor.verdict(readings(sensor, loop, 50)) is None
    assert sensor.remarks == ["solidtouch-lines K=12 rate_hz=50"]

    frames = readings(sensor, loop, 10)
    faults.on(fault, **options)
    loop.wait_for(lambda: len(frames) >= 60, 10.0, "too few")

    assert (sensor.monitor.verdict(frames) or "None").startswith(str(verdict))
    assert sensor.counts.dropped == 0
