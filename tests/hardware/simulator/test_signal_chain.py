"""Lag, gain, noise and converter."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.hardware.simulator.signal_chain import FULL_SCALE, FirstOrderNoise, SignalChain, session_nuisances

K = 12


def chain(settings, entropy=1):
    return SignalChain(settings, session_nuisances(settings, 0, 0), np.random.SeedSequence(entropy))


@pytest.mark.parametrize("name", PRESETS)
def test_readings_are_whole_counts_of_eight_bits(name, rng):
    """Whatever the load, the converter gives whole numbers from 0 to 255."""
    counts = chain(PRESETS[name]).read(rng.uniform(0, 20, (400, K)))

    assert (counts == np.rint(counts)).all()
    assert counts.min() >= 0
    assert counts.max() <= FULL_SCALE


def test_readings_rise_under_load(exact):
    """Without noise a growing load never lowers a reading."""
    counts = chain(exact).read(np.linspace(0, 2, 60)[:, np.newaxis] * np.ones(K))

    assert (np.diff(counts, axis=0) >= 0).all()
    assert (counts[-1] > counts[0] + 50).all()


def test_compression_halves_the_signal_at_its_scale(exact):
    """At an indentation of `compression_mm` half the linear signal is left."""
    settings = replace(exact, lag_s=0.0, sensitivity_log_sd=0.0, rail_sd_counts=0.0, rail_counts=255.0)
    settings = replace(settings, gain_counts_per_mm=100.0)

    assert (chain(settings).read(np.full((1, K), settings.compression_mm)) == 100.0).all()


def test_lag_reaches_63_percent_after_its_time_constant(exact):
    """The foam follows a step like a first-order system."""
    settings = replace(exact, lag_s=1.0, compression_mm=1e9, rail_counts=255.0, rail_sd_counts=0.0)
    settings = replace(settings, sensitivity_log_sd=0.0, gain_counts_per_mm=200.0)
    counts = chain(settings).read(np.ones((50, K)))

    assert counts[-1, 0] == pytest.approx(200 * (1 - np.exp(-1)), abs=0.5)


@pytest.mark.parametrize("name", ["paper", "hold2"])
def test_any_cut_of_the_stream_gives_the_same_readings(name, rng):
    """State carries on over calls, whatever their length."""
    load = rng.uniform(0, 1, (61, K))
    whole = chain(PRESETS[name]).read(load)
    pieces = chain(PRESETS[name])

    np.testing.assert_array_equal(whole, np.concatenate([pieces.read(part) for part in np.split(load, [0, 1, 4, 37])]))


def test_sample_and_hold_repeats_every_reading(rng):
    """With `hold_samples` of 2 frames come in equal pairs that are the even readings without it."""
    load = rng.uniform(0, 1, (40, K))
    held, free = chain(PRESETS["hold2"]).read(load), chain(PRESETS["paper"]).read(load)

    np.testing.assert_array_equal(np.repeat(free[::2], 2, axis=0), held)


def test_idle_noise_of_the_paper_preset_is_below_two_counts():
    """White, taxel and common noise of one count each give about 1.7, on a taxel off its rail."""
    settings = replace(PRESETS["paper"], rail_counts=200.0, walk_counts=0.0)
    counts = chain(settings).read(np.zeros((20_000, K)))

    assert counts.std(axis=0).mean() == pytest.approx(np.sqrt(3 + 1 / 12), rel=0.05)


@pytest.mark.parametrize(("decay", "lag_one"), [(0.0, 0.0), (0.9, 0.9)])
def test_noise_has_the_stated_size_and_correlation(decay, lag_one):
    """AR(1) noise is stationary from its first sample on."""
    step = np.sqrt(1 - decay**2)
    noise = FirstOrderNoise(np.random.default_rng(0), 2000, decay, step, 1.0).draw(100)

    assert noise[0].std() == pytest.approx(1, rel=0.06)
    assert noise.std() == pytest.approx(1, rel=0.03)
    assert np.mean(noise[1:] * noise[:-1]) == pytest.approx(lag_one, abs=0.03)


def test_random_walk_spreads_with_the_root_of_time():
    """A walk starts at zero and its variance grows by one step's per sample."""
    walk = FirstOrderNoise(np.random.default_rng(0), 4000, 1.0, 0.5, 0.0).draw(100)

    assert walk[99].std() == pytest.approx(5.0, rel=0.05)
