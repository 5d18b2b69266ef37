"""Log probability of bins where a distribution function has no digits left, from its density or its probabilities.

Far from the mass both fall nearly exponentially away from the nearer end of a bin, also of a bin that is wide against
their scale. Quadrature of a variable that makes an exponential constant is therefore exact to many digits.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_SHARES, _WEIGHTS = 0.5 * (_POINTS + 1), 0.5 * _WEIGHTS  # on [0, 1]
_LEAST_FALL = 1e-2  # of the log density over a bin, below which it counts as this
_INSIDE = 1e-2  # share of a bin from its end to where its density is looked at, as that at the end may be infinite
_SUMMED = 16  # integers whose probabilities are summed, before the others are integrated


class Support(NamedTuple):
    """Where a distribution function rises.

    Attributes:
        low: Where it is 0; of integers one below the lowest.
        high: Where it is 1.
        middle: A value in between.
    """

    low: jax.Array
    high: jax.Array
    middle: jax.Array

    @classmethod
    def of(cls, base: Any) -> "Support":
        """Support of a distribution."""
        low, high = (getattr(base.support, name, None) for name in ("lower_bound", "upper_bound"))
        low = jnp.asarray(-jnp.inf if low is None else low - 1.0 if base.is_discrete else low)
        high = jnp.asarray(jnp.inf if high is None else high)
        step = 1.0 if base.is_discrete else 0.5 * jnp.minimum(high - low, 2.0)
        return cls(low, high, jnp.where(jnp.isfinite(low), low + step, jnp.where(jnp.isfinite(high), high - step, 0.0)))

    def inside(self, at: jax.Array) -> jax.Array:
        """Values, and the middle in the place of those outside of the support."""
        return jnp.where((at > self.low) & (at < self.high), at, self.middle)

    def cdf(self, base: Any, at: jax.Array) -> jax.Array:
        """Distribution function, also outside of the support and at infinity."""
        within = (at > self.low) & (at < self.high)
        return jnp.where(within, base.cdf(self.inside(at)), jnp.where(at >= self.high, 1.0, 0.0))


class _Stretch(NamedTuple):
    """Part of a line, from the end nearer to the mass of a distribution.

    Attributes:
        end: That end.
        way: 1 if it goes up from there, -1 if down.
        length: Infinite for a tail.
        density: Log density at the end.
        rate: By how much that falls per unit.
    """

    end: jax.Array
    way: jax.Array
    length: jax.Array
    density: jax.Array
    rate: jax.Array


def log_integral(base: Any, support: Support, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """Log probability of intervals within the support, of a continuous distribution."""
    return _integral(base, support, _stretch(base, support, lower, upper))


def log_sum_of_integers(base: Any, support: Support, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """Log probability of the integers above `lower`, up to `upper`, of a discrete distribution.

    Those nearest to the mass are summed; the sum of the others is the integral with the first correction of Euler and
    Maclaurin at its ends.
    """
    whole = _stretch(base, support, lower + 0.5, upper + 0.5)

    def one(step: Any) -> jax.Array:
        at = _within(support, whole.end + whole.way * (step + 0.5))
        return jnp.where(step < whole.length, base.log_prob(at), -jnp.inf)

    first = _log_sum(one, np.arange(float(_SUMMED)))
    more = whole.length > _SUMMED
    start = whole.end + whole.way * _SUMMED
    end = jnp.where(more, start + whole.way * (whole.length - _SUMMED), start + whole.way)
    rest = _stretch(base, support, jnp.minimum(start, end), jnp.maximum(start, end), whole.way)
    integral = _integral(base, support, rest)
    there = jnp.isfinite(rest.length)
    last = jnp.where(there, base.log_prob(_within(support, jnp.where(there, end, start))), -jnp.inf)
    ends = rest.rate / 24 * (jnp.exp(rest.density - integral) - jnp.exp(last - integral))
    return jnp.where(more, jnp.logaddexp(first, integral + jnp.log1p(-jnp.clip(ends, -0.5, 0.5))), first)


def _within(support: Support, at: jax.Array) -> jax.Array:
    return jnp.clip(support.inside(at), support.low + 0.5, support.high)


def _stretch(base: Any, support: Support, lower: jax.Array, upper: jax.Array, way: jax.Array | None = None) -> _Stretch:
    """Intervals from their end of higher density, or in a known direction."""
    length = upper - lower
    closed = jnp.isfinite(length)
    margin = jnp.where(closed, _INSIDE * length, 0.0)
    low, high = (
        support.inside(jnp.where(jnp.isfinite(edge), edge + sign * margin, support.middle))
        for edge, sign in ((lower, 1.0), (upper, -1.0))
    )
    shape = jnp.broadcast_shapes(low.shape, high.shape, base.batch_shape)
    low, high = jnp.broadcast_to(low, shape), jnp.broadcast_to(high, shape)
    (at_low, up), (at_high, down) = (jax.jvp(base.log_prob, (at,), (jnp.ones_like(at),)) for at in (low, high))
    if way is None:
        falls = jnp.where(closed, at_low >= at_high, jnp.isfinite(lower))
        way = jnp.where(falls, 1.0, -1.0)
    rises = way > 0
    least = jnp.where(closed, _LEAST_FALL / jnp.where(closed, length, 1.0), 1e-300)
    rate = jnp.maximum(jnp.nan_to_num(jnp.where(rises, -up, down), nan=0.0, posinf=0.0, neginf=0.0), least)
    return _Stretch(jnp.where(rises, lower, upper), way, length, jnp.where(rises, at_low, at_high), rate)


def _integral(base: Any, support: Support, over: _Stretch) -> jax.Array:
    """Log integral of a density over a stretch."""
    mass = -jnp.expm1(-over.rate * over.length)

    def one(node: Any) -> jax.Array:
        share, weight = node
        fallen = -jnp.log1p(-share * mass)
        at = support.inside(over.end + over.way * fallen / over.rate)
        return base.log_prob(at) + fallen + jnp.log(weight)

    return _log_sum(one, (_SHARES, _WEIGHTS)) + jnp.log(mass / over.rate)


def _log_sum(one: Callable[[Any], jax.Array], over: Any) -> jax.Array:
    """Log of the sum of exponentials of a function of each item, which is compiled once."""
    begun = one(jax.tree.map(lambda items: items[0], over))
    rest = jax.tree.map(lambda items: jnp.asarray(items[1:]), over)
    return jax.lax.scan(lambda total, item: (jnp.logaddexp(total, one(item)), None), begun, rest)[0]
