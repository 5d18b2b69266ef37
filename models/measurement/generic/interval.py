"""Density and probability of intervals, also of distributions that are made of others.

Distributions of NumPyro are defined within their support alone: outside, their densities and distribution functions are
any numbers. A transformed or truncated distribution and a mixture are therefore taken apart, down to distributions
whose support is known.

Differences of distribution functions lose their digits far out, where both are nearly 0 or 1. Symmetric families are
therefore mirrored to the side where they are small; for others see `tails`.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
from jax.scipy.special import betainc, gammaln, log_ndtr, logsumexp
from jax.typing import ArrayLike
from numpyro.distributions import constraints

from ..fits.present import peeled
from .tails import Support, log_integral, log_sum_of_integers

_FAR = 256
_SMALL = 1e-9  # probability of a bin below which differences have too few digits
_TINY, _TERMS = -100.0, 9  # log of a tail of Student's t, below which a series of so many terms has all digits
_TRUNCATED: Any = (dist.LeftTruncatedDistribution, dist.RightTruncatedDistribution, dist.TwoSidedTruncatedDistribution)
_TRANSFORMED: Any = dist.TransformedDistribution  # any, as is whatever else is told apart by these
_AFFINE: Any = dist.transforms.AffineTransform
_FOLD: Any = dist.transforms.AbsTransform
_HALF: dict[type, Any] = {dist.HalfNormal: dist.Normal, dist.HalfCauchy: dist.Cauchy}
_MIXTURES: Any = (dist.MixtureSameFamily, dist.MixtureGeneral)
CENSORED: Any = (dist.LeftCensoredDistribution, dist.RightCensoredDistribution)
"""Distributions of values of which some are known to lie beyond what was observed."""


def has_probabilities(base: Any) -> bool:
    """Whether a distribution of single samples gives intervals probabilities, by its distribution function or a sum."""
    while isinstance(base, CENSORED):
        base = peeled(base.base_dist)
    return not base.event_dim and (base.is_discrete or _has_cdf(base))


def _has_cdf(base: Any) -> bool:
    if type(base).cdf is dist.Distribution.cdf:
        return False
    try:
        jax.eval_shape(base.cdf, jnp.zeros(base.batch_shape))
    except NotImplementedError:  # of a part, such as a component of a mixture
        return False
    return True


def log_interval(base: Any, lower: jax.Array, upper: jax.Array, least: ArrayLike = 0.0) -> jax.Array:
    """Log probability of intervals, of counts that of the integers from the lower end on, below the upper one.

    Args:
        base: Distribution of single samples that `has_probabilities`.
        lower: Lower ends, may be -inf.
        upper: Upper ends, may be inf.
        least: No scale of a location-scale family counts for less.
    """
    base = peeled(base)
    if log_cdf := _SYMMETRIC.get(type(base)):
        scale = jnp.maximum(base.scale, least)
        return _log_of_symmetric(base, log_cdf, (lower - base.loc) / scale, (upper - base.loc) / scale)
    if whole := _HALF.get(type(base)):
        upper = jnp.maximum(upper, 0.0)
        return log_interval(whole(0.0, base.scale), jnp.maximum(lower, 0.0), upper) + jnp.log(2.0)
    if isinstance(base, _TRANSFORMED):
        for transform in reversed(base.transforms):
            lower, upper = _taken_back(transform, lower, upper)
        return log_interval(base.base_dist, lower, upper)
    if isinstance(base, _TRUNCATED):
        low, high = getattr(base, "low", -jnp.inf), getattr(base, "high", jnp.inf)
        within = log_interval(base.base_dist, jnp.clip(lower, low, high), jnp.clip(upper, low, high))
        return within - log_interval(base.base_dist, jnp.asarray(low), jnp.asarray(high))
    if isinstance(base, _MIXTURES):
        return _mixed(base, log_interval, lower, upper)
    return _log_difference(base, lower, upper) if _has_cdf(base) else _log_sum(base, lower, upper)


def log_density(base: Any, value: jax.Array) -> jax.Array:
    """Log density, -inf outside of the support."""
    base = peeled(base)
    if isinstance(base, _MIXTURES) and not base.event_dim:
        return _mixed(base, log_density, value)
    there = inside(base, value)
    each = there.reshape(there.shape + (1,) * base.event_dim)
    # A value of the support in place of others, so that no derivative is NaN.
    value = jnp.where(each, value, _feasible(base, value))
    if base.is_discrete:  # some take integers alone
        value = value.astype(int)
    return jnp.where(there, base.log_prob(value), -jnp.inf)


def inside(distribution: Any, value: jax.Array) -> jax.Array:
    """Whether values are in the support, of a mixture in that of a component."""
    base = peeled(distribution)
    events = tuple(range(base.event_dim - distribution.event_dim, 0))
    return jnp.all(_inside(base, value), axis=events)


def _inside(base: Any, value: jax.Array) -> jax.Array:
    if isinstance(base, CENSORED):
        return inside(base.base_dist, value)
    if isinstance(base, _MIXTURES) and not base.event_dim:
        there = [inside(part, at) for part, (at,) in _components(base, value)]
        each = there[0] if isinstance(base, dist.MixtureSameFamily) else jnp.stack(there, axis=-1)
        return jnp.any(each, axis=-1)
    if isinstance(base, _TRANSFORMED):
        there: Any = True
        for transform in reversed(base.transforms):
            if not isinstance(transform, _AFFINE) and transform.codomain.event_dim == base.event_dim:
                there &= transform.codomain(value)
            if not isinstance(transform, _FOLD):
                value = transform.inv(value)  # NaN where there is none, which is in no support
        return there & inside(base.base_dist, value)
    return base.support(value)


def is_bounded(base: Any) -> bool:
    """Whether there are numbers outside of the support."""
    base = peeled(base)
    if isinstance(base, CENSORED):
        return is_bounded(base.base_dist)
    if isinstance(base, _TRANSFORMED):
        return is_bounded(base.base_dist) or any(_is_bound(each.codomain) for each in base.transforms)
    if isinstance(base, dist.MixtureGeneral):
        return any(map(is_bounded, base.component_distributions))
    if isinstance(base, dist.MixtureSameFamily):
        return is_bounded(base.component_distribution)
    return _is_bound(base.support)


def _is_bound(support: Any) -> bool:
    while hasattr(support, "base_constraint"):
        support = support.base_constraint
    return support is not None and support is not constraints.real


def _feasible(base: Any, value: jax.Array) -> jax.Array:
    """A value of the support."""
    base = peeled(base)
    if isinstance(base, CENSORED):
        return _feasible(base.base_dist, value)
    if isinstance(base, _TRANSFORMED):
        at = _feasible(base.base_dist, value)
        for transform in base.transforms:
            at = transform(at)
        return at
    return base.support.feasible_like(value)


def _components(mixture: Any, *values: jax.Array) -> list[tuple[Any, tuple[jax.Array, ...]]]:
    """Components with the values at which each is looked at; those of one family share an entry and a last axis."""
    if isinstance(mixture, dist.MixtureGeneral):
        return [(part, values) for part in mixture.component_distributions]
    return [(mixture.component_distribution, tuple(jnp.expand_dims(value, -1) for value in values))]


def _mixed(mixture: Any, function: Callable[..., jax.Array], *values: jax.Array) -> jax.Array:
    """Log of the mean of what a function gives the log of for each component."""
    logits: Any = mixture.mixing_distribution.logits
    parts = [function(part, *at) for part, at in _components(mixture, *values)]
    each = parts[0] if isinstance(mixture, dist.MixtureSameFamily) else jnp.stack(parts, axis=-1)
    weighted = each + jax.nn.log_softmax(logits)
    possible = jnp.any(weighted > -jnp.inf, axis=-1)
    # Zeros in place of components that are all impossible, so that no derivative is NaN.
    return jnp.where(possible, logsumexp(jnp.where(possible[..., None], weighted, 0.0), axis=-1), -jnp.inf)


def _taken_back(transform: Any, lower: jax.Array, upper: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The intervals that a transform makes these of."""
    if not isinstance(transform, _AFFINE):  # which takes all numbers back
        low, high = (getattr(transform.codomain, f"{side}_bound", None) for side in ("lower", "upper"))
        lower, upper = jnp.clip(lower, low, high), jnp.clip(upper, low, high)
    lower, upper = transform.inv(lower), transform.inv(upper)
    falls = jnp.asarray(transform.sign) < 0
    return jnp.where(falls, upper, lower), jnp.where(falls, lower, upper)


def _log_of_symmetric(base: Any, log_cdf: Callable[..., jax.Array], low: jax.Array, high: jax.Array) -> jax.Array:
    right = low + high > 0  # mirrored to the side where distribution functions are small and exact
    low, high = jnp.where(right, -high, low), jnp.where(right, -low, high)
    log_high = log_cdf(base, high)
    possible = (high > low) & (log_high > -jnp.inf)
    log_high = jnp.where(possible, log_high, 0.0)
    return jnp.where(possible, log_high + jnp.log(-jnp.expm1(log_cdf(base, low) - log_high)), -jnp.inf)


def _student(base: Any, z: jax.Array) -> jax.Array:
    """Where the tail rounds to 0, by the series of the incomplete beta function in the odds of its argument."""
    freedom = jnp.broadcast_to(base.df, z.shape)
    a, odds = 0.5 * freedom, freedom / jnp.maximum(z**2, 1e-300)
    tail = 0.5 * betainc(a, 0.5, freedom / (freedom + z**2))
    log_tail = jnp.log(jnp.where(z < 0, tail, 1 - tail))
    term = total = jnp.ones_like(odds)
    for n in range(_TERMS):
        term = -term * odds * (n + 0.5) / (n + 1 + a)
        total = total + term
    beta = gammaln(a) + 0.5 * jnp.log(jnp.pi) - gammaln(a + 0.5)
    far = -a * jnp.log1p(1 / odds) + 0.5 * jnp.log1p(odds) + jnp.log(jnp.abs(total)) - jnp.log(2 * a) - beta
    return jnp.where(log_tail < _TINY, far, log_tail)


def _laplace(_: Any, z: jax.Array) -> jax.Array:
    return jnp.where(z < 0, z - jnp.log(2.0), jnp.log1p(-0.5 * jnp.exp(-jnp.maximum(z, 0.0))))


def _cauchy(_: Any, z: jax.Array) -> jax.Array:
    return jnp.log(jnp.where(z < 0, jnp.arctan2(1.0, -z), jnp.pi - jnp.arctan2(1.0, jnp.maximum(z, 0.0))) / jnp.pi)


_SYMMETRIC: dict[type, Callable[[Any, jax.Array], jax.Array]] = {
    dist.Normal: lambda _, z: log_ndtr(z),  # beyond 20 deviations within 4e-9, a relative error of 2e-11
    dist.StudentT: _student,
    dist.Laplace: _laplace,
    dist.Logistic: lambda _, z: jax.nn.log_sigmoid(z),
    dist.Cauchy: _cauchy,
}
"""Logs of standard distribution functions; location-scale families, symmetric about 0."""


def _log_sum(base: Any, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """Log probability of the integers of intervals as the sum of theirs; open ends reach to 256 integers."""
    first, last = jnp.ceil(lower), jnp.ceil(upper)
    first = jnp.where(jnp.isneginf(first), last - _FAR, first)
    last = jnp.where(jnp.isposinf(last), first + _FAR, last)
    number = jnp.nan_to_num(last - first)
    shape = jnp.broadcast_shapes(number.shape, base.batch_shape)

    def add(step: jax.Array, total: jax.Array) -> jax.Array:
        each = log_density(base, jnp.broadcast_to(first.astype(int) + step, shape))
        return jnp.logaddexp(total, jnp.where(step < number, each, -jnp.inf))

    total = jax.lax.fori_loop(0, number.max().astype(int), add, jnp.full(shape, -jnp.inf))
    return jnp.where(jnp.isneginf(lower) & jnp.isposinf(upper), 0.0, total)


def _log_difference(base: Any, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """Log probability of intervals by their distribution function, and far out by their density."""
    support = Support.of(base)
    if base.is_discrete:
        lower, upper = jnp.ceil(lower) - 1, jnp.ceil(upper) - 1
    lower, upper = jnp.maximum(lower, support.low), jnp.minimum(upper, support.high)
    probability = support.cdf(base, upper) - support.cdf(base, lower)
    enough, possible = probability > _SMALL, upper > lower
    improbable = log_sum_of_integers if base.is_discrete else log_integral
    # Intervals that hold nothing are given the middle of the support, so that no number is NaN.
    within = jnp.where(possible, lower, support.middle - 1), jnp.where(possible, upper, support.middle)
    with numpyro.validation_enabled(False):  # which refuses values between integers
        small = improbable(base, support, *within)
    log_probability = jnp.where(enough, jnp.log(jnp.where(enough, probability, 1.0)), small)
    return jnp.where(possible, log_probability, -jnp.inf)
