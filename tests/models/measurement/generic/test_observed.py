"""Probabilities that any distribution gives to bins."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest
from scipy import stats
from slow_cases import slow_but
from solidtouch.models.measurement.generic.observed import BINS, DENSITY, Binned, binned, elementwise, measure_of

SINGLE = {
    "Normal": lambda: (dist.Normal(0.3, 1.2), stats.norm(0.3, 1.2)),
    "StudentT": lambda: (dist.StudentT(3.0, 0.3, 1.2), stats.t(3.0, 0.3, 1.2)),
    "Laplace": lambda: (dist.Laplace(0.3, 1.2), stats.laplace(0.3, 1.2)),
    "Logistic": lambda: (dist.Logistic(0.3, 1.2), stats.logistic(0.3, 1.2)),
    "Cauchy": lambda: (dist.Cauchy(0.3, 1.2), stats.cauchy(0.3, 1.2)),
    "Gumbel": lambda: (dist.Gumbel(0.3, 1.2), stats.gumbel_r(0.3, 1.2)),
    "Gamma": lambda: (dist.Gamma(2.5, 1.5), stats.gamma(2.5, scale=1 / 1.5)),
    "LogNormal": lambda: (dist.LogNormal(0.2, 0.6), stats.lognorm(0.6, scale=np.exp(0.2))),
    "HalfNormal": lambda: (dist.HalfNormal(1.2), stats.halfnorm(scale=1.2)),
    "Beta": lambda: (dist.Beta(2.0, 3.0), stats.beta(2.0, 3.0)),
    "Uniform": lambda: (dist.Uniform(-1.0, 2.0), stats.uniform(-1.0, 3.0)),
    "Poisson": lambda: (dist.Poisson(2.7), stats.poisson(2.7)),
    "AsymmetricLaplace": lambda: (dist.AsymmetricLaplace(0.0, 1.0, 1.5), stats.laplace_asymmetric(1.5)),
    "an affine Gumbel": lambda: (
        dist.TransformedDistribution(dist.Gumbel(0.0, 1.0), dist.transforms.AffineTransform(1.0, 2.0)),
        stats.gumbel_r(1.0, 2.0),
    ),
}
TAILS = {
    "Normal": (stats.norm(0.3, 1.2), -30.0, 30.0),
    "Laplace": (stats.laplace(0.3, 1.2), -200.0, 300.0),
    "Logistic": (stats.logistic(0.3, 1.2), -200.0, 300.0),
    "StudentT": (stats.t(3.0, 0.3, 1.2), -1e5, 1e5),
    "Cauchy": (stats.cauchy(0.3, 1.2), -1e9, 1e9),
    "Gumbel": (stats.gumbel_r(0.3, 1.2), -3.0, 60.0),
    "Gamma": (stats.gamma(2.5, scale=1 / 1.5), 1e-5, 60.0),
    "HalfNormal": (stats.halfnorm(scale=1.2), 1e-12, 30.0),
}


MOST_BINS = 40


@pytest.fixture(autouse=True)
def _double():
    with jax.enable_x64(True):
        yield


held_in = jax.jit(Binned.of)


def every_bin(edges):
    """A sample in each bin, shape (1, B, 1)."""
    return held_in(0.5 * (edges[:-1] + edges[1:])[None, :, None], edges)


@jax.jit
def judged(distribution, taps, least=0.0):
    """Log probability of bins, compiled as one program for each family, as in the likelihood of a model."""
    return binned(distribution, taps, least).log_prob(taps.samples)


def log_probability(distribution, taps):
    """Of samples (1, B, 1), as many as in all tests, so that a family is compiled once."""
    B = taps.samples.shape[1]
    padded = Binned(*(np.pad(part, ((0, 0), (0, MOST_BINS - B), (0, 0)), mode="edge") for part in taps))
    return np.asarray(judged(distribution, padded))[0, :B, 0]


@pytest.mark.parametrize("name", slow_but(("Normal", "Poisson"), SINGLE))
def test_a_bin_has_the_difference_of_the_distribution_function(name):
    """And the end bins have all that is beyond them."""
    distribution, scipy = SINGLE[name]()
    edges = np.linspace(-2.0, 5.0, 29)
    inner = edges.copy()
    inner[0], inner[-1] = -np.inf, np.inf
    # A bin of integers begins with its lower edge.
    expected = np.diff(scipy.cdf(np.ceil(inner) - 1 if name == "Poisson" else inner))
    found = log_probability(distribution, every_bin(edges))

    assert elementwise(distribution)
    assert measure_of(distribution) == BINS
    np.testing.assert_allclose(np.exp(found), expected, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(np.exp(found).sum(), 1.0, rtol=1e-12)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("name", slow_but(("Normal", "StudentT", "Gumbel", "Gamma"), TAILS))
def test_bins_far_out_keep_their_digits(name, side):
    """An inner bin and an open one, where both distribution functions round to 0 or 1."""
    scipy, *places = TAILS[name]
    at = places[side]
    width = 0.1 * abs(at) if abs(at) > 1e3 or abs(at) < 1e-3 else 0.1
    edges = np.array([at - width, at, at + width, at + 2 * width]) - (width if side == 0 else 0.0)
    if name in ("Gamma", "HalfNormal") and side == 0:
        edges = np.maximum(edges, 0.0)[1:]
    found = log_probability(SINGLE[name]()[0], every_bin(edges))
    inner = len(found) // 2 if len(found) > 2 else 1
    log_cdf, log_sf = scipy.logcdf(edges), scipy.logsf(edges)
    high = log_cdf[inner + 1] > log_sf[inner]
    a, b = (log_sf[inner], log_sf[inner + 1]) if high else (log_cdf[inner + 1], log_cdf[inner])
    if 0 < inner < len(found) - 1:
        np.testing.assert_allclose(found[inner], a + np.log(-np.expm1(b - a)), rtol=3e-5)
    outer, expected = (found[-1], log_sf[-2]) if side else (found[0], log_cdf[1])
    np.testing.assert_allclose(outer, expected, rtol=2e-3, atol=0.03)


WIDE = {
    "Poisson": lambda: (dist.Poisson(10.0), stats.poisson(10.0), np.linspace(0.0, 126.0, 11), 1e-6),
    "many integers": lambda: (dist.Poisson(2000.0), stats.poisson(2000.0), np.linspace(0.0, 4000.0, 41), 1e-4),
    "negative binomial": lambda: (
        dist.NegativeBinomial2(23.0, 48.0),
        stats.nbinom(48, 48 / 71),
        np.linspace(0.0, 200.0, 21),
        1e-5,
    ),
    "Gamma": lambda: (dist.Gamma(3.0, 1.0), stats.gamma(3.0), np.linspace(-5.0, 300.0, 11), 1e-4),
    "Gumbel": lambda: (dist.Gumbel(0.0, 0.3), stats.gumbel_r(0.0, 0.3), np.linspace(-3.0, 60.0, 11), 1e-6),
    "Weibull": lambda: (dist.Weibull(1.0, 2.0), stats.weibull_min(2.0), np.linspace(0.0, 30.0, 11), 1e-3),
    "Beta": lambda: (dist.Beta(80.0, 90.0), stats.beta(80.0, 90.0), np.linspace(0.0, 1.0, 11), 1e-3),
    "LogNormal": lambda: (dist.LogNormal(0.0, 0.5), stats.lognorm(0.5), np.linspace(0.0, 300.0, 11), 1e-2),
}
"""Distributions that fall by many powers of ten within a bin: with SciPy's, edges and the error allowed in nats."""


@pytest.mark.parametrize("name", slow_but([*WIDE][:2], WIDE))
def test_improbable_bins_that_are_wide_keep_their_digits(name):
    """All bins of all samples, down to those of probability e^-700, by SciPy's logs or sums over integers."""
    distribution, scipy, edges, allowed = WIDE[name]()
    if distribution.is_discrete:
        first = np.ceil(np.append(edges[:-1], edges[-1] + 4000)).astype(int)
        expected = [np.logaddexp.reduce(scipy.logpmf(np.arange(*ends))) for ends in itertools.pairwise(first)]
    else:
        opened = np.concatenate([[-np.inf], edges[1:-1], [np.inf]])
        below, above = scipy.logcdf(opened), scipy.logsf(opened)
        with np.errstate(divide="ignore", invalid="ignore"):
            left, right = (
                below[1:] + np.log(-np.expm1(below[:-1] - below[1:])),
                above[:-1] + np.log(-np.expm1(above[1:] - above[:-1])),
            )
        expected = np.where(below[1:] > above[:-1], right, left)
    found = log_probability(distribution, every_bin(edges))
    far = np.asarray(expected) < -20.0

    assert far.any()
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=allowed)


COUNTS = {
    "zero-inflated": lambda: (
        dist.ZeroInflatedPoisson(0.3, 4.0),
        lambda n: 0.3 * (n == 0) + 0.7 * stats.poisson(4.0).pmf(n),
    ),
    "geometric": lambda: (dist.Geometric(0.2), stats.geom(0.2, loc=-1).pmf),
    "binomial": lambda: (dist.Binomial(12, 0.3), stats.binom(12, 0.3).pmf),
    "beta-binomial": lambda: (dist.BetaBinomial(2.0, 3.0, 12), stats.betabinom(12, 2.0, 3.0).pmf),
    "categories": lambda: (
        dist.Categorical(jnp.array([0.1, 0.2, 0.3, 0.4])),
        lambda n: np.where(n < 4, 0.1 * (n + 1), 0),
    ),
    "mixture": lambda: (
        dist.MixtureSameFamily(dist.Categorical(jnp.array([0.4, 0.6])), dist.Geometric(jnp.array([0.3, 0.6]))),
        lambda n: 0.4 * stats.geom(0.3, loc=-1).pmf(n) + 0.6 * stats.geom(0.6, loc=-1).pmf(n),
    ),
}
"""Distributions of integers without a distribution function, and the probabilities of integers."""


@pytest.mark.parametrize("name", COUNTS)
def test_integers_without_a_distribution_function_are_summed(name):
    """A bin has the probability of the integers in it, however many; the last one that of all beyond."""
    counts, pmf = COUNTS[name]()
    for edges in (np.linspace(-0.25, 10.25, 22), np.linspace(-0.5, 10.5, 4), np.array([-0.5, 10.5])):
        first = np.ceil(np.append(edges[:-1], 300)).astype(int)
        expected = np.array([pmf(np.arange(*ends)).sum() for ends in itertools.pairwise(first)])
        np.testing.assert_allclose(np.exp(log_probability(counts, every_bin(edges))), expected, rtol=1e-5, atol=1e-9)

    assert measure_of(counts) == BINS


def test_what_the_support_excludes_is_impossible():
    found = log_probability(dist.Gamma(2.0, 1.0), every_bin(np.array([-3.0, -2.0, -1.0, 0.0, 0.5, 1.0])))

    assert np.isneginf(found[:3]).all()
    assert np.isfinite(found[3:]).all()


def test_a_mixture_of_families_has_bins_where_all_parts_have():
    parts = dist.MixtureGeneral(dist.Categorical(jnp.array([0.3, 0.7])), [dist.Normal(0.0, 1.0), dist.Normal(3.0, 0.5)])
    edges = np.linspace(-4.0, 6.0, 21)
    opened = np.concatenate([[-np.inf], edges[1:-1], [np.inf]])
    expected = 0.3 * np.diff(stats.norm.cdf(opened)) + 0.7 * np.diff(stats.norm(3.0, 0.5).cdf(opened))

    np.testing.assert_allclose(np.exp(log_probability(parts, every_bin(edges))), expected, rtol=1e-6, atol=1e-12)


def test_components_of_a_gaussian_vector_are_taken_in_turn(rng):
    """Each has the probability of its bin given the exact samples before it."""
    J, K = 4, 3
    root = np.tril(rng.normal(size=(K, K)) * 0.5) + 1.5 * np.eye(K)
    loc, taps, edges = rng.normal(size=K), rng.normal(size=(1, J, K)), np.linspace(-3, 3, 13)
    held = held_in(taps, edges)
    found = judged(dist.MultivariateNormal(loc, scale_tril=root), held)
    covariance = root @ root.T
    lower, upper = (np.asarray(part)[0] for part in (held.lower, held.upper))
    expected = np.zeros(J)
    for k in range(K):
        gain = covariance[k, :k] @ np.linalg.inv(covariance[:k, :k]) if k else np.zeros(0)
        mean = loc[k] + (taps[0, :, :k] - loc[:k]) @ gain
        deviation = np.sqrt(covariance[k, k] - gain @ covariance[:k, k])
        forecast = stats.norm(mean, deviation)
        expected += np.log(forecast.cdf(upper[:, k]) - forecast.cdf(lower[:, k]))

    np.testing.assert_allclose(found[0], expected, rtol=1e-9)


def test_a_random_walk_steps_from_the_sample_before(rng):
    samples, edges = rng.normal(size=(1, 2, 6)), np.linspace(-3, 3, 13)
    held = jax.jit(lambda taps: Binned.of(taps, edges).swapped())(samples.mT)
    found = judged(dist.GaussianRandomWalk(jnp.array([0.7, 1.3]), 6), held)
    before = np.concatenate([np.zeros((1, 2, 1)), samples[..., :-1]], axis=-1)
    step = stats.norm(before, np.array([0.7, 1.3])[:, None])

    expected = np.log(step.cdf(np.asarray(held.upper)) - step.cdf(np.asarray(held.lower))).sum(axis=-1)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.slow
def test_other_vectors_have_their_density_times_the_widths_of_their_bins(rng):
    taps, edges = rng.normal(size=(1, 4, 3)), np.cumsum(rng.uniform(0.2, 0.9, size=13)) - 4
    held = held_in(taps, edges)
    vector = dist.MultivariateStudentT(4.0, jnp.zeros(3), jnp.eye(3))
    width = np.diff(edges)[np.clip(np.searchsorted(edges, taps, "right") - 1, 0, 11)]

    assert measure_of(vector) == DENSITY
    found = judged(vector, held)
    density = jax.jit(type(vector).log_prob)(vector, taps)
    np.testing.assert_allclose(found, density + np.log(width).sum(axis=-1), rtol=1e-12)


def test_no_scale_counts_for_less_than_the_least():
    taps = every_bin(np.linspace(-1.0, 1.0, 5))

    least = judged(dist.Normal(0.0, 1e-9), taps, 0.2)
    np.testing.assert_allclose(least, judged(dist.Normal(0.0, 0.2), taps))
