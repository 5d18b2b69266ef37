"""NumPyro models of one tap and of a sequence of taps with moves.

The state is (where_t, what_t), the position class of the sensor and the object class. Positions change only by
commanded moves, so the transition is Eq. 9 of the paper read as a Markov kernel. References: Lepora,
Martinez-Hernandez and Prescott, "A SOLID case for active Bayesian perception in robot touch" (2013), Eq. 1, 3, 4, 9.

Untrained classes (cells without a training tap) are impossible at every tap: their histogram is no knowledge, and a
flat one would win whenever a tap is unusual.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax.typing import ArrayLike
from numpy.typing import NDArray
from numpyro.contrib.funsor import markov
from numpyro.ops.indexing import Vindex

KERNEL_BORDERS = ("uniform", "uniform_what", "clamp", "circular")


class TouchTables(NamedTuple):
    """What both models need to know of the fitted measurement model.

    Attributes:
        log_prob: log P_k(b | x_l, w_m), finite rows also for untrained classes, shape (L, M, K, B).
        log_trained: 0 for a trained class and -inf for an untrained one, shape (L, M).
        exponent: Power of the likelihood product, 1/J in Eq. 1.
    """

    log_prob: jax.Array
    log_trained: jax.Array
    exponent: float


class MoveKernel(NamedTuple):
    """Eq. 9 as a transition: p(where', what' | where, what) for one commanded move.

    Attributes:
        where: p(where' | where), shape (L, L), rows sum to one.
        redraws_what: Whether leaving from `where` draws the object anew, uniformly over all; shape (L,).
    """

    where: NDArray[np.float64]
    redraws_what: NDArray[np.bool_]


class TapCounts(dist.Distribution):
    """Occupation counts of a tap's samples, all taxels and bins at once.

    The order of the samples drops out of Eq. 1, so the counts carry the same likelihood; no multinomial coefficient
    is added, which keeps the evidence that of the samples.

    Args:
        log_prob_table: log P_k(b | class), shape (..., K, B).
    """

    support = dist.constraints.independent(dist.constraints.nonnegative_integer, 2)  # pyright: ignore
    arg_constraints = {"log_prob_table": dist.constraints.independent(dist.constraints.real, 2)}  # noqa: RUF012

    def __init__(self, log_prob_table: jax.Array, *, validate_args: bool | None = None) -> None:
        self.log_prob_table = log_prob_table
        super().__init__(log_prob_table.shape[:-2], log_prob_table.shape[-2:], validate_args=validate_args)

    def log_prob(self, value: ArrayLike, intermediates: object = None) -> jax.Array:  # noqa: ARG002
        """Sum over taxels and bins of counts times log probability; bins never hit do not count."""
        counts = jnp.asarray(value)
        terms = jnp.where(counts > 0, counts * self.log_prob_table, 0.0)
        return terms.sum((-2, -1))


def move_kernel(L: int, delta: int, border: str) -> MoveKernel:
    """The kernel of a move by `delta` classes.

    Args:
        L: Number of where classes.
        delta: Where classes moved.
        border: `uniform`, `uniform_what`, `clamp` or `circular`, as in `inference.reference.shift`.

    Raises:
        ValueError: The border is `prior`, which renormalises the belief and is no kernel, or is unknown.
    """
    if border not in KERNEL_BORDERS:
        raise ValueError(f"border {border!r} is no Markov kernel; the NumPyro models take {', '.join(KERNEL_BORDERS)}.")
    target = np.arange(L) + delta
    if border == "circular":
        target %= L
    if border == "clamp":
        target = np.clip(target, 0, L - 1)
    inside = (target >= 0) & (target < L)
    vacated = np.ones(L, dtype=bool)
    vacated[target[inside]] = False
    where = np.zeros((L, L))
    where[inside, target[inside]] = 1.0
    if not inside.all():
        where[~inside] = vacated / vacated.sum()
    return MoveKernel(where, ~inside if border == "uniform" else np.zeros(L, dtype=bool))


def split_prior(log_prior: jax.Array) -> tuple[jax.Array, jax.Array]:
    """A joint log prior (L, M) as log p(where), shape (L,), and log p(what | where), shape (L, M).

    Rows that are impossible as a whole get a flat conditional, which their zero probability cancels.
    """
    log_where = jax.nn.logsumexp(log_prior, axis=1)
    impossible = jnp.isneginf(log_where)[:, None]
    return log_where, jnp.where(impossible, 0.0, log_prior - jnp.where(impossible, 0.0, log_where[:, None]))


def one_tap(tables: TouchTables, log_prior: jax.Array, bins: ArrayLike) -> None:
    """One tap on an object of unknown place and kind; Eq. 1 and 3.

    Args:
        tables: The fitted measurement model.
        log_prior: Log belief before the tap, shape (L, M).
        bins: Bin of each sample and taxel, shape (J, K).
    """
    log_where, log_what = split_prior(log_prior)
    where = numpyro.sample("where", dist.CategoricalLogits(logits=log_where))
    what = numpyro.sample("what", dist.CategoricalLogits(logits=log_what[where]))
    numpyro.factor("trained", tables.log_trained[where, what])
    J, K = jnp.shape(bins)
    # The J-th root of Eq. 1 is a tempered likelihood: all samples of a taxel together count as one.
    with (
        numpyro.handlers.scale(scale=tables.exponent),
        numpyro.plate("J", J, dim=-2),
        numpyro.plate("K", K, dim=-1),
    ):
        numpyro.sample("bins", dist.CategoricalLogits(logits=tables.log_prob[where, what]), obs=bins)


def tap_sequence(
    tables: TouchTables,
    log_where: jax.Array,
    log_what: jax.Array,
    counts: jax.Array,
    log_where_kernel: jax.Array,
    log_what_kernel: jax.Array,
    used: jax.Array,
    probe: jax.Array,
) -> None:
    """A sequence of T taps with a move before each but the first; Eq. 1, 3, 4 and 9.

    To be enumerated with `numpyro.contrib.funsor`. The gradient of its log evidence with respect to `probe[t]` is
    the posterior of (where_t, what_t).

    Args:
        tables: The fitted measurement model.
        log_where: log p(where_0), shape (L,), see `split_prior`.
        log_what: log p(what_0 | where_0), shape (L, M).
        counts: Occupation counts of every tap, shape (T, K, B).
        log_where_kernel: log p(where_t | where_{t-1}), shape (T, L, L); entry 0 is not used.
        log_what_kernel: log p(what_t | where_{t-1}, what_{t-1}), shape (T, L, M, M); entry 0 is not used.
        used: Whether each tap is observed, shape (T,).
        probe: Zeros, shape (T, L, M).
    """
    where, what = None, None
    for t in markov(range(len(counts))):
        if where is None:
            where = numpyro.sample("where_0", dist.CategoricalLogits(logits=log_where))
            what = numpyro.sample("what_0", dist.CategoricalLogits(logits=Vindex(log_what)[where]))
        else:
            before = where
            where = numpyro.sample(f"where_{t}", dist.CategoricalLogits(logits=Vindex(log_where_kernel[t])[before]))
            what = numpyro.sample(f"what_{t}", dist.CategoricalLogits(logits=Vindex(log_what_kernel[t])[before, what]))
        numpyro.factor(f"probe_{t}", Vindex(probe[t])[where, what])
        with numpyro.handlers.mask(mask=used[t]):
            numpyro.factor(f"trained_{t}", Vindex(tables.log_trained)[where, what])
            with numpyro.handlers.scale(scale=tables.exponent):
                numpyro.sample(f"tap_{t}", TapCounts(Vindex(tables.log_prob)[where, what]), obs=counts[t])
