"""Gains, offsets and their errors are those of the taps, and variance components those they were made with."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.audit.variance import gains as module
from solidtouch.analysis.audit.variance.gains import SEQUENCES, collapse, effective_taps, tap_gains, variance_components
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import PAPER_RODS, preset
from solidtouch.models.errors import InputError
from solidtouch.models.measurement import gain_variance
from solidtouch.models.measurement.gain_variance import COMPONENTS, gain_posteriors
from solidtouch.models.taps import concatenate

R, C, N, J, K = 4, 6, 7, 5, 8


def made(rng, *, R=R, C=C, n=N, J=J, K=K, loaded=K, session=0.0, mounting=0.0, tap=0.0, offset=0.0, noise=0.0):
    """Taps that are the mean tap of their class times a gain plus an offset, on an idle level of each taxel.

    Returns taps, class, session, true gain and true offset of each.
    """
    r, c, _ = (index.ravel() for index in np.indices((R, C, n)))
    shape = rng.normal(size=(C, J, K)) * (np.arange(K) < loaded) * np.linspace(0, 10, J)[:, None] / max(J - 1, 1)
    if J == 1:
        shape = 10 * rng.normal(size=(C, 1, K))
    gain = (
        1.0 + session * rng.normal(size=R)[r] + mounting * rng.normal(size=(R, C))[r, c] + tap * rng.normal(size=len(r))
    )
    shift = offset * rng.normal(size=len(r))
    idle = rng.uniform(100, 200, size=K) * (J > 1)
    samples = idle + gain[:, None, None] * shape[c] + shift[:, None, None]
    return samples + noise * rng.normal(size=samples.shape), 3 * c + 1, r, gain, shift


def deviations(value, own):
    """From the mean of each class."""
    index = np.unique(own, return_inverse=True)[1]
    return value - (np.bincount(index, weights=value) / np.bincount(index))[index]


@pytest.mark.parametrize("J", [1, 5])
def test_gains_and_offsets_are_found_exactly(J, rng):
    """Without noise they are those that made the taps, relative to the mean of the class, and their error is 0.

    Idle levels of taxels do not matter.
    """
    taps, own, session, gain, shift = made(rng, J=J, tap=0.1, session=0.05, offset=2.0)
    found = tap_gains(taps, own, session)
    index = np.unique(own, return_inverse=True)[1]
    mean_gain = (np.bincount(index, weights=gain) / np.bincount(index))[index]
    mean_shift = deviations(shift, own) if J > 1 else shift - gain * ((shift - deviations(shift, own)) / mean_gain)

    np.testing.assert_allclose(found.value[0], gain / mean_gain - 1, atol=1e-9)
    np.testing.assert_allclose(found.value[1], mean_shift, atol=1e-8)
    np.testing.assert_allclose(found.error, 0, atol=1e-12)


@pytest.mark.parametrize("loaded", [3, 8])
def test_errors_are_as_large_as_gains_are_wrong(loaded, rng):
    """The variance of the errors is right to a tenth, with all taxels under load and with three of eight."""
    taps, own, session, gain, shift = made(rng, C=40, n=12, loaded=loaded, tap=0.05, noise=0.5)
    found = tap_gains(taps, own, session)
    assert found.used.all()
    for value, truth, error in zip(found.value, (gain, shift), found.error, strict=True):
        index = np.unique(own, return_inverse=True)[1]
        wrong = deviations(value - truth, own)
        freedom = 1 - np.bincount(index).size / len(own)
        assert (wrong**2).mean() / freedom == pytest.approx(error.mean(), rel=0.1)


def test_classes_without_signal_are_left_out(rng):
    """A mean tap of noise says nothing of gains; the others keep theirs."""
    taps, own, session, _, _ = made(rng, tap=0.05, noise=0.5)
    flat = own == 4
    taps[flat] = 150 + 0.5 * rng.normal(size=taps[flat].shape)
    found = tap_gains(taps, own, session)

    assert found.used.tolist() == [True, False, True, True, True, True]
    assert np.isnan(found.value[:, flat]).all()
    assert np.isfinite(found.value[:, ~flat]).all()
    assert collapse(found, own, session).taps.tolist() == [[N] * (C - 1)] * R


def test_cells_are_means_and_sums_of_squares(rng):
    """Of gains as they are and of offsets in units of the amplitude; cells without a tap count none."""
    taps, own, session, _, _ = made(rng, tap=0.05, noise=0.5, offset=1.0)
    kept = ~((session == 2) & (own == 7))
    taps, own, session = taps[kept], own[kept], session[kept]
    gains = tap_gains(taps, own, session)
    cells = collapse(gains, own, session)
    members = gains.value[:, (session == 3) & (own == 10)]

    assert cells.taps[2, 2] == 0
    assert cells.taps.sum() == len(taps)
    assert cells.mean[0, 3, 3] == pytest.approx(members[0].mean())
    assert cells.mean[1, 3, 3] == pytest.approx(members[1].mean() / gains.amplitude)
    assert cells.square[1, 3, 3] == pytest.approx(members[1].var() * N / gains.amplitude**2)
    assert cells.error[1, 3, 3] == pytest.approx(gains.error[1, (session == 3) & (own == 10)][0] / gains.amplitude**2)


def test_effective_taps_are_those_of_the_mean_of_correlated_values(rng):
    """The variance of the mean of n values of correlation rho is one over them."""
    n, rho = 7, 0.3
    covariance = rho + (1 - rho) * np.eye(n)

    assert effective_taps(n, rho) == pytest.approx(n**2 / covariance.sum())
    np.testing.assert_allclose(effective_taps([1, 5, 50], 0.0), [1, 5, 50])
    np.testing.assert_allclose(effective_taps([1, 5, 50], 1.0), 1)


@pytest.fixture(scope="module")
def estimated():
    """Of taps of 8 sessions with spreads of .08, .05 and .1 of the gain and .5 counts of the offset."""
    taps, own, session, *_ = made(
        np.random.default_rng(6), R=8, C=9, n=6, session=0.08, mounting=0.05, tap=0.1, offset=0.5, noise=0.3
    )
    return variance_components(taps, own, session)


def test_variance_components_are_recovered(estimated):
    """All three intervals of the gain hold the truth, and those of the offset see that only taps differ."""
    found = estimated
    for name, truth in zip(COMPONENTS, (0.08, 0.05, 0.1), strict=True):
        row = found.summary.sel(quantity="gain", component=name)
        assert row["low"] < truth < row["high"]
        assert row["low"] < row["mean"] < row["high"]
    offset = found.summary.sel(quantity="offset")
    assert offset["low"].sel(component="tap") < 0.5 < offset["high"].sel(component="tap")
    assert offset["high"].sel(component=["session", "mounting"]).max() < 0.3
    rho, truth = found.rho.sel(quantity="gain"), (0.08**2 + 0.05**2) / (0.08**2 + 0.05**2 + 0.1**2)
    assert rho["low"] < truth < rho["high"]
    assert found.effective["low"].sel(n=20) < effective_taps(20, truth) < found.effective["high"].sel(n=20)
    assert found.effective["mean"].sel(n=1) == pytest.approx(1)


def test_results_are_said_in_words(estimated):
    assert estimated.converged
    assert estimated.summary["mean"].dims == ("quantity", "component")
    assert "Standard deviation of the gain: between sessions" in estimated.sentences[0]
    assert "20 taps are worth" in estimated.sentences[2]
    assert len(estimated.sentences) == 3


def test_intervals_of_rho_and_of_taps_are_those_of_draws_from_the_posterior(rng):
    """Quantiles over the grid, and effective numbers of taps that decrease with rho."""
    taps, own, session, *_ = made(rng, session=0.05, mounting=0.05, tap=0.1, noise=0.3)
    found = variance_components(taps, own, session)
    posterior = gain_posteriors(collapse(tap_gains(taps, own, session), own, session))[0]
    index = rng.choice(posterior.weight.size, size=100_000, p=posterior.weight.ravel())
    sessions, mountings, single = (
        np.interp(places + rng.uniform(-0.5, 0.5, size=len(index)), np.arange(len(sd)), sd) ** 2
        for sd, places in zip(posterior.sd, np.unravel_index(index, posterior.weight.shape), strict=True)
    )
    rho = (sessions + mountings) / (sessions + mountings + single)
    for values, row in (
        (rho, found.rho.sel(quantity="gain")),
        (effective_taps(20, rho), found.effective.sel(n=20)),
        (np.sqrt(mountings), found.summary.sel(quantity="gain", component="mounting")),
    ):
        assert row["mean"] == pytest.approx(values.mean(), rel=0.01)
        np.testing.assert_allclose([row["low"], row["high"]], np.quantile(values, [0.05, 0.95]), rtol=0.02)


def test_integrals_that_did_not_converge_are_said_to(rng, monkeypatch):
    taps, own, session, *_ = made(rng, tap=0.1, noise=0.3)
    monkeypatch.setattr(gain_variance, "POINTS", 5)
    found = variance_components(taps, own, session)

    assert not found.converged
    assert found.sentences[-1].endswith("did not converge, so the intervals are unreliable.")


def told(found):
    """Components that have a number."""
    known = np.isfinite(found.summary["mean"].sel(quantity="gain"))
    return [name for name in COMPONENTS if known.sel(component=name)]


def test_one_session_tells_of_taps_only(rng):
    taps, own, session, _, _ = made(rng, R=1, tap=0.1)
    found = variance_components(taps, own, session)

    assert told(found) == ["tap"]
    assert found.sentences[0] == "With one session, differences between sessions cannot be estimated."
    assert np.isnan(found.effective["mean"]).all()
    assert not any("between sessions 10" in sentence for sentence in found.sentences)


def test_two_sessions_are_said_to_be_few(rng):
    taps, own, session, _, _ = made(rng, R=2, tap=0.1)
    found = variance_components(taps, own, session)

    assert told(found) == list(COMPONENTS)
    assert "With two sessions" in " ".join(found.sentences)
    assert found.effective.sizes["n"] == len(SEQUENCES)


def test_cells_of_one_tap_do_not_tell_taps_from_mounting(rng):
    taps, own, session, _, _ = made(rng, n=1, tap=0.1, noise=0.1)
    found = variance_components(taps, own, session)

    assert told(found) == ["session", "mounting"]
    assert "cannot be separated from mounting" in " ".join(found.sentences)
    assert np.isnan(found.rho["mean"]).all()


def test_classes_of_one_session_each_do_not_tell_sessions(rng):
    taps, own, session, _, _ = made(rng, tap=0.1)
    kept = (own // 3) % R == session
    found = variance_components(taps[kept], own[kept], session[kept])

    assert told(found) == ["tap"]
    assert "fewer than two classes have taps in several sessions" in found.sentences[0]


def test_mean_taps_without_signal_tell_nothing(rng):
    """Constant samples, one taxel with one sample, and noise."""
    own, session = np.repeat(np.arange(C), 2 * N), np.tile(np.arange(2), C * N)
    for taps in (
        np.full((len(own), J, K), 7.0),
        own[:, None, None] + rng.normal(size=(len(own), 1, 1)),
        rng.normal(size=(len(own), J, K)),
    ):
        found = variance_components(taps, own, session)
        assert told(found) == []
        assert "separate a gain from an offset" in found.sentences[0]
        assert isinstance(found.summary, xr.Dataset)


def test_one_taxel_is_said_to_show_no_noise(rng):
    taps, own, session, _, _ = made(rng, K=1, tap=0.1)

    assert "With one taxel" in variance_components(taps, own, session).sentences[0]


def test_of_many_classes_some_are_chosen(rng, monkeypatch):
    """Evenly over all of them, and the page says so."""
    monkeypatch.setattr(module, "MOST_CLASSES", 4)
    taps, own, session, _, _ = made(rng, tap=0.1)

    assert (
        variance_components(taps, own, session).sentences[0]
        == "Variance components were estimated from 4 of 6 classes."
    )


def test_of_many_sessions_some_are_chosen(rng, monkeypatch):
    """Before classes are, of which those of other sessions are none."""
    monkeypatch.setattr(module, "MOST_SESSIONS", 3)
    taps, own, session, _, _ = made(rng, tap=0.1)
    elsewhere = np.where(session == 1, own + 100, own)
    sessions = "3 of 4 sessions."

    assert variance_components(taps, own, session).sentences[0].endswith(f"from {sessions}")
    assert variance_components(taps, elsewhere, session).sentences[0].endswith(f"from 6 of 12 classes and {sessions}")


def test_arrays_that_do_not_fit_are_refused(rng):
    taps, own, session, _, _ = made(rng)
    for arguments in ((taps[0], own, session), (taps, own[1:], session), (taps[:0], own[:0], session[:0])):
        with pytest.raises(InputError, match=r"need taps of shape \(N, J, K\) with a class and a session each"):
            variance_components(*arguments)


@pytest.mark.slow
def test_the_simulated_rig_is_seen_through():
    """Gains of six sessions and indentations of taps come back as they were set, on a rig that is otherwise ideal.

    What an indentation does to a tap is measured on taps without noise, pressed 2% deeper and less deep.
    """
    rig = replace(
        preset("ideal"),
        rods=PAPER_RODS[::2],
        start_mm=6.0,
        end_mm=10.0,
        spacing_mm=0.2,
        position_spread_mm=0.0,
        highpass_hz=0.0,
        rail_counts=240.0,
        rail_sd_counts=0.0,
    )

    def cells(taps):
        where, what = taps.indices(taps.grid())
        return where * 3 + what

    quiet = replace(rig, white_counts=0.01)
    middle, deep, shallow = (
        simulate_session(replace(quiet, depth_mm=rig.depth_mm * factor), 1, 0) for factor in (1.0, 1.02, 0.98)
    )
    elasticity = []
    for c in range(12):
        own = cells(middle) == c
        mean = middle.taps[own].mean(axis=0)
        signal = mean - mean[0]
        signal = signal - signal.mean()
        change = deep.taps[own].mean(axis=0) - shallow.taps[own].mean(axis=0)
        elasticity.append((signal * change).sum() / (signal**2).sum() / np.log(1.02 / 0.98))
    rig = replace(rig, session_gain_log_sd=0.1, tap_depth_log_sd=0.03)
    taps = concatenate([simulate_session(rig, 2, session) for session in range(6)])
    gain = variance_components(taps.taps, cells(taps), taps.session).summary.sel(quantity="gain")

    assert gain["low"].sel(component="session") < 0.1 < gain["high"].sel(component="session")
    expected = 0.03 * np.sqrt(np.mean(np.square(elasticity)))
    assert gain["mean"].sel(component="tap") == pytest.approx(expected, rel=0.1)
    assert gain["high"].sel(component="mounting") < gain["low"].sel(component="tap")
