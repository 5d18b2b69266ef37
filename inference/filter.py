"""The belief update compiled for speed: Eq. 3 to 9 on log beliefs in JAX.

Functions speak about one episode; the Monte Carlo maps them over many. They carry log beliefs without a floor, so a
class that underflows as a probability can still come back.
"""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp
from numpy.typing import ArrayLike, NDArray

from ..models.histogram import HistogramModel
from .reference import Border, ZeroEvidenceError


def update(log_belief: jax.Array, log_likelihood: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Log posterior (L, M) and log evidence of one tap; Eq. 3 and 4.

    Zero evidence shows as a log evidence of -inf, and the log posterior then is -inf throughout.
    """
    log_joint = log_belief + log_likelihood
    log_evidence = logsumexp(log_joint)
    return log_joint - jnp.where(jnp.isneginf(log_evidence), 0.0, log_evidence), log_evidence


def marginals(log_belief: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The where (L,) and what (M,) marginals as probabilities; Eq. 5 and 6."""
    belief = jnp.exp(log_belief)
    return belief.sum(1), belief.sum(0)


def shift(log_belief: jax.Array, delta: jax.Array, border: Border) -> jax.Array:
    """Log belief (L, M) after a move by `delta` where classes; Eq. 9, borders as in `reference.shift`."""
    L, M = log_belief.shape
    source = jnp.arange(L) - delta
    if border == "circular":
        return log_belief[source % L]
    kept = ((source >= 0) & (source < L))[:, None]
    moved = jnp.where(kept, log_belief[jnp.clip(source, 0, L - 1)], -jnp.inf)
    if border == "prior":
        shifted = jnp.where(kept, moved, -jnp.log(L * M))
        return shifted - logsumexp(shifted)
    target = jnp.arange(L) + delta
    lost = jnp.where(((target < 0) | (target >= L))[:, None], log_belief, -jnp.inf)
    if border == "clamp":
        end = jnp.where(delta > 0, L - 1, 0)
        piled = jnp.logaddexp(moved, logsumexp(lost, axis=0))
        return _normalised(jnp.where(jnp.arange(L)[:, None] == end, piled, moved))
    vacated = jnp.maximum(jnp.minimum(jnp.abs(delta), L), 1)
    if border == "uniform":
        spread = logsumexp(lost) - jnp.log(vacated * M)
    else:
        spread = logsumexp(lost, axis=0) - jnp.log(vacated)
    return _normalised(jnp.where(kept, moved, spread))


def _normalised(log_belief: jax.Array) -> jax.Array:
    return log_belief - logsumexp(log_belief)


_update = jax.jit(update)
_shift = partial(jax.jit, static_argnames="border")(shift)


@dataclass(frozen=True)
class FilterEngine:
    """The compiled filter of the Monte Carlo as an engine, in float64.

    Attributes:
        model: The fitted measurement model.
        border: Reading of Eq. 9 at the ends of the range.
    """

    model: HistogramModel
    border: Border = "uniform"
    name: str = "filter"

    def update(self, log_belief: NDArray[np.float64], tap: ArrayLike) -> tuple[NDArray[np.float64], float]:
        """Eq. 1 as a product of counts with log tables, then Eq. 3 and 4 compiled.

        Raises:
            ZeroEvidenceError: The tap is impossible under every class.
        """
        log_likelihood = self.model.log_likelihood(np.asarray(tap)[None])[0]
        with jax.enable_x64(True):
            posterior, log_evidence = _update(jnp.asarray(log_belief), jnp.asarray(log_likelihood))
            if np.isneginf(log_evidence):
                raise ZeroEvidenceError("The tap is impossible under every class that is still believed in.")
            return np.asarray(posterior), float(log_evidence)

    def shift(self, log_belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Eq. 9 compiled."""
        with jax.enable_x64(True):
            return np.asarray(_shift(jnp.asarray(log_belief), jnp.asarray(delta), self.border))
