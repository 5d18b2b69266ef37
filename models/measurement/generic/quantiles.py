"""Random variables as functions of uniform numbers, so that even points of a cube become even draws."""

from typing import Any

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax.scipy.special import ndtri
from numpyro.distributions import biject_to, constraints

from ..fits.present import peeled

_HALVINGS, _REACH = 64, 700.0  # of an interval of unconstrained values, whose exponentials are numbers


def at_quantiles(distribution: Any, quantile: Any) -> jax.Array | None:
    """Values of a distribution made from one uniform number for each of theirs, of the shape of the distribution.

    A number is the quantile of its distribution, which is inverted where NumPyro has the distribution function alone.
    Vectors are made of quantiles of independent numbers. `None` where there is no such way.

    Args:
        distribution: A continuous distribution.
        quantile: Between 0 and 1, broadcast over the batch shape.
    """
    found = _made(peeled(distribution), jnp.asarray(quantile))
    return None if found is None else jnp.broadcast_to(found, distribution.shape())


def _made(base: Any, quantile: jax.Array) -> jax.Array | None:
    if base.event_dim:
        return _vector(base, quantile)
    for way in (lambda: base.icdf(quantile), lambda: _inverted(base, quantile)):
        try:
            return way()
        except (NotImplementedError, ImportError):  # ImportError for those that need another package
            continue
    return None


def _vector(base: Any, quantile: jax.Array) -> jax.Array | None:
    if isinstance(base, dist.MultivariateNormal | dist.LowRankMultivariateNormal):
        lower = jnp.linalg.cholesky(base.covariance_matrix)
        return base.loc + (lower @ ndtri(quantile)[..., None])[..., 0]
    if isinstance(base, dist.Dirichlet):
        parts = _made(dist.Gamma(base.concentration), quantile)
        return None if parts is None else parts / parts.sum(axis=-1, keepdims=True)
    if isinstance(base, dist.TransformedDistribution) and base.base_dist.shape() == base.shape():
        values: Any = _made(peeled(base.base_dist), quantile)
        for transform in base.transforms if values is not None else ():
            values = transform(values)
        return values
    return None


def _inverted(base: Any, quantile: jax.Array) -> jax.Array:
    """Values at which a distribution function has given values, by halving an interval of unconstrained ones."""
    to_support = biject_to(base.support)
    real = base.support is constraints.real

    def at(loose: Any) -> jax.Array:
        return to_support(jnp.sinh(loose) if real else loose)

    way = jnp.sign(at(jnp.ones(())) - at(-jnp.ones(())))  # down where a support has no lower end

    def halved(_: Any, ends: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        below = _cdf(base, at(way * middle)) < quantile
        return jnp.where(below, middle, low), jnp.where(below, high, middle)

    shape = jnp.broadcast_shapes(jnp.shape(quantile), base.batch_shape)
    ends = jnp.full(shape, -_REACH), jnp.full(shape, _REACH)
    low, high = jax.lax.fori_loop(0, _HALVINGS, halved, ends)
    return at(way * 0.5 * (low + high))


def _cdf(base: Any, at: jax.Array) -> jax.Array:
    if isinstance(base, dist.FoldedDistribution):
        return base.base_dist.cdf(at) - base.base_dist.cdf(-at)
    return base.cdf(at)
