"""Densities and probabilities of intervals of distributions with bounds, made of others or masked, by SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest
from scipy import integrate, stats
from slow_cases import slow_but
from solidtouch.models.measurement.generic.interval import (
    has_probabilities,
    inside,
    is_bounded,
    log_density,
    log_interval,
)
from solidtouch.models.measurement.generic.observed import DENSITY, Binned, binned, measure_of

EDGES = np.linspace(-6.0, 14.0, 41)  # 1.3 is within a bin
BASES = {
    "Exponential": lambda: (dist.Exponential(0.8), stats.expon(scale=1 / 0.8)),
    "Gamma": lambda: (dist.Gamma(2.5, 1.5), stats.gamma(2.5, scale=1 / 1.5)),
    "HalfNormal": lambda: (dist.HalfNormal(1.2), stats.halfnorm(scale=1.2)),
    "HalfCauchy": lambda: (dist.HalfCauchy(1.2), stats.halfcauchy(scale=1.2)),
    "LogNormal": lambda: (dist.LogNormal(0.2, 0.6), stats.lognorm(0.6, scale=np.exp(0.2))),
    "Weibull": lambda: (dist.Weibull(1.4, 1.5), stats.weibull_min(1.5, scale=1.4)),
    "Beta": lambda: (dist.Beta(2.0, 3.0), stats.beta(2.0, 3.0)),
    "Uniform": lambda: (dist.Uniform(0.0, 2.0), stats.uniform(0.0, 2.0)),
    "InverseGamma": lambda: (dist.InverseGamma(3.0, 2.0), stats.invgamma(3.0, scale=2.0)),
    "Pareto": lambda: (dist.Pareto(1.2, 3.0), stats.pareto(3.0, scale=1.2)),
}


@pytest.fixture(autouse=True)
def _double():
    with jax.enable_x64(True):
        yield


def opened(edges):
    return np.concatenate([[-np.inf], edges[1:-1], [np.inf]])


def by_scipy(scipy, edges):
    """Log probability of intervals, from the side where distribution functions are smaller."""
    left, right = np.diff(scipy.cdf(edges)), -np.diff(scipy.sf(edges))
    with np.errstate(divide="ignore"):
        return np.log(np.where(scipy.cdf(edges[:-1]) > 0.5, right, left))


@jax.jit
def between(distribution, edges):
    """Log probability of the intervals between edges, one program for each family."""
    return log_interval(distribution, edges[:-1], edges[1:])


@jax.jit
def at_bins(distribution, taps):
    return binned(distribution, taps).log_prob(taps.samples)


@pytest.mark.parametrize("name", slow_but([*BASES][:3], BASES))
def test_a_shifted_distribution_has_no_probability_below_its_floor(name):
    """The bin of the floor has what is above it; a falling transform swaps the sides."""
    base, scipy = BASES[name]()
    edges = opened(EDGES)
    affine = dist.transforms.AffineTransform(jnp.array([[1.3], [1.3]]), jnp.array([[1.0], [-1.0]]))
    both = dist.TransformedDistribution(base, affine)
    found_both = np.asarray(between(both, edges))
    rising, falling = by_scipy(scipy, edges - 1.3), by_scipy(scipy, (1.3 - edges)[::-1])[::-1]

    assert np.isneginf(rising[:13]).all()
    np.testing.assert_allclose(found_both, [rising, falling], rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(np.exp(found_both).sum(axis=1), 1.0, rtol=1e-9)


@pytest.mark.parametrize("name", BASES)
def test_a_density_is_zero_outside_of_the_support_and_has_finite_derivatives(name):
    base, scipy = BASES[name]()
    at = np.array([-3.0, 1.25, 1.7, 2.9, 4.0])

    def density(floor):
        shifted = dist.TransformedDistribution(base, dist.transforms.AffineTransform(floor, 1.0))
        return log_density(shifted, at), inside(shifted, at), is_bounded(shifted)

    (values, there, bounded), change = jax.jit(lambda: jax.jvp(density, (1.3,), (1.0,)))()

    np.testing.assert_allclose(values, scipy.logpdf(at - 1.3), rtol=2e-6)
    np.testing.assert_array_equal(there, np.isfinite(scipy.logpdf(at - 1.3)))
    assert bounded
    assert np.isfinite(np.asarray(change[0])).all()


TRUNCATED = {
    "between": lambda: (
        dist.TruncatedNormal(0.3, 1.2, low=-1.1, high=3.7),
        stats.truncnorm(-1.4 / 1.2, 3.4 / 1.2, 0.3, 1.2),
    ),
    "below": lambda: (dist.TruncatedNormal(0.3, 1.2, low=9.3), stats.truncnorm(7.5, np.inf, 0.3, 1.2)),
    "above": lambda: (dist.TruncatedNormal(0.3, 1.2, high=-0.7), stats.truncnorm(-np.inf, -1.0 / 1.2, 0.3, 1.2)),
}


@pytest.mark.parametrize("name", TRUNCATED)
def test_a_truncated_distribution_keeps_its_digits_far_from_its_base(name):
    distribution, scipy = TRUNCATED[name]()
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.array([scipy.logcdf(opened(EDGES)), scipy.logsf(opened(EDGES))])
        left, right = (
            high + np.log(-np.expm1(low - high))
            for high, low in ((logs[0, 1:], logs[0, :-1]), (logs[1, :-1], logs[1, 1:]))
        )
    expected = np.where(logs[0, 1:] < logs[1, :-1], left, right)

    np.testing.assert_allclose(
        between(distribution, opened(EDGES)), np.where(np.isnan(expected), -np.inf, expected), rtol=1e-6
    )


def test_components_of_a_mixture_have_bounds_of_their_own():
    floors, weights = np.array([-1.3, 2.7]), np.array([0.3, 0.7])
    shift = dist.transforms.AffineTransform(jnp.asarray(floors), 1.0)
    one_family = dist.MixtureSameFamily(
        dist.Categorical(jnp.asarray(weights)), dist.TransformedDistribution(dist.Exponential(jnp.ones(2)), shift)
    )
    parts = [
        dist.TransformedDistribution(dist.Exponential(1.0), dist.transforms.AffineTransform(floor, 1.0))
        for floor in floors
    ]
    several = dist.MixtureGeneral(dist.Categorical(jnp.asarray(weights)), parts)
    edges, at = opened(EDGES), np.array([-2.0, 0.0, 3.0])
    each = [np.exp(by_scipy(stats.expon(floor), edges)) for floor in floors]
    densities = [stats.expon(floor).pdf(at) for floor in floors]
    with np.errstate(divide="ignore"):
        expected, density = np.log(weights @ each), np.log(weights @ densities)

    for mixture in (one_family, several):
        assert has_probabilities(mixture)
        np.testing.assert_allclose(between(mixture, edges), expected, rtol=1e-9)
        np.testing.assert_allclose(jax.jit(log_density)(mixture, at), density, rtol=1e-9)
        np.testing.assert_array_equal(jax.jit(inside)(mixture, at), [False, True, True])


@pytest.mark.slow
def test_tails_of_student_are_finite_however_far_out():
    """By quadrature of the density, whose logs do not underflow."""
    freedom, z = (grid.ravel() for grid in np.meshgrid([1.0, 3.0, 30.0, 300.0, 1e4], [5.0, 38.0, 60.0, 1e3, 1e6]))
    expected = []
    for df, at in zip(freedom, z, strict=True):
        pdf = stats.t(df).logpdf

        def fallen(u, pdf=pdf, at=at):
            return np.exp(pdf(at * (1 + u)) - pdf(at))

        length = (1 + df / at**2) / (df + 1)  # in which the density falls by a factor of about e
        inner = integrate.quad(fallen, 0.0, 20 * length, epsabs=0.0, epsrel=1e-10, limit=500)[0]
        outer = integrate.quad(fallen, 20 * length, np.inf, epsabs=0.0, epsrel=1e-8, limit=500)[0]
        expected.append(pdf(at) + np.log(at * (inner + outer)))
    right = found_in_jax(freedom, z, np.inf)

    np.testing.assert_allclose(right, expected, rtol=1e-6)
    np.testing.assert_allclose(right, found_in_jax(freedom, -np.inf, -z), rtol=1e-12)


def found_in_jax(freedom, lower, upper):
    ends = np.broadcast_arrays(np.asarray(lower, dtype=float), np.asarray(upper, dtype=float), freedom)[:2]
    return np.asarray(jax.jit(log_interval)(dist.StudentT(freedom), *ends))


held_in = jax.jit(Binned.of)


def one_tap(edges, samples):
    return held_in(samples[None, :, None], edges)


@pytest.mark.parametrize(
    "made",
    [
        lambda: dist.Normal(0.3, 1.2),
        lambda: dist.MultivariateNormal(jnp.zeros(1), jnp.eye(1)),
        lambda: dist.VonMises(0.0, 1.0),
    ],
    ids=["bins", "vector", "density"],
)
def test_a_masked_sample_counts_for_nothing(made):
    distribution = made()
    taps = one_tap(EDGES, np.array([0.2, 1.2, -0.7]))
    mask = jnp.array([True, False, True])
    each = distribution if distribution.event_dim else distribution.expand((1, 3, 1))
    plain = each if distribution.event_dim else each.to_event(1)
    masked = each.expand((1, 3)).mask(mask) if distribution.event_dim else each.mask(mask[:, None]).to_event(1)

    assert measure_of(masked) == measure_of(plain)
    expected = np.where(mask, at_bins(plain, taps), 0.0)
    np.testing.assert_allclose(at_bins(masked, taps), expected, rtol=1e-12)


def test_a_censored_sample_has_the_probability_of_all_that_it_may_be():
    samples, over = np.array([0.2, 2.6, 1.4]), np.array([False, True, False])
    right = dist.RightCensoredDistribution(dist.Normal(0.3, 1.2), over[:, None])
    left = dist.LeftCensoredDistribution(dist.Normal(0.3, 1.2), over[:, None])
    taps, normal = one_tap(EDGES, samples), stats.norm(0.3, 1.2)
    bins = by_scipy(normal, EDGES)[np.searchsorted(EDGES, samples, "right") - 1]

    assert measure_of(right) != DENSITY
    for distribution, beyond in ((right, normal.logsf), (left, normal.logcdf)):
        log_prob = np.asarray(at_bins(distribution, taps))[0, :, 0]
        np.testing.assert_allclose(log_prob, np.where(over, beyond(samples), bins), rtol=1e-9)


def test_what_is_folded_or_has_events_is_inside_as_a_whole():
    folded = dist.FoldedDistribution(dist.Normal(0.5, 1.0))
    vectors = dist.TransformedDistribution(dist.Normal(jnp.zeros(2), 1.0).to_event(1), dist.transforms.ExpTransform())
    at = np.array([[1.0, 2.0], [1.0, -2.0]])

    np.testing.assert_array_equal(jax.jit(inside)(folded, at), at > 0)
    np.testing.assert_array_equal(jax.jit(inside)(vectors, at), [True, False])
    np.testing.assert_allclose(
        jax.jit(log_density)(vectors, at), [stats.lognorm(1.0).logpdf([1.0, 2.0]).sum(), -np.inf]
    )
    assert is_bounded(folded)
    assert is_bounded(vectors)
    assert not is_bounded(dist.MultivariateNormal(jnp.zeros(2), jnp.eye(2)))
