"""Readings that are lost are found by their absence, and readings that are late are not taken for lost."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.hardware.skin.tracking import LossTracker

PERIOD_S = 0.02


def arrivals(n, gone=(), delays=None, period_s=PERIOD_S):
    """Times at which the readings that are not gone arrive, none before the one sent before it."""
    sent = np.arange(n) * period_s
    came = np.maximum.accumulate(sent + (np.zeros(n) if delays is None else delays))
    return np.delete(came, list(gone))


def tracked(times, **options):
    tracker = LossTracker(PERIOD_S, **options)
    for time_s in times:
        tracker.push(time_s, time_s)
    return tracker


@given(st.sets(st.integers(1, 70)), st.integers(0, 2**32))
def test_every_lost_reading_is_counted_once(gone, seed):
    """Up to a fifth of a period of jitter changes nothing."""
    delays = np.random.default_rng(seed).uniform(0, 0.2 * PERIOD_S, 110)

    tracker = tracked(arrivals(110, gone, delays))

    assert tracker.lost == len(gone)
    assert not tracker.undecided


@given(st.integers(1, 60), st.integers(1, 4))
def test_a_loss_is_placed_to_within_three_readings(first, n):
    gone = range(first, first + n)
    tracker = tracked(arrivals(100, gone))
    before, after = (first - 1) * PERIOD_S, (first + n) * PERIOD_S

    assert tracker.between(before, after) == n
    assert tracker.between(0.0, before) == 0
    assert tracker.between(after + 3 * PERIOD_S, 100 * PERIOD_S) == 0


@given(st.integers(2, 300), st.integers(0, 40))
def test_a_pause_of_the_host_is_no_loss(paused, start):
    """Everything sent in the pause arrives at its end, at once."""
    times = arrivals(start + paused + 60)
    end_s = (start + paused) * PERIOD_S
    times[start : start + paused] = end_s

    assert tracked(times).lost == 0


def test_a_backlog_that_drains_slowly_is_no_loss():
    """100 readings come at twice their rate."""
    times = arrivals(300)
    times[50:150] = 3.0 + PERIOD_S / 2 * np.arange(100)

    assert tracked(np.maximum(times, np.arange(300) * PERIOD_S)).lost == 0


def test_a_loss_in_a_backlog_is_counted():
    times = arrivals(200)
    times[50:100] = times[100]

    assert tracked(np.delete(times, [60, 61, 75])).lost == 3


def test_two_losses_close_together_are_both_found_and_placed():
    tracker = tracked(arrivals(110, (40, 50)))

    assert tracker.lost == 2
    assert tracker.between(39 * PERIOD_S, 49 * PERIOD_S) == 1
    assert tracker.between(45 * PERIOD_S, 55 * PERIOD_S) == 1
    assert tracker.between(55 * PERIOD_S, 110 * PERIOD_S) == 0


@pytest.mark.parametrize("ppm", [-1500, 1500])
def test_a_clock_that_runs_slightly_fast_or_slow_loses_nothing(ppm):
    assert tracked(arrivals(20_000, period_s=PERIOD_S * (1 + 1e-6 * ppm))).lost == 0


def test_it_is_undecided_only_while_the_last_readings_are_late():
    tracker = tracked([0.0, 0.02, 0.055])
    assert tracker.undecided

    tracker.push(0.06, 0.06)
    assert not tracker.undecided


def test_readings_that_come_earlier_than_they_could_were_not_lost():
    """A link that is a period late for long looks like a loss until it is in time again."""
    delays = np.zeros(200)
    delays[50:120] = PERIOD_S
    tracker = tracked(arrivals(200, delays=delays)[:110])
    assert tracker.lost == 1

    assert tracked(arrivals(200, delays=delays)).lost == 0


def test_in_the_sensors_own_clock_a_loss_is_known_at_once():
    tracker = LossTracker(PERIOD_S, patience=0.0, slack=0.25)

    assert [tracker.push(t, t) for t in (0.0, 0.02, 0.04, 0.101, 0.12)] == [0, 0, 0, 2, 0]


def test_a_jump_of_the_sensors_clock_counts_as_one_loss():
    tracker = LossTracker(PERIOD_S, patience=0.0, slack=0.25)
    for clock_s, time_s in ((5.00, 0.0), (5.02, 0.02)):
        tracker.push(clock_s, time_s)

    tracker.restart(0.04)
    tracker.push(0.0, 0.04)

    assert tracker.lost == 1
    assert tracker.between(0.02, 0.04) == 1
    assert tracker.between(0.04, 0.06) == 0


def test_under_heavy_delays_no_tap_with_a_loss_passes_and_few_others_fail():
    """Delays of up to a period, in random order; taps of 50 readings, one after the other."""
    rng = np.random.default_rng(3)
    n, gone = 10_000, np.sort(rng.choice(np.arange(100, 9900), 40, replace=False))
    times = arrivals(n, gone, rng.uniform(0, PERIOD_S, n))
    numbers = np.delete(np.arange(n), gone)
    tracker = tracked(times)

    taps = [slice(i, i + 50) for i in range(0, len(times) - 50, 50)]
    broken = [numbers[tap][-1] - numbers[tap][0] > 49 for tap in taps]
    refused = [tracker.between(times[tap][0], times[tap][-1]) > 0 for tap in taps]

    assert all(r for r, b in zip(refused, broken, strict=True) if b)
    assert sum(r for r, b in zip(refused, broken, strict=True) if not b) < 0.1 * len(taps)
