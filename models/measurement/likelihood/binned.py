"""Distribution of a tap's bins under Gaussians, in JAX.

The same law as `innovations`, by other formulas: far out, the probability of an interval is a density times a
continued fraction, so that neither tail loses digits.
"""

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax.scipy.special import erfc, logsumexp
from jax.typing import ArrayLike

_FAR = 6.0  # standard deviations beyond which an interval is taken by its tails
_DEPTH = 20  # terms of the continued fraction: enough for 16 digits from `_FAR` on
_HALF_LOG_TWO_PI = 0.9189385332046727


class BinnedTap(dist.Distribution):
    """Distribution of the bins of a tap's samples, under a mixture of Gaussians over the whole tap.

    The law is that of `forms.GaussianForm` for one class: each sample is normal given those before it in time and,
    within one time, in taxels, and its bin has the probability of that normal over the bin.

    Args:
        loc: Mean of the samples, shape (Q, J, K).
        scale: Standard deviation of each sample given those before it, shape (Q, J, K).
        time: V, unit lower triangular, shape (1, J, J) or (K, J, J).
        taxel: W, unit lower triangular, shape (K, K), or (0, 0) for independent taxels.
        log_weight: Log weights of the mixture, shape (Q,).
        edges: Bin edges, shape (B + 1,) or (K, B + 1); the end bins are open.
    """

    support = dist.constraints.independent(dist.constraints.real, 2)  # pyright: ignore
    arg_constraints = {  # noqa: RUF012
        "loc": dist.constraints.independent(dist.constraints.real, 3),
        "scale": dist.constraints.independent(dist.constraints.positive, 3),
        "time": dist.constraints.independent(dist.constraints.real, 3),
        "taxel": dist.constraints.independent(dist.constraints.real, 2),
        "log_weight": dist.constraints.real_vector,
        "edges": dist.constraints.independent(dist.constraints.real, 1),
    }

    def __init__(
        self,
        loc: jax.Array,
        scale: jax.Array,
        time: jax.Array,
        taxel: jax.Array,
        log_weight: jax.Array,
        edges: jax.Array,
        *,
        validate_args: bool | None = None,
    ) -> None:
        self.loc, self.scale, self.time, self.taxel = loc, scale, time, taxel
        self.log_weight, self.edges = log_weight, edges
        super().__init__((), loc.shape[1:], validate_args=validate_args)

    def log_prob(self, value: ArrayLike, intermediates: object = None) -> jax.Array:  # noqa: ARG002
        """Log probability of the bins that contain the samples `value`, shape (J, K)."""
        samples = jnp.asarray(value)
        lower, upper = bin_of(samples, self.edges)
        innovation = jnp.where(jnp.isnan(samples), 0.0, samples) - self.loc
        K = samples.shape[1]
        time = jnp.broadcast_to(self.time, (K, *self.time.shape[1:]))
        innovation = jnp.einsum("kji,qik->qjk", time, innovation)
        if self.taxel.shape[-1]:
            innovation = jnp.einsum("kp,qjp->qjk", self.taxel, innovation)
        samples = jnp.where(jnp.isnan(samples), 0.0, samples)
        below, above = lower - samples + innovation, upper - samples + innovation
        log_probability = log_interval(below / self.scale, above / self.scale)
        return logsumexp(self.log_weight + log_probability.sum((-2, -1)))


def bin_of(samples: jax.Array, edges: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Lower and upper bin edge of each sample, both of shape (J, K); end bins and that of NaN extend to infinity."""
    inner = bin_indices(samples, edges)
    edges = jnp.broadcast_to(edges, (samples.shape[1], edges.shape[-1]))
    open_edges = edges.at[:, 0].set(-jnp.inf).at[:, -1].set(jnp.inf)
    taxel = jnp.arange(samples.shape[1])
    missing = jnp.isnan(samples)
    lower, upper = open_edges[taxel, inner], open_edges[taxel, inner + 1]
    return jnp.where(missing, -jnp.inf, lower), jnp.where(missing, jnp.inf, upper)


def bin_indices(samples: jax.Array, edges: jax.Array) -> jax.Array:
    """Bin of each sample (J, K), those beyond the edges in end bins."""
    edges = jnp.broadcast_to(edges, (samples.shape[1], edges.shape[-1]))
    return jax.vmap(lambda row, column: jnp.searchsorted(row[1:-1], column, side="right"))(edges, samples.T).T


def log_interval(a: jax.Array, b: jax.Array) -> jax.Array:
    """Log probability of a standard normal between a and b > a."""
    mirrored = a + b < 0  # to the side where distribution functions are small and exact
    a, b = jnp.where(mirrored, -b, a), jnp.where(mirrored, -a, b)
    far = a > _FAR
    near_a, near_b = jnp.where(far, 0.0, a), jnp.where(far, 1.0, b)
    root = jnp.sqrt(0.5)
    near = jnp.log(0.5 * (erfc(near_a * root) - erfc(near_b * root)))
    far_a, far_b = jnp.where(far, a, _FAR), jnp.where(far, b, _FAR + 1)
    ratio_a, ratio_b = _tail_over_density(far_a), _tail_over_density(far_b)
    rest = jnp.exp(0.5 * (far_a - far_b) * (far_a + far_b)) * ratio_b / ratio_a
    beyond = -0.5 * far_a**2 - _HALF_LOG_TWO_PI + jnp.log(ratio_a) + jnp.log1p(-rest)
    return jnp.where(far, beyond, near)


def _tail_over_density(z: jax.Array) -> jax.Array:
    """Upper tail probability of a standard normal over its density at z, by Laplace's continued fraction."""
    fraction = z
    for n in range(_DEPTH, 0, -1):
        fraction = z + n / fraction
    return 1 / fraction
