"""Rates from times of known truth: rounded, jittery, absolute, with lost samples and pauses."""

import numpy as np
import pytest
from solidtouch.models.cutting.sampling_rate import common_rate, pace

NONE = np.zeros(0, dtype=bool)


def begins_of(stretches):
    """Whether each sample begins a stretch."""
    return np.concatenate([np.arange(len(each)) == 0 for each in stretches])


def rate_of(*stretches, known=True):
    """Rate by the times of stretches, which are known to be apart or not."""
    broken = begins_of(stretches)
    found = pace(np.concatenate(stretches), broken if known else np.arange(len(broken)) == 0)
    assert found is not None
    return common_rate([found])[0]


def taps(rate, samples, number, rng, decimals=3, lost=0.0):
    """Times of taps, a second or so apart, without some of their inner samples."""
    for n in range(number):
        keep = rng.random(samples) >= lost
        keep[[0, -1]] = True
        yield np.round(n + rng.random() + np.arange(samples)[keep] / rate, decimals)


@pytest.mark.parametrize("rate", [60, 120, 150, 300, 700, 860, 1000, 1024, 1500])
def test_times_rounded_to_milliseconds(rate, rng):
    """Taps with times of a common clock or from 0, and a stream."""
    assert rate_of(*taps(rate, 50, 100, rng)) == pytest.approx(rate, rel=2e-3)
    assert rate_of(*[np.round(np.arange(50) / rate, 3)] * 40) == pytest.approx(rate, rel=0.015)
    assert rate_of(np.round(np.arange(5000) / rate + 7.1234, 3)) == rate


@pytest.mark.parametrize("rate", [60, 120, 150, 300, 500, 600, 1000])
def test_lost_samples_count(rate, rng):
    assert rate_of(*taps(rate, 50, 100, rng, lost=0.03)) == rate
    assert rate_of(*taps(rate, 5000, 1, rng, lost=0.03)) == rate
    assert rate_of(*taps(rate, 5000, 1, rng, decimals=9, lost=0.15)) == rate


@pytest.mark.parametrize("jitter", [0.02, 0.1, 0.25])
def test_jitter(jitter, rng):
    """Also with lost samples; a late time is none."""
    time = (np.arange(5000) + jitter * rng.standard_normal(5000)) / 200
    few = np.delete(time, rng.choice(np.arange(1, 4999), 50, replace=False))
    late = time.copy()
    late[::100] += 1 / 200

    assert rate_of(time) == 200
    assert rate_of(late) == 200
    assert rate_of(few) == pytest.approx(200, rel=5e-3 if jitter > 0.2 else 1e-9)


def test_sleeping_loops(rng):
    """Delays add up, so the rate is the mean one; sessions of a sensor have the same if their rates hardly differ."""
    steps = 0.01 * (1 + 0.1 * abs(rng.standard_normal(20000)))

    assert rate_of(np.cumsum(steps)) == pytest.approx(1 / steps.mean(), rel=2e-3)


@pytest.mark.parametrize("rate", [200.0, 500.0, 1000.0, 2000.0, 5000.0])
def test_seconds_since_1970(rate):
    """A double has steps of a quarter of a microsecond there."""
    assert rate_of(1.7e9 + 0.123456 + np.arange(2000) / rate) == rate


def test_sessions_that_jitter_have_one_rate(rng):
    """As three recordings of ten seconds with 0.2 ms of jitter, of which median steps make 199.957 to 200.119 Hz."""
    assert {rate_of(np.arange(2000) / 200 + rng.uniform(-2e-4, 2e-4, 2000)) for _ in range(10)} == {200.0}


@pytest.mark.parametrize("known", [True, False])
def test_pauses_between_stretches_do_not_count(known, rng):
    assert rate_of(*taps(60, 20, 30, rng), known=known) == 60


def test_a_fall_and_unknown_times_do_not_count():
    time = np.concatenate([np.arange(30) / 50, np.arange(30) / 50])
    time[7] = np.nan

    assert rate_of(time) == 50


def test_most_samples_have_the_time_of_the_one_before():
    """A clock of 1 ms at 2 kHz."""
    assert rate_of(np.floor(np.arange(4000) / 2) / 1000) == pytest.approx(2000, rel=1e-3)
    assert rate_of(np.floor(np.arange(4001) / 5) / 1000) == pytest.approx(5000, rel=1e-3)


def test_few_samples():
    """Within what a millisecond is of them."""
    assert rate_of([0.0, 0.017]) == pytest.approx(60, rel=0.03)
    assert rate_of(*[[0.0, 0.017, 0.033]] * 10) == 60
    assert pace([0.0], [True]) is None
    assert pace([0.0, 1.0], [True, True]) is None
    assert pace([0.0, 0.0], [True, False]) is None
    assert pace([], NONE) is None


@pytest.mark.parametrize(
    ("rate", "expected"),
    [(199.97, 200), (199.9, 199.9), (1024, 1024), (59.94, 59.94), (98.372, 98.37), (0.25, 0.25), (16384, 16384)],
)
def test_a_rate_has_no_more_digits_than_two_clocks_share(rate, expected):
    """Two in ten thousand."""
    assert rate_of(np.arange(50_000) / rate) == expected


def test_files_of_one_tap_tell_one_rate(rng):
    """And by how much each may miss it, so that short taps do not seem to differ."""
    found = [pace(each, np.arange(len(each)) == 0) for each in taps(60, 6, 40, rng)]
    rate, chance = common_rate([each for each in found if each is not None])

    assert rate == 60
    assert (chance > 0.005).all()
    assert (chance < 0.1).all()
