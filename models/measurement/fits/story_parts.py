"""Building blocks of generative models; imported only when one runs, as JAX and NumPyro take seconds to load."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
from numpyro.handlers import replay, seed
from numpyro.infer.elbo import ELBO
from numpyro.infer.util import log_density

from .priors import CellPrior


def cells(prior: CellPrior) -> tuple[Any, Any]:
    """Level and variance of every cell of the surrounding plates."""
    variance: Any = numpyro.sample("variance", dist.InverseGamma(prior.a, prior.b))
    flat = dist.ImproperUniform(dist.constraints.real, (), ())
    known = dist.Normal(prior.level, jnp.sqrt(variance / (prior.strength or 1.0)))
    return numpyro.sample("level", known if prior.strength else flat), variance


def chain(given: Callable[[Any], Any], taps: Any, shape: tuple[int, int, int], steps: int) -> None:
    """Samples that are each normal given those before them.

    Args:
        given: From samples (N, J, K) to the normal distribution of each, which depends on those before it.
        taps: The samples; `None` to draw them one after another.
        shape: (N, J, K).
        steps: Longest chain of samples that depend on each other.
    """
    if taps is None:
        key: Any = numpyro.prng_key()
        noise = jax.random.normal(key, shape)
        taps = jax.lax.fori_loop(0, steps, lambda _, drawn: given(drawn).loc + given(drawn).scale * noise, 0.0 * noise)
    numpyro.sample("taps", given(taps), obs=taps)


class EvidenceBound(ELBO):
    """As NumPyro's `Trace_ELBO`, but its program is the same in every process; that follows the order of a set."""

    def loss(self, rng_key: Any, param_map: Any, model: Any, guide: Any, *args: Any, **kwargs: Any) -> Any:
        """The bound of one draw of the guide, negative."""
        drawn = seed(guide, jax.random.split(rng_key)[1])
        log_guide, found = log_density(drawn, args, kwargs, param_map)
        log_joint, _ = log_density(replay(model, found), args, kwargs, param_map)
        return log_guide - log_joint


class Histogram(dist.Distribution):
    """Samples that are uniform within bins; the density of end bins goes on beyond them.

    Args:
        probs: Probabilities of the bins, shape (..., K, B).
        edges: Their edges, shape (B + 1,) or (K, B + 1).
    """

    arg_constraints = {"probs": dist.constraints.simplex, "edges": dist.constraints.real_vector}  # noqa: RUF012
    support = dist.constraints.real  # pyright: ignore

    def __init__(self, probs: Any, edges: Any) -> None:
        self.probs, self.edges = probs, jnp.asarray(edges)
        super().__init__(jnp.shape(probs)[:-1])

    def sample(self, key: Any, sample_shape: tuple[int, ...] = ()) -> Any:
        """Samples of shape (*sample_shape, ..., K)."""
        bins: Any = dist.CategoricalProbs(self.probs).sample(key, sample_shape)
        drawn = bins[..., None] == jnp.arange(self.probs.shape[-1])
        share = jax.random.uniform(jax.random.fold_in(key, 1), bins.shape)
        return (drawn * (self.edges[..., :-1] + share[..., None] * jnp.diff(self.edges))).sum(axis=-1)

    def log_prob(self, value: Any, intermediates: object = None) -> Any:  # noqa: ARG002
        """Log density."""
        lower = self.edges[..., :-1].at[..., 0].set(-jnp.inf)
        upper = self.edges[..., 1:].at[..., -1].set(jnp.inf)
        inside = (value[..., None] >= lower) & (value[..., None] < upper)
        return jnp.log(jnp.where(inside, self.probs / jnp.diff(self.edges), 0.0).sum(axis=-1))

    def cdf(self, value: Any) -> Any:
        """Distribution function, as if samples beyond the bins were at their ends."""
        share = (value[..., None] - self.edges[..., :-1]) / jnp.diff(self.edges)
        return (self.probs * share.clip(0.0, 1.0)).sum(axis=-1)


class plates:  # noqa: N801 - used like numpyro.plate
    """Nested NumPyro plates from names, sizes and dims."""

    def __init__(self, *plates: tuple[str, int, int]) -> None:
        self._plates = [numpyro.plate(name, size, dim=dim) for name, size, dim in plates]

    def __enter__(self) -> None:
        for plate in self._plates:
            plate.__enter__()

    def __exit__(self, *error: Any) -> None:
        for plate in reversed(self._plates):
            plate.__exit__(*error)
