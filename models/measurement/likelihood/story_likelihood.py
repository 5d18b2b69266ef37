"""Likelihood of taps from the generative model at fitted parameters.

The stories give densities of exact samples, fitted models the probabilities of their bins
(docs/reference/models.md). Here a story is run by NumPyro at the fitted parameters, and its distribution of every
sample given those before it is taken over the bin that holds the sample: `log_density` of the story with
interval-censored samples. Forms and the compiled loops behind a model take no part, so that both can be compared.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax.scipy.special import logsumexp
from numpy.typing import ArrayLike, NDArray
from numpyro.handlers import block, seed, substitute, trace
from numpyro.infer.util import log_density

from ..fits.priors import Taps
from ..generic.observed import Binned, Censored
from ..generic.story import GenericModel
from ..generic.structure import OBSERVED
from ..histogram import HistogramModel
from ..model import TapModel
from ..story import ParametricModel
from .bins import TableForm
from .shapes import Parameters

_AT_ONCE = 1 << 22  # samples under classes that one step holds


class _Law(NamedTuple):
    """A generative model as programs are compiled for it.

    Attributes:
        story: Generative model.
        arguments: See `Given`.
        places: Positions in a class.
        shape: (L, M).
    """

    story: Callable[..., None]
    arguments: Callable[[Taps, Any], dict[str, Any]]
    places: int
    shape: tuple[int, int]


class _Numbers(NamedTuple):
    """The numbers of a fitted model that programs are run on.

    Attributes:
        sites: Values of the sites of the story.
        centre: Of the scaling, as `unit`.
        unit: Shape (K,).
        least: See `_least`.
        basis: Basis functions, shape (Q, L, D), or (0, 0, 0).
    """

    sites: dict[str, jax.Array]
    centre: jax.Array
    unit: jax.Array
    least: jax.Array
    basis: jax.Array


def log_likelihoods(model: TapModel, taps: NDArray[np.floating]) -> NDArray[np.float64]:
    """Log-likelihoods of taps under every class at power 1 from the generative model, shape (N, L, H).

    Classes without a training tap have one too, which means nothing.

    Args:
        model: A fitted model.
        taps: Prepared samples, shape (N, J, K).
    """
    if model.draws:
        each = [_at_one(model, draw, taps) for draw in model.draws]
        return np.logaddexp.reduce(each, axis=0) - np.log(len(each))
    return _at_one(model, None, taps)


def _at_one(model: TapModel, draw: Parameters | None, taps: NDArray[np.floating]) -> NDArray[np.float64]:
    """As `log_likelihoods`, at the parameters of one draw or at those with which the model decides."""
    if draw is not None and isinstance(model, ParametricModel | GenericModel):
        model = replace(model, parameters=draw, draws=())
    with jax.enable_x64(True):
        in_tables = isinstance(model.plain_form, TableForm) and len(model.states.gain) > 1
        if isinstance(model, GenericModel) and not in_tables:
            out = np.empty((len(taps), *model.form.shape))
            model.story_form.prepare(np.zeros(model.form.shape, dtype=bool)).log_likelihood(taps, model.edges, 1.0, out)
            return out
        if isinstance(model, ParametricModel) and (not model.story.exchangeable or len(model.states.gain) == 1):
            return _by_samples(model, taps)
        return _by_bins(model, draw, taps)


def _given(model: ParametricModel) -> tuple[_Law, _Numbers]:
    """Generative model at fitted parameters."""
    given = model.story.given(model.parameters, model.basis)
    sites: Any = {name: jnp.asarray(values) for name, values in given.sites.items()}
    arrays: Any = (*model.scaling, _least(model), model.basis)
    law = _Law(model.story.story, given.arguments, given.places, model.grid.shape)
    return law, _Numbers(sites, *(jnp.asarray(array) for array in arrays))


def _told(law: _Law, numbers: _Numbers, samples: Any, own: Any, place: Any) -> Callable[[], Any]:
    """Generative model of taps (n, J, K) of known class l M + m, at one position in the class."""
    M = law.shape[1]
    taps = Taps(samples, own // M, own % M, law.shape, least=numbers.least)
    functions = numbers.basis[place, taps.where] if numbers.basis.size else None
    sites: Any = numbers.sites
    told = substitute(taps.under(law.story, **law.arguments(taps, functions)), data=sites)
    return seed(told, 0)  # some sites have no part in a sample


def _by_samples(model: ParametricModel, taps: NDArray[np.floating]) -> NDArray[np.float64]:
    """As `log_likelihoods`; a state's offset and gain are removed from samples and edges."""
    law, numbers = _given(model)
    held, states = _held(model, taps), zip(model.states.gain, model.states.offset, strict=True)
    parts = [_everywhere(held, gain, offset, numbers, law) for gain, offset in states]
    return np.concatenate([np.asarray(part) for part in parts], axis=2)


@partial(jax.jit, static_argnames="law")
def _everywhere(held: Binned, gain: Any, offset: Any, numbers: _Numbers, law: _Law) -> jax.Array:
    """Log probability of taps under every class in one state, shape (N, L, M)."""
    scaled = held.scaled(gain, offset, numbers.centre, numbers.unit)
    (L, M), (N, J, K) = law.shape, held.samples.shape

    def at(index: jax.Array) -> jax.Array:
        n, q, c = jnp.unravel_index(index, (N, law.places, L * M))
        one = Binned(*(part[n][None] for part in scaled))
        story = _told(law, numbers, one.samples, c[None], q)
        observed = block(Censored(story, OBSERVED, one, numbers.least), hide_fn=lambda site: site["name"] != OBSERVED)
        return jnp.asarray(log_density(observed, (), {}, {})[0])

    log_prob = jax.lax.map(at, jnp.arange(N * law.places * L * M), batch_size=max(1, _AT_ONCE // (J * K)))
    each = log_prob.reshape(N, law.places, L, M)
    return logsumexp(each, axis=1) - jnp.log(law.places)


def _by_bins(model: TapModel, draw: Parameters | None, taps: NDArray[np.floating]) -> NDArray[np.float64]:
    """As `log_likelihoods`, for exchangeable samples with one probability per bin."""
    plain = _bin_log_prob(model, draw)
    L, M, K, B = plain.shape
    bins = jnp.asarray(model.bins(taps))
    edges = jnp.asarray(np.broadcast_to(model.edges, (K, B + 1)))
    parts = []
    for gain, offset in zip(model.states.gain.tolist(), model.states.offset.tolist(), strict=True):
        at_rest = gain == 1 and offset == 0
        log_prob = plain.reshape(L * M, K, B)
        parts.append(_of_bins(bins, log_prob if at_rest else in_state(log_prob, edges, gain, offset)))
    return np.concatenate([np.asarray(part).reshape(-1, L, M) for part in parts], axis=2)


@jax.jit
def _of_bins(bins: jax.Array, log_prob: jax.Array) -> jax.Array:
    """Log probability of bins (N, J, K) under tables (C, K, B), shape (N, C)."""
    N, (C, K, B) = len(bins), log_prob.shape

    def at(index: jax.Array) -> jax.Array:
        n, c = jnp.unravel_index(index, (N, C))
        return jnp.asarray(log_density(_exchangeable, (bins[n], log_prob[c]), {}, {})[0])

    step = max(1, _AT_ONCE // (K * max(B, bins.shape[1])))
    return jax.lax.map(at, jnp.arange(N * C), batch_size=step).reshape(N, C)


def _exchangeable(bins: jax.Array, log_prob: jax.Array) -> None:
    """Bins (J, K) of a tap, each drawn by its taxel's probabilities (K, B)."""
    J, K = bins.shape
    with numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
        numpyro.sample(OBSERVED, dist.CategoricalLogits(logits=log_prob), obs=bins)


@jax.jit
def in_state(log_prob: jax.Array, edges: jax.Array, gain: Any, offset: Any) -> jax.Array:
    """Log probability of the bins of `gain` times a sample plus `offset`, shape (C, K, B).

    A sample is uniform within the bin it was drawn in. The end bins are made as wide as it takes for the moved samples
    to cover the range, at the same density.

    Args:
        log_prob: Log probability of the bins of a sample, shape (C, K, B).
        edges: Shape (K, B + 1).
        gain: Gain of the state.
        offset: Offset of the state.
    """
    moved = gain * edges + offset
    lower = moved.at[:, 0].min(edges[:, 0])[:, :-1]
    upper = moved.at[:, -1].max(edges[:, -1])[:, 1:]
    log_width = jnp.log((upper - lower) / jnp.diff(moved, axis=1))
    open_edges = edges.at[:, 0].set(-jnp.inf).at[:, -1].set(jnp.inf)
    high = jnp.minimum(upper[:, :, None], open_edges[:, None, 1:])
    low = jnp.maximum(lower[:, :, None], open_edges[:, None, :-1])
    log_overlap = jnp.log(jnp.maximum(high - low, 0.0) / (upper - lower)[:, :, None])

    def of(one: jax.Array) -> jax.Array:
        return logsumexp(jax.nn.log_softmax(one + log_width)[:, :, None] + log_overlap, axis=1)

    return jax.lax.map(of, log_prob)


def _bin_log_prob(model: TapModel, draw: Parameters | None) -> jax.Array:
    """Log probability of every bin of a sample in the state of gain 1 and offset 0, shape (L, M, K, B)."""
    if isinstance(model, HistogramModel):
        return jnp.log(jnp.asarray(model.probabilities)) if draw is None else jnp.asarray(draw["log_prob"])
    form = model.plain_form
    if isinstance(model, GenericModel) and isinstance(form, TableForm):
        return jnp.asarray(form.log_prob)
    if not isinstance(model, ParametricModel):
        raise TypeError(f"A model of type {type(model).__name__} has no generative model.")
    edges = np.broadcast_to(model.edges, (model.K, model.edges.shape[-1]))
    centres = 0.5 * (edges[:, :-1] + edges[:, 1:]).T[None]  # one tap with a sample in each bin
    law, numbers = _given(model)
    return _of_each_bin(_held(model, centres), numbers, law)


@partial(jax.jit, static_argnames="law")
def _of_each_bin(held: Binned, numbers: _Numbers, law: _Law) -> jax.Array:
    """Log probability of the bins of exchangeable samples, held by one tap (1, B, K) in order; shape (L, M, K, B)."""
    (L, M), (_, B, K) = law.shape, held.samples.shape
    one = held.scaled(1.0, 0.0, numbers.centre, numbers.unit)
    samples = jnp.broadcast_to(one.samples, (L * M, B, K))
    story = _told(law, numbers, samples, np.arange(L * M), 0)
    site = trace(Censored(story, OBSERVED, one, numbers.least)).get_trace()[OBSERVED]
    return jnp.moveaxis(site["fn"].log_prob(samples).reshape(L, M, B, K), 2, 3)


def _held(model: TapModel, taps: ArrayLike) -> Binned:
    """Samples with their bin edges."""
    return _in_bins(jnp.asarray(np.asarray(taps, dtype=np.float64)), jnp.asarray(model.edges))


_in_bins = jax.jit(Binned.of)


def _least(model: ParametricModel) -> NDArray[np.float64]:
    """Standard deviation of a uniform draw from a bin, in the units of the generative model, shape (K,)."""
    width = (model.edges[..., -1] - model.edges[..., 0]) / (model.edges.shape[-1] - 1)
    return np.broadcast_to(width, model.scaling.unit.shape) / np.sqrt(12.0) / model.scaling.unit
