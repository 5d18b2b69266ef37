"""Probability that any NumPyro distribution gives to the bins of samples.

A distribution of single samples gives a bin the difference of its distribution function. A Gaussian vector gives the
bins of its components one after the other, each given the exact samples before it. Both are the measure of the built-in
models. Any other distribution gives the density at the samples times the widths of their bins.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
from jax.scipy.linalg import solve_triangular
from jax.typing import ArrayLike
from numpyro.primitives import Messenger

from ..fits.present import peeled, remade
from ..likelihood.binned import bin_indices, bin_of
from ..model import BINS
from .interval import CENSORED, has_probabilities, is_bounded, log_density, log_interval

DENSITY = "density"
"""Measure of a distribution that gives no probabilities to bins, but a density; the other is `BINS`."""


class Binned(NamedTuple):
    """Samples and their bins, in the units of the generative model; shape (..., J, K) each.

    Attributes:
        samples: Exact values, on which later samples depend.
        lower: Lower edge of the bin, -inf in the first.
        upper: Upper edge, inf in the last.
        width: Its width; that of an end bin between its edges. NaN for a missing sample, whose bin holds all values.
    """

    samples: jax.Array
    lower: jax.Array
    upper: jax.Array
    width: jax.Array

    @classmethod
    def of(cls, taps: jax.Array, edges: jax.Array) -> "Binned":
        """Samples (n, J, K) in bins with these edges, shape (B + 1,) or (K, B + 1); NaN is a missing sample."""
        lower, upper, width = jax.vmap(_bins_of, (0, None))(taps, edges)
        missing = jnp.isnan(taps)
        return cls(jnp.where(missing, 0.0, taps), lower, upper, jnp.where(missing, jnp.nan, width))

    def scaled(self, gain: Any, offset: Any, centre: Any, unit: Any) -> "Binned":
        """The same before a gain and an offset, in the units of a generative model."""
        samples, lower, upper = (((part - offset) / gain - centre) / unit for part in self[:-1])
        return Binned(samples, lower, upper, self.width / (gain * unit))

    def swapped(self) -> "Binned":
        """Taxels before times."""
        return Binned(*(jnp.swapaxes(part, -1, -2) for part in self))


def _bins_of(samples: jax.Array, edges: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    edges = jnp.broadcast_to(edges, (samples.shape[1], edges.shape[-1]))
    width = jnp.diff(edges, axis=1)[jnp.arange(len(edges)), bin_indices(samples, edges)]
    return *bin_of(samples, edges), width


def measure_of(distribution: Any) -> str:
    """Measure of a distribution."""
    base = peeled(distribution)
    return BINS if isinstance(base, _GAUSSIAN) or has_probabilities(base) else DENSITY


def elementwise(distribution: Any) -> bool:
    """Whether samples are independent, each with a probability in its bin."""
    base = peeled(distribution)
    return not base.event_dim and has_probabilities(base)


def binned(distribution: Any, taps: Binned, least: ArrayLike = 0.0) -> dist.Distribution:
    """Distribution over bins in place of one over samples, with the same batch and event axes.

    Args:
        distribution: That of the samples.
        taps: Samples and bins, in the order of its axes.
        least: No standard deviation of a location-scale family counts for less.
    """
    base = peeled(distribution)
    if isinstance(base, _GAUSSIAN):
        return remade(distribution, InBin(_given_those_before(base, taps.samples), taps, least))
    if not has_probabilities(base):
        return remade(distribution, _DensityOfBin(base, taps))
    while isinstance(base, CENSORED):  # the probability of all that a censored sample may be
        left = isinstance(base, dist.LeftCensoredDistribution)
        lower = jnp.where(base.censored, -jnp.inf if left else taps.samples, taps.lower)
        upper = jnp.where(base.censored, taps.samples if left else jnp.inf, taps.upper)
        base, taps = peeled(base.base_dist), taps._replace(lower=lower, upper=upper)
    return remade(distribution, InBin(base, taps, least))


class Censored(Messenger):
    """Handler that makes a generative model observe bins instead of samples.

    Args:
        story: Generative model.
        site: Name of the observed site.
        taps: Samples and bins, in the order of its axes.
        least: No scale of a location-scale family counts for less.
        counted: Mask of the taps that count, shape (N,); default all.
    """

    def __init__(
        self, story: Callable[..., Any], site: str, taps: Binned, least: ArrayLike = 0.0, counted: Any = None
    ) -> None:
        self._site, self._taps, self._least, self._counted = site, taps, least, counted
        super().__init__(story)

    def process_message(self, msg: dict[str, Any]) -> None:
        """Puts the distribution over bins in the place of that over samples."""
        if msg["type"] == "sample" and msg["name"] == self._site:
            made = binned(msg["fn"], self._taps, self._least)
            if self._counted is not None:
                axes = self._taps.samples.ndim - made.event_dim - 1
                made = made.mask(self._counted.reshape(-1, *[1] * axes))
            msg["fn"] = made


class InBin(dist.Distribution):
    """Distribution of the bins of independent samples.

    Args:
        base: Distribution of a sample.
        taps: Samples and bins.
        least: No scale of a location-scale family counts for less.
    """

    support = dist.constraints.real  # pyright: ignore

    def __init__(self, base: Any, taps: Binned, least: ArrayLike = 0.0) -> None:
        self._base, self._taps, self._least = base, taps, least
        super().__init__(np.broadcast_shapes(base.batch_shape, taps.samples.shape))

    def log_prob(self, value: ArrayLike, intermediates: object = None) -> jax.Array:  # noqa: ARG002
        """Log probability of the bin of each sample; the bins are those given, whatever `value` is."""
        return log_interval(self._base, self._taps.lower, self._taps.upper, self._least)


class Supported(Messenger):
    """Handler that gives observed samples outside of the support of their distribution the density 0.

    Args:
        story: Generative model.
        site: Name of the observed site.
    """

    def __init__(self, story: Callable[..., Any], site: str) -> None:
        self._site = site
        super().__init__(story)

    def process_message(self, msg: dict[str, Any]) -> None:
        """Puts a distribution in the place of one that has a density everywhere."""
        if msg["type"] == "sample" and msg["name"] == self._site and is_bounded(msg["fn"]):
            base: Any = peeled(msg["fn"])
            shape = msg["fn"].shape()
            msg["fn"] = remade(msg["fn"], _InSupport(base.expand(shape[: len(shape) - base.event_dim])))


class _InSupport(dist.Distribution):
    """Distribution whose density is 0 outside of its support."""

    support = dist.constraints.real  # pyright: ignore

    def __init__(self, base: Any) -> None:
        self._base = base
        super().__init__(base.batch_shape, base.event_shape)

    def sample(self, key: Any, sample_shape: tuple[int, ...] = ()) -> Any:
        """Samples of the distribution."""
        return self._base.sample(key, sample_shape)

    def log_prob(self, value: ArrayLike, intermediates: object = None) -> jax.Array:  # noqa: ARG002
        """Log density."""
        return log_density(self._base, jnp.asarray(value))


class _DensityOfBin(dist.Distribution):
    """Density at the samples times the widths of their bins, of vectors of integers times how many a bin holds."""

    support = dist.constraints.real  # pyright: ignore

    def __init__(self, base: Any, taps: Binned) -> None:
        self._base, self._taps = base, taps
        shape = np.broadcast_shapes(base.batch_shape + base.event_shape, taps.samples.shape)
        split = len(shape) - base.event_dim
        super().__init__(shape[:split], shape[split:])

    def log_prob(self, value: ArrayLike, intermediates: object = None) -> jax.Array:  # noqa: ARG002
        """Log density in bins instead of units."""
        _, lower, upper, width = self._taps
        if self._base.is_discrete:
            held = jnp.ceil(upper) - jnp.ceil(lower)
            width = jnp.where(jnp.isfinite(held), held, jnp.maximum(jnp.round(width), 1.0))
        width, event = jnp.log(width), tuple(range(-self._base.event_dim, 0))
        density = log_density(self._base, self._taps.samples) + width.sum(event)
        return density if event else jnp.where(jnp.isnan(width), 0.0, density)


_GAUSSIAN = (dist.MultivariateNormal, dist.MatrixNormal, dist.GaussianRandomWalk)
"""Vectors whose components are normal given those before them."""


def _given_those_before(vector: Any, samples: jax.Array) -> dist.Normal:
    """Distribution of each component of a Gaussian vector given those before it; times come before taxels."""
    normal: Any = vector
    if isinstance(vector, dist.GaussianRandomWalk):
        before = jnp.concatenate([jnp.zeros_like(samples[..., :1]), samples[..., :-1]], axis=-1)
        return dist.Normal(before, jnp.broadcast_to(normal.scale[..., None], before.shape))
    if isinstance(vector, dist.MultivariateNormal):
        root = normal.scale_tril
        residual = jnp.expand_dims(samples - normal.loc, -1)
        root = jnp.broadcast_to(root, (*residual.shape[:-2], *root.shape[-2:]))
        white = solve_triangular(root, residual, lower=True)[..., 0]
        deviation = jnp.broadcast_to(jnp.diagonal(root, axis1=-2, axis2=-1), samples.shape)
        return dist.Normal(samples - deviation * white, deviation)
    rows, columns = normal.scale_tril_row, normal.scale_tril_column
    in_time: Any = solve_triangular(rows, samples - normal.loc, lower=True)
    white = solve_triangular(columns, in_time.mT, lower=True).mT
    row_scale, column_scale = (jnp.diagonal(root, axis1=-2, axis2=-1) for root in (rows, columns))
    deviation = row_scale[..., :, None] * column_scale[..., None, :]
    return dist.Normal(samples - deviation * white, deviation)
