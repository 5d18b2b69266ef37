"""NUTS on the stories of tiny sets: it says when it did not converge; `test_laws` compares it with the fast fits."""

import arviz as az
import numpy as np
import pytest
from solidtouch.models.measurement import matrix_normal, profile, profile_mvn, smooth
from solidtouch.models.measurement.fits import nuts as fit_nuts
from solidtouch.models.measurement.fits.nuts import sample_story
from solidtouch.models.measurement.fits.posterior import SamplePosterior
from solidtouch.models.measurement.fits.priors import Taps

L, M, J, K = 2, 2, 3, 4


def tiny(rng, n=5):
    """Taps of all classes but (0, 1)."""
    where, what = (index.ravel() for index in np.indices((L, M, n))[:2])
    used = (where > 0) | (what == 0)
    where, what = where[used], what[used]
    return Taps(rng.normal(size=(len(where), J, K)) + what[:, None, None], where, what, (L, M))


@pytest.mark.slow
def test_diagnostics_are_the_worst_of_all_sites(rng):
    """Of those that ArviZ finds; a class that no tap trained has parameters, too."""
    taps = tiny(rng)
    trained, over_grid = fit_nuts.trained_only(taps)
    kept = {}

    def keep(sites):
        kept.update(sites)
        return over_grid(sites)

    told = trained.under(profile.story, prior=profile.fit(taps).prior)
    bars = []

    def progress(name, steps):
        bars.append([f"{name}: {steps}"])
        return bars[-1].append

    posterior = sample_story(told, keep, 3, 160, progress, "profile")

    assert bars == [["profile, steps of chains: 160", *[1] * 160]]
    assert trained.shape == (3, 1)
    assert {values.shape for values in posterior.samples.values()} == {(4, 54, L, M, J, K)}
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
