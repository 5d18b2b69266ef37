"""Models run at given latent variables."""

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from numpyro.contrib.control_flow import scan
from scipy import stats
from solidtouch.models.measurement.generic.contract import StoryCall, StoryFunction
from solidtouch.models.measurement.generic.form import GenericForm
from solidtouch.models.measurement.generic.runs import Given, Program
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.measurement.scaling import Scaling

M, J, K = 2, 3, 1


def drifting(where, what, taps=None, *, M, J, K):
    """Levels of an object that drift along a tap."""

    def step(before, _):
        now = numpyro.sample("drift", dist.Normal(before, 1.0))
        return now, now

    with numpyro.plate("M", M):
        level = numpyro.sample("level", dist.Normal(0.0, 3.0))
    loc = level[what][:, None, None] + scan(step, 0.0, None, length=J)[1][:, None]
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
        numpyro.sample("taps", dist.Normal(loc, 1.0), obs=taps)


def test_latent_variables_may_be_drawn_in_a_scan():
    story, index = StoryFunction.of(drifting, "drifting"), np.arange(M)
    batch = StoryCall(*np.zeros((2, 0), dtype=int), (1, M, J, K), jnp.zeros(1))
    level, drift = np.array([-1.0, 0.5]), np.array([0.2, -0.3, 1.1])
    given = Given({"level": level, "drift": drift})
    form = GenericForm(Program(story, structure_of(story, batch), batch), (given,), Scaling(np.zeros(K), np.ones(K)))
    edges, bins = np.linspace(-4.0, 4.0, 9), np.array([[3, 2, 6], [5, 4, 1]])

    found = form.own((edges[bins] + 0.5)[..., None], edges[None], 0 * index, index)
    normal = stats.norm(level[:, None] + drift)
    np.testing.assert_allclose(found, np.log(normal.cdf(edges[bins + 1]) - normal.cdf(edges[bins])).sum(axis=1))
