"""Frames at another rate: what passes, what does not, and that pieces make no difference."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import resample_poly
from solidtouch.models.cutting.resampling import Resampler, resampled_taps
from solidtouch.models.cutting.sampling_ratio import sampling_ratio
from solidtouch.models.errors import InputError

RATES = [(1000.0, 50.0), (100.0, 30.0), (60.0, 50.0), (48.0, 44.1), (20.0, 30.0), (50.0, 400.0), (33.3, 11.1)]


def wave(sensor_hz, rate_hz, frequency_hz):
    """Resampled complex oscillation away from its beginning, and the times of its samples."""
    resampler = Resampler(sensor_hz, rate_hz)
    periods = int(60 * sensor_hz / min(sensor_hz, rate_hz)) + 2 * resampler.delay
    phase = 2 * np.pi * frequency_hz * np.arange(periods) / sensor_hz
    made = resampler(np.stack([np.cos(phase), np.sin(phase)], axis=1))
    settled = np.arange(len(made)) >= resampler.delay * resampler.ratio
    return (made[:, 0] + 1j * made[:, 1])[settled], (np.arange(len(made)) / rate_hz)[settled]


@pytest.mark.parametrize(("sensor_hz", "rate_hz"), RATES)
@pytest.mark.parametrize("part", [0.0, 0.03, 0.25, 0.5, 0.7, 0.8])
def test_what_is_below_four_fifths_of_the_nyquist_frequency_stays_at_its_time(sensor_hz, rate_hz, part):
    """Amplitude and phase, so there is no delay."""
    frequency = part * min(sensor_hz, rate_hz) / 2
    found, time = wave(sensor_hz, rate_hz, frequency)

    assert len(found) > 30
    np.testing.assert_allclose(found, np.exp(2j * np.pi * frequency * time), rtol=0, atol=1e-3)


@pytest.mark.parametrize(("sensor_hz", "rate_hz"), [rates for rates in RATES if rates[0] > 1.3 * rates[1]])
@pytest.mark.parametrize("part", [1.2, 1.25, 1.31, 1.4])
def test_what_is_above_six_fifths_of_the_nyquist_frequency_falls_by_65_db(sensor_hz, rate_hz, part):
    found, _ = wave(sensor_hz, rate_hz, part * rate_hz / 2)

    assert abs(found).max() < 10 ** (-65 / 20)


@given(
    rates=st.sampled_from(RATES),
    frames=st.integers(0, 150),
    cuts=st.lists(st.integers(0, 150), max_size=12),
    seed=st.integers(0, 99),
)
@settings(max_examples=100, deadline=None)
def test_pieces_of_a_stream_give_the_same_bits(rates, frames, cuts, seed):
    stream = np.random.default_rng(seed).normal(size=(frames, 3)) * 1000
    pieces = Resampler(*rates)
    parts = [pieces(part) for part in np.split(stream, sorted(min(cut, frames) for cut in cuts))]

    np.testing.assert_array_equal(np.concatenate(parts), Resampler(*rates)(stream))


@pytest.mark.parametrize(("sensor_hz", "rate_hz"), RATES)
def test_results_come_as_soon_as_their_frames_are_there(sensor_hz, rate_hz):
    """One by one, result m with the frame that is `delay` after its own."""
    resampler = Resampler(sensor_hz, rate_hz)
    made = 0
    for frame in range(3 * resampler.delay):
        made += len(resampler(np.ones((1, 2))))

        assert made == sum(1 for m in range(made + 9) if m // resampler.ratio + resampler.delay <= frame)


@pytest.mark.parametrize(("sensor_hz", "rate_hz"), RATES)
def test_a_constant_stays_as_it_is(sensor_hz, rate_hz):
    value = np.array([[0.1, 240.0, -1e7]])
    made = Resampler(sensor_hz, rate_hz)(np.repeat(value, 300, axis=0))

    np.testing.assert_array_equal(made, np.repeat(value, len(made), axis=0))


def test_memory_stays_bounded():
    resampler = Resampler(1000.0, 50.0)
    for _ in range(300):
        resampler(np.zeros((17, 2)))

        assert len(resampler._kept) <= 2 * resampler.delay + 20


def test_the_filter_agrees_with_that_of_scipy():
    """`resample_poly` with the same kernel, between the edges."""
    from scipy.signal import firwin, kaiser_beta

    stream = np.random.default_rng(3).normal(size=(400, 2)).cumsum(axis=0)
    kernel = firwin(2 * 10 * 10 + 1, 1 / 10, window=("kaiser", kaiser_beta(65.0)))
    theirs = resample_poly(stream, 3, 10, window=kernel)
    ours = Resampler(100.0, 30.0)(stream)

    np.testing.assert_allclose(ours[12:], theirs[12 : len(ours)], rtol=0, atol=2e-3 * np.ptp(stream))
    assert abs(ours[12:] - theirs[13 : len(ours) + 1]).max() > 0.1


@pytest.mark.parametrize(("sensor_hz", "rate_hz"), RATES)
def test_cut_taps_are_resampled_as_if_their_ends_stayed(sensor_hz, rate_hz):
    taps = np.random.default_rng(5).normal(size=(4, 37, 3))
    found = resampled_taps(taps, sensor_hz, rate_hz)
    ratio = sampling_ratio(sensor_hz, rate_hz)

    assert found.shape == (4, int(36 * ratio) + 1, 3)
    for tap, one in zip(taps, found, strict=True):
        held = np.concatenate([np.repeat(tap[:1], 60, axis=0), tap, np.repeat(tap[-1:], 500, axis=0)])
        shifted = Resampler(sensor_hz, rate_hz)(held[60:])
        np.testing.assert_array_equal(one, shifted[: len(one)])


def test_many_taps_are_resampled_in_parts(monkeypatch):
    taps = np.random.default_rng(5).normal(size=(7, 20, 3))
    together = resampled_taps(taps, 100.0, 50.0)
    monkeypatch.setattr("solidtouch.models.cutting.resampling._AT_ONCE", 130)

    np.testing.assert_array_equal(resampled_taps(taps, 100.0, 50.0), together)


def test_taps_of_the_same_rate_are_left_alone():
    taps = np.random.default_rng(5).normal(size=(2, 20, 3))

    np.testing.assert_array_equal(resampled_taps(taps, 50.0, 50.0), taps)


def test_the_ends_of_a_cut_ramp_cost_what_is_written():
    """A tenth of a step at the end, then 0.013 and less than 0.005 of one; the middle is exact."""
    ramp = np.arange(400.0)[np.newaxis, :, np.newaxis] / 10
    error = abs(resampled_taps(ramp, 100.0, 10.0)[0, :, 0] - np.arange(40))

    assert error[[0, 1]] == pytest.approx([0.1, 0.013], abs=0.002)
    assert error[2:37].max() < 0.005
    assert error[12:27].max() < 1e-12


@pytest.mark.parametrize(
    ("taps", "message"),
    [
        (np.zeros((3, 4)), r"must have shape \(N, J, K\)"),
        (np.zeros((3, 0, 4)), "without empty axes"),
        (np.full((1, 2, 3), np.nan), "missing or infinite samples cannot be resampled"),
    ],
)
def test_taps_that_cannot_be_resampled_are_refused(taps, message):
    with pytest.raises(InputError, match=message):
        resampled_taps(taps, 100.0, 50.0)


@pytest.mark.parametrize(
    ("rates", "ratio"),
    [((1000.0, 50.0), (1, 20)), ((48.0, 44.1), (147, 160)), ((0.3, 0.1), (1, 3)), ((1.0, 1000.0), (1000, 1))],
)
def test_ratios_are_those_of_the_decimal_numbers(rates, ratio):
    assert sampling_ratio(*rates) == Fraction(*ratio)


@pytest.mark.parametrize("rates", [(99.98, 50.0), (1.0, 1001.0), (1001.0, 1.0), (1e9, 1e-9), (1e-9, 1e9)])
def test_other_ratios_are_refused_with_what_to_do(rates):
    with pytest.raises(InputError, match=r"Cannot resample from .* Hz: .*whole numbers up to 1000; .*rounded"):
        sampling_ratio(*rates)
