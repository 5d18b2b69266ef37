"""Readings that cannot be trusted are told from those that can, whatever sends them."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.hardware.errors import BaselineRefused, SensorFault, SensorOverload, StaleSensor
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.skin.monitor import SkinMonitor
from solidtouch.hardware.skin.skin import SkinFrame, SkinLimits, taxel_names
from solidtouch.hardware.skin.tracking import Baseline

LIMITS = SkinLimits("skin", 3, 50.0, 225.0, 255.0, 254.5, noise_limit=4.0, overload=253.0, stuck_readings=25)


def reading(time_s, raw=(240, 241, 239), valid=(True, True, True)):
    raw = np.array(raw, float)
    return SkinFrame(time_s, raw, 255 - raw, np.array(valid))


def noisy(n, rng, start_s=0.0, level=240.0):
    raw = level + np.rint(rng.normal(size=(n, 3)))
    return [reading(start_s + 0.02 * i, row) for i, row in enumerate(raw)]


@pytest.fixture
def monitor(loop):
    return SkinMonitor(LIMITS, loop, NoJournal())


def shown(monitor, frames):
    for frame in frames:
        monitor.take(frame, frame.time_s)
    return frames


class Feed:
    """A clock that shows a monitor one reading after the other."""

    def __init__(self, loop, monitor, frames):
        self.frames = list(frames)
        self.time_s = self.frames[0].time_s if self.frames else 0.0
        self.monitor = monitor
        loop.clock = self

    def now(self):
        return self.time_s

    def wait(self, _, until):
        if self.frames and self.frames[0].time_s <= until:
            frame = self.frames.pop(0)
            self.time_s = max(self.time_s, frame.time_s)
            self.monitor.take(frame, frame.time_s)
        else:
            self.time_s = until


def test_good_readings_get_no_reproach(monitor, rng):
    frames = shown(monitor, noisy(60, rng))
    monitor.check(frames[-1].time_s + 0.069)

    assert monitor.verdict(frames) is None
    assert (monitor.counts.frames, monitor.counts.lost, monitor.counts.invalid, monitor.counts.stuck) == (60, 0, 0, 0)


def test_no_readings_get_no_reproach(monitor):
    assert monitor.verdict([]) is None


def test_a_lost_reading_is_named(monitor, rng):
    frames = noisy(60, rng)
    del frames[20]

    assert monitor.verdict(shown(monitor, frames)) == "1 reading lost"
    assert monitor.counts.lost == 1


def test_a_verdict_waits_until_late_readings_are_explained(monitor, loop, rng):
    """The last reading comes 30 ms late; the one after it, in time."""
    frames = noisy(60, rng)
    late = shown(monitor, [*frames[:49], replace(frames[49], time_s=frames[49].time_s + 0.019)])
    Feed(loop, monitor, frames[50:])

    assert monitor.verdict(late) is None
    assert monitor.counts.frames == 51


def test_a_loss_just_before_the_last_reading_is_found(monitor, loop, rng):
    frames = noisy(100, rng)
    del frames[48]
    shown(monitor, frames[:50])
    Feed(loop, monitor, frames[50:])

    assert monitor.verdict(frames[:50]) == "1 reading lost"


def test_readings_that_no_others_follow_stay_doubtful(monitor, loop, rng):
    frames = noisy(50, rng)
    del frames[48]
    shown(monitor, frames)
    Feed(loop, monitor, [])

    assert monitor.verdict(frames) == "readings late or lost"
    assert loop.now == pytest.approx(1.0)


def test_invalid_taxels_are_named(monitor, rng):
    frames = noisy(50, rng)
    frames[3] = replace(frames[3], valid=np.array([True, False, False]))

    assert monitor.verdict(shown(monitor, frames)) == "taxels 1, 2 invalid in 1 of 50 readings"
    assert monitor.counts.invalid == 1


def test_values_that_stand_still_are_stuck(monitor, rng):
    frames = shown(monitor, [*noisy(10, rng), *(reading(0.2 + 0.02 * i) for i in range(27))])

    assert monitor.verdict(frames) == "stuck for 27 readings"
    with pytest.raises(SensorFault, match="skin: the last 27 readings are identical"):
        monitor.check(frames[-1].time_s)
    assert monitor.counts.stuck == 2


def test_each_reading_sent_twice_is_not_stuck(monitor, rng):
    frames = [frame for frame in noisy(30, rng) for _ in range(2)]
    frames = [replace(frame, time_s=0.02 * i) for i, frame in enumerate(frames)]

    assert monitor.verdict(shown(monitor, frames)) is None


def test_a_sensor_may_be_allowed_to_stand_still(loop):
    monitor = SkinMonitor(replace(LIMITS, stuck_readings=0), loop, NoJournal())
    frames = shown(monitor, [reading(0.02 * i) for i in range(200)])
    monitor.check(frames[-1].time_s)

    assert monitor.verdict(frames) is None


def test_silence_is_stale_once(monitor, rng):
    monitor.check(5.0)
    frames = shown(monitor, noisy(10, rng))
    for _ in range(2):
        monitor.check(frames[-1].time_s + 0.15)  # a busy computer; late, and counted
        with pytest.raises(StaleSensor, match="skin: no reading for 170 ms, expected one every 20 ms"):
            monitor.check(frames[-1].time_s + 0.17)

    assert monitor.counts.stale == 1


@pytest.mark.parametrize(
    ("limits", "gap_s", "stale_s"),
    [
        ({}, 0.02, 0.16),
        ({}, 0.07, 0.21),
        ({}, 0.15, 0.3),
        ({"rate_hz": 1000.0}, 0.001, 0.16),
        ({"rate_hz": 5.0}, 0.2, 0.7),
        ({"stale_s": 0.05}, 0.15, 0.05),
    ],
)
def test_the_silence_that_is_stale_follows_from_rate_and_gaps(loop, rng, monkeypatch, limits, gap_s, stale_s):
    """Three times the longest gap of the baseline, within bounds, or what the settings say."""
    monitor = SkinMonitor(replace(LIMITS, **limits), loop, NoJournal())
    times = np.cumsum([0.0, 0.02, gap_s, 0.02])
    monkeypatch.setattr(monitor, "_collect", lambda _: shown(monitor, [reading(t + 10.0) for t in times]))
    monkeypatch.setattr(monitor.rest, "settle", lambda _: None)
    monitor.begin()
    monitor.measure_baseline()

    assert monitor.stale_s == pytest.approx(stale_s)


def test_a_finger_that_touches_something_for_three_readings_is_not_free(monitor, rng):
    """One reading may be damaged; below five noise limits it is noise, and without a baseline nothing is known."""
    limit = 5 * LIMITS.noise_limit
    shown(monitor, [reading(0.02 * i, 250.0) for i in range(5)])
    monitor.check_free(0.1)
    frames = noisy(50, rng)
    monitor.rest.settle(frames)
    rest = frames[0].values
    for above, times, free in ((limit + 5, 2, True), (limit + 5, 3, False), (limit - 5, 9, True)):
        monitor.begin()
        for i in range(times):
            frame = reading(1.0 + 0.02 * i)
            monitor.take(replace(frame, values=rest + above), frame.time_s)
        if free:
            monitor.check_free(2.0)
        else:
            with pytest.raises(SensorOverload, match="touched something on its way"):
                monitor.check_free(2.0)


def test_three_blind_readings_are_a_fault_and_two_are_not(monitor, rng):
    blind = [replace(frame, valid=np.zeros(3, bool)) for frame in noisy(3, rng)]
    shown(monitor, blind[:2])
    monitor.check(0.03)
    shown(monitor, blind[2:])

    with pytest.raises(SensorFault, match="all taxels were invalid in the last 3 readings"):
        monitor.check(0.05)


def test_overload_is_seen_on_taxels_said_to_be_invalid_too(monitor):
    frame = reading(0.0, (240, 2, 240), (True, False, True))

    assert monitor.overloaded(frame)
    assert not monitor.overloaded(reading(0.0, (240, 3, 240)))
    shown(monitor, [frame])
    assert monitor.counts.saturated == 1


def test_the_baseline_is_the_mean_of_readings_at_rest(monitor, loop, rng):
    frames = noisy(50, rng)
    Feed(loop, monitor, frames)
    monitor.measure_baseline()

    assert monitor.rest.values == pytest.approx(np.mean([frame.values for frame in frames], axis=0))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda raw: raw - [0, 30, 0], BaselineRefused, "taxel 1 not at rest.*taxel 1 reads 2.*225 to 255"),
        (lambda raw: raw * 0 + 255, BaselineRefused, "taxels 0, 1, 2 not at rest.*reads 255.0, the end of its range"),
        (lambda raw: raw + 12 * np.sin(np.arange(50)[:, None]), BaselineRefused, ".* varies by .*at most 4"),
    ],
)
def test_a_touched_sensor_has_no_baseline(loop, rng, change, error, message):
    monitor = SkinMonitor(replace(LIMITS, stuck_readings=0), loop, NoJournal())
    raw = change(np.array([frame.raw for frame in noisy(50, rng)]))
    Feed(loop, monitor, [reading(0.02 * i, row) for i, row in enumerate(raw)])

    with pytest.raises(error, match=f"skin: {message}"):
        monitor.measure_baseline()
    assert not monitor.rest.is_known


def test_a_baseline_needs_valid_readings(monitor, loop, rng):
    Feed(loop, monitor, [replace(frame, valid=np.array([True, True, False])) for frame in noisy(50, rng)])

    with pytest.raises(BaselineRefused, match="taxel 2 invalid in 50 of 50 readings"):
        monitor.measure_baseline()


@pytest.mark.parametrize(
    ("rate_hz", "message"), [(45.0, "45.0 readings .* instead of 50"), (27.8, "27.8"), (60, "60.0")]
)
def test_another_rate_than_that_set_is_refused(monitor, loop, rng, rate_hz, message):
    Feed(loop, monitor, [replace(frame, time_s=i / rate_hz) for i, frame in enumerate(noisy(50, rng))])

    with pytest.raises(SensorFault, match=f"skin: {message}"):
        monitor.measure_baseline()


def test_no_readings_give_no_baseline(monitor, loop):
    Feed(loop, monitor, [])

    with pytest.raises(StaleSensor, match=r"0 readings in 2\.5 s instead of 50"):
        monitor.measure_baseline()


def test_a_steady_rate_a_little_off_is_taken_over(monitor, loop, rng):
    """3% slow, which counted as 50 Hz would be a loss every 33 readings."""
    frames = [replace(frame, time_s=i / 48.5) for i, frame in enumerate(noisy(600, rng))]
    Feed(loop, monitor, frames)
    monitor.measure_baseline()
    before = monitor.counts.lost
    loop.sleep(20.0)

    assert monitor.counts.frames == 600
    assert monitor.counts.lost == before


def test_the_baseline_follows_drift_and_no_faster(rng):
    rest = Baseline(LIMITS)
    rest.settle(noisy(50, rng))
    for i, frame in enumerate(noisy(3000, rng)):
        rest.follow(replace(frame, values=frame.values + 0.2 * 0.02 * i))
    assert rest.values == pytest.approx(15.0 + 12.0, abs=1.0)

    before = rest.values
    for frame in noisy(50, rng):
        rest.follow(replace(frame, values=before + 6.0))
    assert rest.values - before == pytest.approx(0.5)


def test_a_touch_is_no_drift(rng):
    rest = Baseline(LIMITS)
    rest.settle(noisy(50, rng))
    before = rest.values
    for frame in noisy(50, rng):
        rest.follow(replace(frame, values=frame.values + 20.0 * (np.arange(3) == 0)))

    assert np.array_equal(before, rest.values)


def test_a_shift_at_rest_is_refused_before_a_press(rng):
    rest = Baseline(LIMITS)
    rest.check(noisy(10, rng, level=200.0))
    rest.settle(noisy(50, rng))
    rest.check(noisy(10, rng, level=235.0))
    rest.check([])

    with pytest.raises(BaselineRefused, match=r"skin: taxels 0, 1, 2 up to 1[234]\.. away from the baseline at rest"):
        rest.check(noisy(10, rng, level=253.0))


def test_invalid_taxels_are_not_at_rest(rng):
    rest = Baseline(LIMITS)
    rest.settle(noisy(50, rng))
    frames = [replace(frame, valid=np.array([False, True, True])) for frame in noisy(10, rng)]
    rest.check([*frames[:5], *noisy(5, rng)])

    with pytest.raises(BaselineRefused, match="skin: taxel 0 invalid in 10 of 10 readings without contact"):
        rest.check(frames)


def test_where_nothing_is_known_of_rest_nothing_is_refused(rng):
    rest = Baseline(SkinLimits("skin", 3, 50.0))
    rest.settle(noisy(50, rng))
    before = rest.values
    rest.follow(reading(0.0))
    rest.check(noisy(10, rng, level=0.0))

    assert np.array_equal(before, rest.values)


def test_taxels_are_named():
    assert taxel_names(np.array([False, True, False])) == "taxel 1"
    assert taxel_names(np.array([True, True, False])) == "taxels 0, 1"
