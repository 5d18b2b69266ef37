"""How exact draws of new sessions are, and how many a fit takes."""

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from scipy import stats
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.generic import session_draws, story
from solidtouch.models.measurement.generic.session_draws import error_of_mean
from solidtouch.models.measurement.registry import fit_model, model_name
from solidtouch.models.settings import FitSettings


@pytest.mark.parametrize("ratio", [1.0, 3.0, 10.0])
@pytest.mark.parametrize("shifts", [1, 2, 4, 8])
def test_the_error_of_gaussian_integrals_is_known(shifts, ratio):
    """Also where 128 draws are far too few for the dimensions, in which two halves err alike."""
    rng, said, halves = np.random.default_rng(shifts), [], []
    for _ in range(20):
        draws = stats.norm.ppf(stats.qmc.Sobol(shifts, rng=rng).random(128))
        told = rng.normal(size=(12, shifts)) * np.sqrt(1 + ratio**-2)
        exact = -0.5 * (np.log1p(ratio**2) + told**2 / (1 + ratio**-2)).sum(axis=1)
        weight = -0.5 * ratio**2 * ((draws[:, None] - told) ** 2).sum(axis=2)
        error = np.abs(np.logaddexp.reduce(weight) - np.log(128) - exact).mean()
        two = [np.logaddexp.reduce(half) for half in np.split(weight, 2)]
        said.append(error_of_mean(weight) / error)
        halves.append(0.5 * np.abs(two[0] - two[1]).mean() / error)

    assert 0.6 < np.median(said) < 5
    if shifts == 8 and ratio > 1:
        assert np.median(halves) < 0.4


def test_few_draws_have_no_known_error():
    assert np.isnan(error_of_mean(np.zeros((15, 2))))
    assert error_of_mean(np.zeros((16, 2))) == 0


def of_taxels(where, what, taps=None, *, M, J, K, session):
    """A shift of each session and taxel."""
    with numpyro.plate("M", M):
        loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
    with numpyro.plate("S", int(session.max()) + 1, dim=-2), numpyro.plate("K", K, dim=-1):
        shift = numpyro.sample("shift", dist.Normal(0.0, 2.0))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.Normal(loc[what][:, None, None] + shift[session][:, None], 1.0), obs=taps)


@pytest.fixture
def fit(make_taps, monkeypatch):
    """A fit whose latent variables are set by hand."""
    latents = {"loc": np.array([-0.3, 0.6]), "shift": np.array([[1.0, -0.5], [0.3, 0.2]])}
    found = fits.GuidePosterior(latents, lambda _: latents, fits.Convergence(True, "Set by hand.", {}))
    monkeypatch.setattr(fits, "posterior", lambda *_: found)
    monkeypatch.setattr(fits, "check_prior", lambda _: "")
    taps = make_taps(2, 2, 2, 2, repeats=6)

    def made(integrate=0):
        settings = FitSettings(bins=9, power="none", method="svi", integrate=integrate)
        return fit_model(model_name(of_taxels), taps, taps.grid(), settings)

    return made


def test_a_fit_takes_as_many_draws_as_it_needs_and_tables_allow(fit, monkeypatch, tmp_path):
    monkeypatch.setattr(story, "FEWEST", 16)
    monkeypatch.setattr(session_draws, "_MOST", 64)
    model, _, told = fit()
    assert len(model.states.gain) == len(model.decides_at) == 64
    assert "(shift) is one of 64 draws, by which the log evidence of 10 taps is off by about" in told.warning
    model.save(tmp_path / "fit.nc")
    opened = load_model(tmp_path / "fit.nc", of_taxels)
    np.testing.assert_array_equal(
        [one["shift"] for one in opened.decides_at], [one["shift"] for one in model.decides_at]
    )

    monkeypatch.setattr(session_draws, "_AT_MOST", 64 * 2 * 2 * 24 - 1)  # taps under all hypotheses
    model, _, told = fit()
    assert len(model.states.gain) == 16
    assert "is one of 16 draws" in told.warning
    assert told.warning.endswith("nats. Use more, --integrate D, or give a session fewer variables.")

    monkeypatch.setattr(session_draws, "FEWEST", 16)
    assert "More draws, --integrate D, help little: give a session fewer" in fit().convergence.warning


def test_draws_that_are_asked_for_are_judged_and_kept(fit):
    model, _, told = fit(integrate=20)

    assert len(model.states.gain) == len(model.draws) == 20
    assert "is one of 20 draws" in told.warning
