"""Generative models as users write them, for tests of the contract; some are those of docs/how-to/your-own-model.md."""

import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist

from benchmarks.own_stories import stories

laplace, two_levels, walk, shifted = stories().values()


def normal(where, what, taps=None, *, L, M, J, K):
    """The built-in model `gaussian`, with other priors."""
    with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
        level = numpyro.sample("level", dist.Normal(0.0, 3.0))
        variance = numpyro.sample("variance", dist.InverseGamma(2.0, 2.0))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        own = level[where, what][:, None], jnp.sqrt(variance[where, what])[:, None]
        numpyro.sample("taps", dist.Normal(*own), obs=taps)


def levels(where, what, taps=None, *, L, M, J, K):
    """A level at each time."""
    classes = numpyro.plate("L", L, dim=-4), numpyro.plate("M", M, dim=-3)
    with classes[0], classes[1], numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
        level = numpyro.sample("level", dist.Normal(0.0, 3.0))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
        numpyro.sample("taps", dist.Normal(level[where, what], 1.0), obs=taps)


def correlated(where, what, taps=None, *, L, M, J, K):
    """Correlated taxels around the level of a class."""
    with numpyro.plate("L", L, dim=-2), numpyro.plate("M", M, dim=-1):
        loc = numpyro.sample("loc", dist.Normal(0.0, 3.0).expand([K]).to_event(1))
    root = numpyro.sample("root", dist.LKJCholesky(K, 2.0))
    with numpyro.plate("tap", len(where), dim=-2), numpyro.plate("J", J, dim=-1):
        numpyro.sample("taps", dist.MultivariateNormal(loc[where, what][:, None], scale_tril=root), obs=taps)


def heavy(where, what, taps=None, *, L, M, J, K):
    """Taxels of a sample follow a multivariate Student's t, which has no distribution function."""
    with numpyro.plate("L", L, dim=-2), numpyro.plate("M", M, dim=-1):
        loc = numpyro.sample("loc", dist.Normal(0.0, 3.0).expand([K]).to_event(1))
    with numpyro.plate("tap", len(where), dim=-2), numpyro.plate("J", J, dim=-1):
        numpyro.sample("taps", dist.MultivariateStudentT(4.0, loc[where, what][:, None], jnp.eye(K)), obs=taps)


def counts(where, what, taps=None, *, L, M, J, K):
    """Poisson counts."""
    with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
        rate = numpyro.sample("rate", dist.Gamma(2.0, 0.5))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.Poisson(rate[where, what][:, None]), obs=taps)


counts.raw = True


def alike(where, what, taps=None, *, L, M, J, K):
    """Wrong on purpose: samples do not depend on the class."""
    with numpyro.plate("K", K, dim=-1):
        loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
        numpyro.deterministic("twice", 2 * loc)
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.Normal(loc, 3.0), obs=taps)
