"""Building blocks of generative models."""

import jax
import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
import pytest
from numpyro.infer import Trace_ELBO
from solidtouch.models.measurement.fits.story_parts import EvidenceBound


def test_evidence_bound_is_that_of_numpyro():
    def story(x):
        a = numpyro.sample("a", dist.Normal(0.0, 1.0))
        b = numpyro.sample("b", dist.Gamma(2.0, 3.0))
        numpyro.sample("x", dist.Normal(a, b), obs=x)

    def guide(_):
        numpyro.sample("b", dist.LogNormal(numpyro.param("m", 0.0), 0.5))
        numpyro.sample("a", dist.Normal(numpyro.param("l", 0.0), 0.3))

    taps = jnp.array([1.5, -0.3])

    def losses(key, at):
        bounds = EvidenceBound(), Trace_ELBO()
        return [jax.value_and_grad(bound.loss, argnums=1)(key, at, story, guide, taps) for bound in bounds]

    own, theirs = jax.jit(losses)(jax.random.key(3), {"m": jnp.array(-0.4), "l": jnp.array(0.2)})
    own, theirs = (
        {"loss": float(loss)} | {name: float(slope) for name, slope in to.items()} for loss, to in (own, theirs)
    )
    assert own == pytest.approx(theirs, rel=1e-5)
