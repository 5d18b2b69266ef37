"""Draws made from even points."""

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from scipy import stats
from scipy.integrate import quad
from solidtouch.models.measurement.generic import sessions
from solidtouch.models.measurement.generic.contract import StoryCall, StoryFunction
from solidtouch.models.measurement.generic.quantiles import at_quantiles
from solidtouch.models.measurement.generic.runs import Program
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.seeds import Purpose, generator

KNOWN = {
    "Normal": (lambda: dist.Normal(0.5, 2.0), stats.norm(0.5, 2.0)),
    "StudentT": (lambda: dist.StudentT(3.0, 0.5, 2.0), stats.t(3.0, 0.5, 2.0)),
    "heavy StudentT": (lambda: dist.StudentT(0.7), stats.t(0.7)),
    "Gamma": (lambda: dist.Gamma(2.0, 3.0), stats.gamma(2.0, scale=1 / 3)),
    "steep Gamma": (lambda: dist.Gamma(0.1), stats.gamma(0.1)),
    "Beta": (lambda: dist.Beta(2.0, 0.5), stats.beta(2.0, 0.5)),
    "InverseGamma": (lambda: dist.InverseGamma(3.0, 2.0), stats.invgamma(3.0, scale=2.0)),
    "Weibull": (lambda: dist.Weibull(2.0, 1.5), stats.weibull_min(1.5, scale=2.0)),
    "minus Gamma": (
        lambda: dist.TransformedDistribution(dist.Gamma(2.0), dist.transforms.AffineTransform(1.0, -3.0)),
        None,
    ),
    "folded StudentT": (lambda: dist.FoldedDistribution(dist.StudentT(3.0)), None),
    "mixture": (lambda: dist.MixtureSameFamily(dist.Categorical(jnp.array([0.3, 0.7])), dist.Normal(TWO, 1.0)), None),
}
TWO = np.array([-2.0, 2.0])
QUANTILES = np.array([1e-6, 0.01, 0.2, 0.4999, 0.7, 0.99, 1 - 1e-6])


@pytest.fixture(scope="module")
def found():
    """Values at quantiles by name, all by one program."""
    with jax.enable_x64(True):
        made = jax.jit(lambda q: {name: at_quantiles(own().expand(q.shape), q) for name, (own, _) in KNOWN.items()})
        return {name: np.asarray(values) for name, values in made(jnp.asarray(QUANTILES)).items()}


def minus_gamma(q):
    return 1.0 - 3.0 * stats.gamma.isf(q, 2.0)


def mixture(x):
    return 0.3 * stats.norm.cdf(x, TWO[0]) + 0.7 * stats.norm.cdf(x, TWO[1])


@pytest.mark.parametrize("name", [name for name, (_, exact) in KNOWN.items() if exact is not None])
def test_quantiles_are_those_of_scipy(name, found):
    np.testing.assert_allclose(found[name], KNOWN[name][1].ppf(QUANTILES), rtol=1e-9, atol=1e-12)


def test_quantiles_of_made_distributions(found):
    np.testing.assert_allclose(found["minus Gamma"], minus_gamma(QUANTILES), rtol=1e-9)
    np.testing.assert_allclose(found["folded StudentT"], stats.t.ppf(0.5 + 0.5 * QUANTILES, 3.0), 1e-9, 1e-9)
    np.testing.assert_allclose(mixture(found["mixture"]), QUANTILES, rtol=1e-9)


@pytest.mark.slow
def test_vectors_are_made_of_independent_numbers():
    """Of even points: their moments are nearly those of the distribution."""
    points = stats.qmc.Sobol(3, rng=np.random.default_rng(0)).random(1024)
    covariance = np.array([[2.0, 0.6, 0.1], [0.6, 1.0, -0.4], [0.1, -0.4, 0.5]])
    mean, weight = np.array([1.0, -1.0, 0.0]), np.array([0.5, 2.0, 4.0])

    @jax.jit
    def made(points):
        lower = dist.transforms.LowerCholeskyAffine(mean, jnp.linalg.cholesky(covariance))
        normal = dist.MultivariateNormal(mean, covariance).expand([1024])
        same = dist.TransformedDistribution(dist.Normal(0.0, 1.0).expand([1024, 3]).to_event(1), lower)
        dirichlet = dist.Dirichlet(weight).expand([1024])
        return [at_quantiles(distribution, points) for distribution in (normal, same, dirichlet)]

    with jax.enable_x64(True):
        vectors, also, shares = map(np.asarray, made(points))

    np.testing.assert_allclose(vectors.mean(axis=0), mean, atol=5e-3)
    np.testing.assert_allclose(np.cov(vectors.T), covariance, atol=0.02)
    np.testing.assert_allclose(also, vectors, rtol=1e-9)
    exact = stats.dirichlet(weight)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    np.testing.assert_allclose(shares.mean(axis=0), exact.mean(), atol=2e-3)
    np.testing.assert_allclose(np.cov(shares.T), exact.cov(), atol=2e-3)


def test_there_are_distributions_without_a_way():
    assert at_quantiles(dist.VonMises(0.0, 1.0), 0.3) is None
    assert at_quantiles(dist.LKJCholesky(3, 1.0), 0.3) is None


def story(where, what, taps=None, *, J, K, session):
    with numpyro.plate("S", int(session.max()) + 1):
        moved = numpyro.sample("t", dist.StudentT(3.0, 0.5, 1.0)) + numpyro.sample("b", dist.Beta(2.0, 5.0))
        scale = numpyro.sample("g", dist.Gamma(2.0, 3.0))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
        own = moved[session][:, None, None], scale[session][:, None, None]
        numpyro.sample("taps", dist.Normal(*own), obs=taps)


@pytest.fixture(scope="module")
def drawn():
    """New sessions by variable, 8 times 128, evenly spread and plainly drawn."""
    batch = StoryCall(*np.zeros((2, 0), dtype=int), (2, 2, 2, 2), np.arange(2), session=np.zeros(0, dtype=int))
    function, latents = StoryFunction.of(story, "story"), dict.fromkeys("tbg", np.array([0.3, 0.4]))
    program = Program(function, structure_of(function, batch, 2), batch, 2)

    def new(plain):
        own = [[generator(number, Purpose.NEW_SESSION, d) for d in range(128)] for number in range(8)]
        if plain:
            each = [[sessions.with_new_session(program, latents, one) for one in of_one] for of_one in own]
        else:
            points = [sessions.session_points(program, latents, 128, of_one[0])[0] for of_one in own]
            given = zip([[latents] * 128] * 8, own, points, strict=True)
            each = [list(sessions.in_new_sessions(program, *of_one)) for of_one in given]
        return {name: np.array([[one[name][-1] for one in of_one] for of_one in each]) for name in latents}

    return new(False), new(True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "exact"),
    [("t", stats.t(3.0, 0.5, 1.0)), ("b", stats.beta(2.0, 5.0)), ("g", stats.gamma(2.0, scale=1 / 3))],
)
def test_integrals_over_sessions_are_more_exact_than_by_plain_draws(name, exact, drawn):
    def likely(x):
        return np.exp(-0.5 * ((x - 0.7) / 0.4) ** 2)

    true = quad(lambda q: likely(exact.ppf(q)), 0.0, 1.0)[0]
    even, plain = (np.sqrt(np.mean((likely(of[name]).mean(axis=1) - true) ** 2)) for of in drawn)
    assert plain < 0.1 * true
    assert even < plain / 30
