"""Likelihood of taps from the generative model at fitted parameters.

Whoever wrote a model, NumPyro runs it with bins in the place of samples (`generic.form`; docs/reference/models.md).
Fast forms and the compiled loops behind a model take no part, so that both can be compared. A histogram, and
exchangeable samples in a state, have one probability per bin instead, and a tap is a draw of its bins.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax.scipy.special import logsumexp
from numpy.typing import NDArray
from numpyro.infer.util import log_density

from ..fitted_parameters import ModelOfParameters
from ..histogram import HistogramModel
from ..model import TapModel
from .any_form import Form

_AT_ONCE = 1 << 22  # samples under classes that one step holds


def log_likelihoods(model: TapModel, taps: NDArray[np.floating]) -> NDArray[np.float64]:
    """Log-likelihoods of taps under every class at power 1 from the generative model, shape (N, L, H).

    Classes without a training tap have one too, which means nothing.

    Args:
        model: A fitted model.
        taps: Prepared samples, shape (N, J, K).

    Raises:
        TypeError: It has no generative model.
    """
    if isinstance(model, HistogramModel):
        tables = [draw["log_prob"] for draw in model.draws] or [model.log_prob]
    elif not isinstance(model, ModelOfParameters):
        raise TypeError(f"A model of type {type(model).__name__} has no generative model.")
    else:
        forms = [form for parameters in model.decides_at for form in model.by_story(parameters)]
        if len(model.states.apart().gain) == 1 or not forms[0].program.structure.exchangeable:
            return _by_samples(model, model.over_states(forms), taps)
        tables = [form.table(model.edges) for form in forms]
    with jax.enable_x64(True):
        each = [_by_bins(model, table, taps) for table in tables]
    return np.logaddexp.reduce(each, axis=0) - np.log(len(each))


def _by_samples(model: TapModel, form: Form, taps: NDArray[np.floating]) -> NDArray[np.float64]:
    """As `log_likelihoods`, from the generative model itself; a state's offset and gain are removed from samples."""
    out = np.empty((len(taps), *form.shape))
    form.prepare(np.zeros(form.shape, dtype=bool)).log_likelihood(taps, model.edges, 1.0, out)
    return out


def _by_bins(model: TapModel, log_prob: NDArray[np.float64], taps: NDArray[np.floating]) -> NDArray[np.float64]:
    """As `log_likelihoods`, from the log probability of every bin of a sample at rest, shape (L, M, K, B)."""
    L, M, K, B = log_prob.shape
    bins, plain = jax.device_put((model.bins(taps), log_prob.reshape(L * M, K, B)))
    edges = jax.device_put(np.broadcast_to(model.edges, (K, B + 1)))
    parts = []
    for gain, offset in zip(model.states.gain.tolist(), model.states.offset.tolist(), strict=True):
        at_rest = gain == 1 and offset == 0
        parts.append(_of_bins(bins, plain if at_rest else in_state(plain, edges, gain, offset)))
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
    """Bins (J, K) of a tap, each drawn by its taxel's probabilities (K, B); one of -1 does not count."""
    J, K = bins.shape
    with numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1), numpyro.handlers.mask(mask=bins >= 0):
        numpyro.sample("bins", dist.CategoricalLogits(logits=log_prob), obs=jnp.maximum(bins, 0))


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
