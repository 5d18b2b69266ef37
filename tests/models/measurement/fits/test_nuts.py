"""NUTS on the stories of tiny sets: it agrees with the fits in closed form, and says when it did not converge."""

import arviz as az
import numpy as np
import pytest
from solidtouch.models.measurement import matrix_normal, profile, profile_mvn, smooth
from solidtouch.models.measurement.fits import nuts as fit_nuts
from solidtouch.models.measurement.fits.nuts import sample_story
from solidtouch.models.measurement.fits.posterior import SamplePosterior
from solidtouch.models.measurement.fits.priors import Taps
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

L, M, J, K = 2, 2, 3, 4


def tiny(rng, n=5, J=J, K=K, correlation=0.0):
    """Taps of all classes but (0, 1)."""
    where, what = (index.ravel() for index in np.indices((L, M, n))[:2])
    used = (where > 0) | (what == 0)
    where, what = where[used], what[used]
    root = np.linalg.cholesky((1 - correlation) * np.eye(K) + correlation)
    return Taps(rng.normal(size=(len(where), J, K)) @ root.T + what[:, None, None], where, what, (L, M))


def errors(posterior, name):
    """Monte Carlo standard error of the means of a parameter."""
    values = posterior.samples[name]
    ess = az.ess(az.from_dict({"posterior": {name: values}})["posterior"].dataset)[name].values
    return values.std(axis=(0, 1)) / np.sqrt(ess)


@pytest.mark.slow
def test_profile_agrees_with_its_closed_form(rng):
    """Means of levels and variances within five standard errors, with a class that no tap trained.

    R-hat and effective sample size are the worst that ArviZ finds of all sites.
    """
    taps = tiny(rng)
    exact = profile.fit(taps)
    trained, over_grid = fit_nuts.trained_only(taps)
    kept = {}

    def keep(sites):
        kept.update(sites)
        return over_grid(sites)

    posterior = sample_story(trained.under(profile.story, prior=exact.prior), keep, seed=3)
    used = np.array([[True, False], [True, True]])
    cells = exact.cells
    expected = {"level": cells.level, "variance": cells.b / (cells.a - 1)}

    assert trained.shape == (3, 1)
    assert posterior.convergence().converged
    for name, value in expected.items():
        assert posterior.samples[name].shape == (4, 250, L, M, J, K)
        gap = np.abs(posterior.point()[name] - value)[used]
        assert np.all(gap < 5 * errors(posterior, name)[used])
    data = az.from_dict({"posterior": kept})["posterior"].dataset
    assert posterior.stats["r_hat"] == pytest.approx(max(float(v.max()) for v in az.rhat(data).data_vars.values()))
    assert posterior.stats["ess"] == pytest.approx(min(float(v.min()) for v in az.ess(data).data_vars.values()))


@pytest.mark.parametrize(
    ("stats", "converged"),
    [
        ({"r_hat": 1.01, "ess": 500.0, "divergences": 0.0}, True),
        ({"r_hat": 1.06, "ess": 500.0, "divergences": 0.0}, False),
        ({"r_hat": 1.01, "ess": 99.0, "divergences": 0.0}, False),
        ({"r_hat": 1.01, "ess": 500.0, "divergences": 1.0}, False),
        ({"r_hat": np.nan, "ess": 500.0, "divergences": 0.0}, False),
    ],
)
def test_each_diagnostic_can_refuse(stats, converged):
    """One that is too bad is enough."""
    convergence = SamplePosterior({}, stats).convergence()

    assert convergence.converged == converged
    assert "R-hat" in convergence.sentence


def test_draws_are_those_of_the_chains(rng):
    """All parameters of a draw belong together."""
    values = np.arange(6.0).reshape(2, 3)
    posterior = SamplePosterior({"a": values, "b": -values[..., None]}, {})
    drawn = [posterior.draw(rng) for _ in range(60)]

    assert {float(draw["a"]) for draw in drawn} == set(values.ravel())
    assert all(draw["b"][0] == -draw["a"] for draw in drawn)
    assert posterior.point()["a"] == 2.5


def test_sites_become_parameters(rng):
    """Pairs become matrices, precisions covariances with trace J in time, and the basis the last axis."""
    pairs = rng.normal(size=(2, 3, L, M, 6))
    slope = profile_mvn.parameters_of({"slope": pairs, "level": np.zeros((2, 3, L, M, J, 4))})["slope"]
    assert slope.shape == (2, 3, L, M, 4, 4)
    np.testing.assert_array_equal(slope[1, 2, 0, 1][np.tril_indices(4, -1)], pairs[1, 2, 0, 1])
    assert not np.triu(slope).any()

    root, columns = rng.normal(size=(2, 3, J, J + 1)), rng.normal(size=(2, 3, L, M, K, K + 1))
    time, taxel = root @ root.swapaxes(-1, -2), columns @ columns.swapaxes(-1, -2)
    found = matrix_normal.parameters_of({"time": time, "taxel": taxel, "level": np.zeros(1)})
    np.testing.assert_allclose(np.trace(found["time_covariance"], axis1=-2, axis2=-1), J)
    for c, d, l, m in [(0, 0, 0, 0), (1, 2, 1, 0)]:
        product = np.kron(found["time_covariance"][c, d], found["taxel_covariance"][c, d, l, m])
        np.testing.assert_allclose(product, np.linalg.inv(np.kron(time[c, d], taxel[c, d, l, m])), rtol=1e-8)

    weight = rng.normal(size=(2, 3, 6, M, J, K))
    assert smooth.parameters_of({"weight": weight})["weight"].shape == (2, 3, M, J, K, 6)


@pytest.mark.slow
def test_factorised_posteriors_agree_with_nuts(rng):
    """Means lie within a fifth of the posterior's width; `matrix-normal` understates covariances of few taps."""
    taps = tiny(rng, n=12, J=2, K=2, correlation=0.6)
    trained, over_grid = fit_nuts.trained_only(taps, {"time_covariance"})
    mvn, kronecker = profile_mvn.fit(taps), matrix_normal.fit(taps)
    slopes = sample_story(
        trained.under(profile_mvn.story, **profile_mvn.arguments(trained, mvn)),
        lambda sites: over_grid(profile_mvn.parameters_of(sites)),
    )
    precisions = sample_story(
        trained.under(matrix_normal.story, prior=kronecker.prior),
        lambda sites: over_grid(matrix_normal.parameters_of(sites)),
    )
    used = np.array([[True, False], [True, True]])
    for posterior, fast, names in (
        (slopes, mvn, ("slope", "level", "variance")),
        (precisions, kronecker, ("level", "taxel_covariance")),
    ):
        assert posterior.convergence().converged
        for name in names:
            width = posterior.samples[name].std(axis=(0, 1))[used]
            gap = np.abs(posterior.point()[name] - fast.point()[name])[used]
            share = 0.6 if name == "taxel_covariance" else 0.25
            assert np.all(gap <= share * width + 1e-9), name
    time = precisions.point()["time_covariance"]
    np.testing.assert_allclose(kronecker.point()["time_covariance"], time, atol=0.05)


@pytest.mark.slow
def test_smooth_by_nuts_makes_the_same_model(rng):
    """Through the catalogue: the basis stays, and the taps are about as probable."""
    where, what = np.repeat(np.arange(3), 6), np.zeros(18, int)
    samples = np.sin(where)[:, None, None] * 3 + rng.normal(size=(18, 2, 1))
    taps = TapSet.from_arrays(
        samples, what, ["rod"], where=where.astype(float), where_unit="mm", preprocessing=Preprocessing(samples=2)
    )
    settings = FitSettings(bins=12, power="none", unconverged=True)
    fast, slow = (
        fit_model("smooth", taps, taps.grid(), settings.changed(method=method)) for method in ("closed", "nuts")
    )
    own = [fitted.model.log_likelihood(samples)[np.arange(18), where, 0].mean() for fitted in (fast, slow)]

    assert slow.model.basis.shape == fast.model.basis.shape
    assert own[1] == pytest.approx(own[0], abs=0.15)
    assert "NUTS" in slow.convergence.sentence
