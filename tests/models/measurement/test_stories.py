"""Stories and their exact posteriors: both are the same density up to one constant."""

import jax
import numpy as np
import pytest
from numpyro.infer.util import log_density
from scipy import stats
from scipy.special import gammaln
from slow_cases import slow_but
from solidtouch.models.measurement import (
    gaussian,
    histogram,
    matrix_normal,
    profile,
    profile_ar,
    profile_mvn,
    smooth,
    student,
)
from solidtouch.models.measurement.fits.priors import CellPrior, Taps
from solidtouch.models.measurement.histogram import HistogramPosterior, fit
from solidtouch.models.measurement.matrix_normal import KroneckerPrior
from solidtouch.models.measurement.smooth import CurvePrior

L, M, J, K, N = 2, 3, 4, 5, 17
DRAWS = 6


def random_taps(rng):
    """All classes but (0, 1) have taps, (0, 0) has a single one."""
    where, what = np.array([0] + [0] * 4 + [1] * 12), np.array([0] + [2] * 4 + [0, 1, 2] * 4)
    return Taps(rng.normal(size=(N, J, K)) + what[:, None, None], where, what, (L, M))


def cell_prior(strength, rng):
    return CellPrior(0.7, strength, rng.uniform(1.5, 3, K), rng.uniform(0.5, 2, K))


def joint(model, *arguments):
    """Log density of samples and parameters as a function of the parameters, compiled once."""
    compiled = jax.jit(lambda parameters: log_density(model, arguments, {}, parameters)[0])

    def log_joint(parameters):
        with jax.enable_x64(True):
            return float(compiled(parameters))

    return log_joint


def cells_log_density(cells, parameters):
    """Of the normal-inverse-gamma posterior; flat where no sample and no prior says anything."""
    level, variance = parameters["level"], parameters["variance"]
    log_density = stats.invgamma.logpdf(variance, cells.a, scale=cells.b)
    known = cells.strength > 0
    spread = np.sqrt(variance / np.where(known, cells.strength, 1.0))
    return (log_density + np.where(known, stats.norm.logpdf(level, cells.level, spread), 0.0)).sum()


@pytest.mark.parametrize("strength", [0.0, 0.6])
@pytest.mark.parametrize(("story", "fitted"), [(gaussian.story, gaussian.fit), (profile.story, profile.fit)])
def test_cells_have_the_exact_posterior(rng, story, fitted, strength):
    """Joint density over posterior density is one number, whatever the parameters; with a flat level too."""
    taps, prior = random_taps(rng), cell_prior(strength, rng)
    posterior, log_joint = fitted(taps, prior), joint(taps.under(story, prior=prior))
    constants = [
        log_joint(drawn) - cells_log_density(posterior.cells, drawn)
        for drawn in (posterior.draw(rng) for _ in range(DRAWS))
    ]

    np.testing.assert_allclose(constants, constants[0], atol=1e-8)


@pytest.mark.parametrize("strength", [0.0, 0.6])
def test_slopes_in_time_have_the_exact_posterior(rng, strength):
    """The cells given any slopes, and the slopes themselves up to the resolution of their grid."""
    taps, prior = random_taps(rng), cell_prior(strength, rng)
    posterior, log_joint = profile_ar.fit(taps, prior), joint(taps.under(profile_ar.story, prior=prior))
    constants = []
    for _ in range(DRAWS):
        index = rng.integers(20, 80, size=K)
        rho = posterior.rho[np.arange(K), index]
        cells = posterior.cells(rho)
        drawn = cells.draw(rng)
        log_weight = np.log(posterior.weight[np.arange(K), index]).sum()
        log_posterior = cells_log_density(cells, drawn) + log_weight
        constants.append(log_joint({"rho": rho, **drawn}) - log_posterior)

    np.testing.assert_allclose(constants, constants[0], atol=1e-8)


def test_histograms_have_the_exact_posterior(make_taps, rng):
    """Dirichlet with the counts added."""
    recorded = make_taps(2, 3, 4, 5, repeats=1)
    grid = recorded.grid()
    model = fit(recorded, grid, bins=6, pseudocount=0.7)
    posterior, (where, what) = HistogramPosterior.of(model), recorded.indices(grid)
    taps = Taps(recorded.taps, where, what, grid.shape)
    log_joint = joint(taps.under(histogram.story, edges=model.edges, pseudocount=0.7))
    alpha = posterior.concentration
    constants = []
    for _ in range(DRAWS):
        log_prob = posterior.draw(rng)["log_prob"]
        dirichlet = (gammaln(alpha.sum(-1)) - gammaln(alpha).sum(-1) + ((alpha - 1) * log_prob).sum(-1)).sum()
        constants.append(log_joint({"p": np.exp(log_prob)}) - dirichlet)

    np.testing.assert_allclose(constants, constants[0], atol=1e-7)


def loop_profile(taps, parameters, forecast):
    """Log probability of samples one by one."""
    total = 0.0
    for n, (l, m) in enumerate(zip(taps.where, taps.what, strict=True)):
        for j, k in np.ndindex(J, K):
            mean = parameters["level"][l, m, j, k] + forecast(n, l, m, j, k)
            total += stats.norm.logpdf(taps.samples[n, j, k], mean, np.sqrt(parameters["variance"][l, m, j, k]))
    return total


def test_taxels_are_forecast_from_those_before(rng):
    """`profile_mvn` is a loop over samples."""
    taps, prior = random_taps(rng), cell_prior(0.6, rng)
    typical, pairs = rng.normal(size=K * (K - 1) // 2), np.tril_indices(K, -1)
    parameters = {
        "slope": rng.normal(size=(L, M, len(typical))),
        "level": rng.normal(size=(L, M, J, K)),
        "variance": rng.uniform(0.5, 2, (L, M, J, K)),
    }
    matrix = np.zeros((L, M, K, K))
    matrix[..., *pairs] = parameters["slope"]
    deviation = np.sqrt(parameters["variance"] / 0.6)
    expected = (
        loop_profile(taps, parameters, lambda n, l, m, j, k: matrix[l, m, k] @ taps.samples[n, j])
        + stats.norm.logpdf(parameters["slope"], typical, 9.0**-0.5).sum()
        + stats.invgamma.logpdf(parameters["variance"], prior.a, scale=prior.b).sum()
        + stats.norm.logpdf(parameters["level"], 0.7, deviation).sum()
    )

    assert joint(taps.under(profile_mvn.story, prior=prior, typical=typical, tightness=9.0))(
        parameters
    ) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("strength", slow_but([0.4], [0.0, 0.4]))
def test_matrix_normal_is_that_of_scipy(rng, strength):
    """Time precision and taxel precisions are Wishart, levels and taps matrix normal; levels flat at strength 0."""
    taps = random_taps(rng)
    prior = KroneckerPrior(J + 3.0, _positive(rng, J), K + 4.0, _positive(rng, K), strength)
    time, taxel = _positive(rng, J), np.array([[_positive(rng, K) for _ in range(M)] for _ in range(L)])
    level = rng.normal(size=(L, M, J, K))
    rows, columns = np.linalg.inv(time), np.linalg.inv(taxel)
    expected = stats.wishart.logpdf(time, prior.time_freedom, np.linalg.inv(prior.time_scale))
    for l, m in np.ndindex(L, M):
        expected += stats.wishart.logpdf(taxel[l, m], prior.taxel_freedom, np.linalg.inv(prior.taxel_scale))
        if strength:
            expected += stats.matrix_normal.logpdf(level[l, m], np.zeros((J, K)), rows / strength, columns[l, m])
    for tap, l, m in zip(taps.samples, taps.where, taps.what, strict=True):
        expected += stats.matrix_normal.logpdf(tap, level[l, m], rows, columns[l, m])

    parameters = {"time": time, "taxel": taxel, "level": level}
    assert joint(taps.under(matrix_normal.story, prior=prior))(parameters) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("strength", slow_but([0.4], [0.0, 0.4]))
def test_covariances_of_one_sample_have_the_exact_posterior(rng, strength):
    """Story and posterior of precisions and levels differ by one constant, whatever the parameters."""
    taps = random_taps(rng)
    taps = taps._replace(samples=taps.samples[:, :1])
    prior = matrix_normal.weak_prior(1, K)._replace(
        taxel_freedom=K + 3.0, taxel_scale=_positive(rng, K), strength=strength
    )
    posterior = matrix_normal.fit(taps, prior)
    log_joint = joint(taps.under(matrix_normal.story, prior=prior))
    gaps = []
    for _ in range(DRAWS):
        parameters = posterior.draw(rng)
        sites = matrix_normal.sites_of(parameters)
        assert sites.keys() == {"level", "taxel"}
        log_posterior = 0.0
        for l, m in np.ndindex(L, M):
            inverse = np.linalg.inv(posterior.taxel_scale[l, m])
            log_posterior += stats.wishart.logpdf(sites["taxel"][l, m], posterior.taxel_freedom[l, m], inverse)
            if worth := posterior.strength[l, m]:
                spread = parameters["taxel_covariance"][l, m] / worth
                known = stats.multivariate_normal(posterior.level[l, m, 0], spread)
                log_posterior += known.logpdf(parameters["level"][l, m, 0])
        gaps.append(log_joint(sites) - log_posterior)

    np.testing.assert_allclose(gaps, gaps[0], atol=1e-7)
    assert posterior.convergence().sentence.startswith("The posterior is exact")


def _positive(rng, D):
    root = rng.normal(size=(D, D + 3))
    return root @ root.T


def test_student_and_smooth_are_loops(rng):
    """Their samples, one by one, beside the priors."""
    taps, D = random_taps(rng), 6
    tails = {
        "freedom": rng.uniform(2, 9, K),
        "spread": np.ones(K),
        "typical": np.zeros(K),
        "variety": np.ones(K),
        "level": rng.normal(size=(L, M, 1, K)),
        "scale": rng.uniform(0.5, 2, (L, M, 1, K)),
    }
    moved = {**tails, "level": tails["level"] + 0.3}

    def samples(p):
        own = taps.where, taps.what
        return stats.t.logpdf(taps.samples, p["freedom"], p["level"][own], p["scale"][own]).sum()

    prior_change = stats.norm.logpdf(moved["level"]).sum() - stats.norm.logpdf(tails["level"]).sum()
    log_joint = joint(taps.under(student.story, least=taps.least))
    change = log_joint(moved) - log_joint(tails)
    assert change == pytest.approx(samples(moved) - samples(tails) + prior_change, rel=1e-9)

    basis, prior = rng.normal(size=(N, D)), CurvePrior(rng.uniform(1, 2, (D, K)), np.full(K, 2.0), np.full(K, 1.5))
    curve = {"weight": rng.normal(size=(D, M, J, K)), "variance": rng.uniform(0.5, 2, (L, M, J, K))}
    means = np.array([np.einsum("d,djk->jk", basis[n], curve["weight"][:, taps.what[n]]) for n in range(N)])
    expected = (
        stats.norm.logpdf(taps.samples, means, np.sqrt(curve["variance"][taps.where, taps.what])).sum()
        + stats.norm.logpdf(curve["weight"], 0.0, prior.width[:, None, None]).sum()
        + stats.invgamma.logpdf(curve["variance"], 2.0, scale=1.5).sum()
    )
    assert joint(taps.under(smooth.story, basis=basis, place=np.arange(N), prior=prior))(curve) == pytest.approx(
        expected, rel=1e-9
    )


def test_first_samples_have_no_forecast(rng):
    """`profile_ar` is a loop in which the sample before the first is 0."""
    taps, prior = random_taps(rng), cell_prior(0.6, rng)
    p = {
        "rho": rng.uniform(-0.9, 0.9, K),
        "level": rng.normal(size=(L, M, J, K)),
        "variance": rng.uniform(0.5, 2, (L, M, J, K)),
    }
    expected = (
        loop_profile(taps, p, lambda n, _l, _m, j, k: p["rho"][k] * taps.samples[n, j - 1, k] if j else 0.0)
        - K * np.log(2)
        + stats.invgamma.logpdf(p["variance"], prior.a, scale=prior.b).sum()
        + stats.norm.logpdf(p["level"], 0.7, np.sqrt(p["variance"] / 0.6)).sum()
    )

    assert joint(taps.under(profile_ar.story, prior=prior))(p) == pytest.approx(expected, rel=1e-10)
