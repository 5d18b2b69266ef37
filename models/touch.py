"""NumPyro models of one tap and of a sequence of taps with moves, under any measurement model.

Unknowns are where_t and what_t, the position and the object, and session, the state shared by all taps of an episode
(see `states`; most measurement models have only one). Positions change only by commanded moves, so the transition is
Eq. 9 of the paper as a Markov kernel. References: Lepora, Martinez-Hernandez and
Prescott, "A SOLID case for active Bayesian perception in robot touch" (2013), Eq. 1, 3, 4, 9.

Untrained classes (cells without a training tap) are impossible at every tap: a flat histogram in their place would win
for every unusual tap.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax.typing import ArrayLike
from numpy.typing import NDArray
from numpyro.contrib.funsor import markov
from numpyro.infer.util import log_density
from numpyro.ops.indexing import Vindex

from .measurement.likelihood.binned import BinnedTap, bin_indices
from .measurement.likelihood.bins import TableForm
from .measurement.likelihood.forms import GaussianForm

KERNEL_BORDERS = ("uniform", "uniform_what", "clamp", "circular")


class TouchTables(NamedTuple):
    """Tables of the fitted measurement model for both models.

    Attributes:
        form: Probability of a tap's bins, finite also for untrained classes; see `forms`.
        edges: Bin edges, shape (B + 1,) or (K, B + 1).
        log_trained: 0 for a trained class and -inf for an untrained one, shape (L, M).
        exponent: Power of the likelihood, 1/J in Eq. 1.
    """

    form: Any
    edges: jax.Array
    log_trained: jax.Array
    exponent: float


class StackedForm(NamedTuple):
    """A `MixtureForm` whose parts stand side by side in every array.

    Attributes:
        parts: A form whose arrays have the axis of the parts in front.
    """

    parts: Any

    @property
    def shape(self) -> tuple[int, int]:
        """(L, H)."""
        return jax.tree.map(lambda values: values[0], self.parts).shape


class SplitPrior(NamedTuple):
    """A joint prior as a chain of conditionals.

    Attributes:
        log_session: log p(session), shape (S,).
        log_where: log p(where | session), shape (S, L).
        log_what: log p(what | session, where), shape (S, L, M).
    """

    log_session: jax.Array
    log_where: jax.Array
    log_what: jax.Array


class CountedTaps(NamedTuple):
    """Taps of a sequence under a measurement model of independent samples without states.

    Attributes:
        log_prob: log P_k(b | x_l, w_m), shape (L, M, K, B).
        counts: Occupation counts of every tap, shape (T, K, B).
    """

    log_prob: jax.Array
    counts: jax.Array

    def observe(self, t: int, session: Any, where: Any, what: Any) -> None:  # noqa: ARG002
        """Tap t at power 1."""
        numpyro.sample(f"tap_{t}", TapCounts(Vindex(self.log_prob)[where, what]), obs=self.counts[t])


class WeighedTaps(NamedTuple):
    """Taps of a sequence under any measurement model, given by their log-likelihoods.

    Attributes:
        log_likelihood: log P(z_t | session, x_l, w_m) at power 1, shape (T, S, L, M).
    """

    log_likelihood: jax.Array

    def observe(self, t: int, session: Any, where: Any, what: Any) -> None:
        """Tap t at power 1."""
        numpyro.factor(f"tap_{t}", Vindex(self.log_likelihood[t])[session, where, what])


class MoveKernel(NamedTuple):
    """Eq. 9 as a transition: p(where', what' | where, what) for one commanded move.

    Attributes:
        where: p(where' | where), shape (L, L), rows sum to one.
        redraws_what: Whether leaving from `where` redraws the object uniformly, shape (L,).
    """

    where: NDArray[np.float64]
    redraws_what: NDArray[np.bool_]


class TapCounts(dist.Distribution):
    """Occupation counts of a tap's samples, all taxels and bins at once.

    Eq. 1 does not depend on the order of the samples, so the counts have the same likelihood; without a multinomial
    coefficient, so that the evidence is that of the samples.

    Args:
        log_prob_table: log P_k(b | class), shape (..., K, B).
    """

    support = dist.constraints.independent(dist.constraints.nonnegative_integer, 2)  # pyright: ignore
    arg_constraints = {"log_prob_table": dist.constraints.independent(dist.constraints.real, 2)}  # noqa: RUF012

    def __init__(self, log_prob_table: jax.Array, *, validate_args: bool | None = None) -> None:
        self.log_prob_table = log_prob_table
        super().__init__(log_prob_table.shape[:-2], log_prob_table.shape[-2:], validate_args=validate_args)

    def log_prob(self, value: ArrayLike, intermediates: object = None) -> jax.Array:  # noqa: ARG002
        """Sum over taxels and bins of counts times log probability; empty bins contribute 0."""
        counts = jnp.asarray(value)
        terms = jnp.where(counts > 0, counts * self.log_prob_table, 0.0)
        return terms.sum((-2, -1))


def move_kernel(L: int, delta: int, border: str) -> MoveKernel:
    """Kernel of a move by `delta` positions.

    Args:
        L: Number of positions.
        delta: Move in positions.
        border: `uniform`, `uniform_what`, `clamp` or `circular`, as in `inference.reference.shift`.

    Raises:
        ValueError: The border is `prior`, which renormalises the belief and is not a kernel, or is unknown.
    """
    if border not in KERNEL_BORDERS:
        raise ValueError(f"border {border!r} is not a Markov kernel; choose from {', '.join(KERNEL_BORDERS)}.")
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


def split_prior(log_prior: jax.Array) -> SplitPrior:
    """Chain of conditionals of a joint log prior over where, session and what, shape (L, S, M).

    Impossible conditions get a flat conditional, which their zero probability cancels.
    """
    log_joint = jnp.moveaxis(log_prior, 0, 1)
    log_session_where = jax.nn.logsumexp(log_joint, axis=2)
    log_session = jax.nn.logsumexp(log_session_where, axis=1)
    return SplitPrior(
        log_session, _conditional(log_session_where, log_session), _conditional(log_joint, log_session_where)
    )


def _conditional(log_joint: jax.Array, log_marginal: jax.Array) -> jax.Array:
    impossible = jnp.isneginf(log_marginal)[..., None]
    return jnp.where(impossible, 0.0, log_joint - jnp.where(impossible, 0.0, log_marginal[..., None]))


def one_tap(tables: TouchTables, log_prior: jax.Array, tap: ArrayLike) -> None:
    """One tap at an unknown position on an unknown object in a session of unknown state; Eq. 1 and 3.

    Args:
        tables: The fitted measurement model.
        log_prior: Log belief before the tap, shape (L, S, M).
        tap: As in `observe_tap`.
    """
    prior = split_prior(log_prior)
    session: Any = numpyro.sample("session", dist.CategoricalLogits(logits=prior.log_session))
    where = numpyro.sample("where", dist.CategoricalLogits(logits=prior.log_where[session]))
    what = numpyro.sample("what", dist.CategoricalLogits(logits=prior.log_what[session, where]))
    numpyro.factor("trained", tables.log_trained[where, what])
    # The J-th root of Eq. 1 is a tempered likelihood: all samples of a taxel together count as one.
    with numpyro.handlers.scale(scale=tables.exponent):
        observe_tap(tables, where, session * log_prior.shape[2] + what, tap)


def observe_tap(tables: TouchTables, where: Any, hypothesis: Any, tap: ArrayLike) -> None:
    """The samples of a tap at power 1.

    Args:
        tables: The fitted measurement model.
        where: Index of the position.
        hypothesis: Index of the object in its state.
        tap: Bin of each sample and taxel under a `TableForm`, the samples themselves otherwise; shape (J, K). A bin of
            -1 and a sample that is NaN do not count.
    """
    form, (J, K) = tables.form, jnp.shape(tap)
    if isinstance(form, TableForm):
        with numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            bin_of_sample, log_prob = jnp.asarray(tap), form.log_prob[where, hypothesis]
            with numpyro.handlers.mask(mask=bin_of_sample >= 0):
                numpyro.sample("bins", dist.CategoricalLogits(logits=log_prob), obs=jnp.maximum(bin_of_sample, 0))
        return
    if not isinstance(form, GaussianForm):
        numpyro.factor("tap", _log_probability(tables, where, hypothesis, tap))
        return
    taxel = jnp.broadcast_to(form.taxel, (*form.shape, *form.taxel.shape[2:]))[where, hypothesis]
    mean, scale = form.mean[:, where, hypothesis], form.scale[:, where, hypothesis]
    numpyro.sample("tap", BinnedTap(mean, scale, form.time, taxel, form.log_weight, tables.edges), obs=tap)


def _log_probability(tables: TouchTables, where: Any, hypothesis: Any, tap: ArrayLike) -> jax.Array:
    """Log probability of the bins of a tap, of a mixture as the mean over its parts."""

    def of(part: Any) -> jax.Array:
        samples = jnp.asarray(tap)
        bins = jnp.where(jnp.isnan(samples), -1, bin_indices(samples, tables.edges))
        seen = bins if isinstance(part, TableForm) else samples
        arguments = (tables._replace(form=part), where, hypothesis, seen)
        return jnp.asarray(log_density(observe_tap, arguments, {}, {})[0])

    with numpyro.handlers.block():  # sites of the parts are none of the whole
        if not isinstance(tables.form, StackedForm):
            return tables.form.log_probability(jnp.asarray(tap), tables.edges, where, hypothesis)
        each = jax.lax.map(of, tables.form.parts)
    return jax.nn.logsumexp(each) - jnp.log(len(each))


def tap_sequence(
    exponent: jax.Array,
    prior: SplitPrior,
    taps: CountedTaps | WeighedTaps,
    log_where_kernel: jax.Array,
    log_what_kernel: jax.Array,
    used: jax.Array,
    probe: jax.Array,
) -> None:
    """A sequence of T taps with a move before each but the first; Eq. 1, 3, 4 and 9.

    For enumeration with `numpyro.contrib.funsor`. The gradient of its log evidence with respect to `probe[t]` is the
    posterior of (session, where_t, what_t). Untrained classes are left to the prior and the kernels.

    Args:
        exponent: Power of the likelihood.
        prior: Prior before the first tap.
        taps: Observed taps.
        log_where_kernel: log p(where_t | where_{t-1}), shape (T, L, L), or on a grid with holes
            log p(where_t | where_{t-1}, what_{t-1}, what_t), shape (T, L, M, M, L); entry 0 is not used.
        log_what_kernel: log p(what_t | where_{t-1}, what_{t-1}), shape (T, L, M, M); entry 0 is not used.
        used: Whether each tap is observed, shape (T,).
        probe: Zeros, shape (T, S, L, M).
    """
    session = numpyro.sample("session", dist.CategoricalLogits(logits=prior.log_session))
    where, what = None, None
    for t in markov(range(len(used))):
        if where is None:
            where = numpyro.sample("where_0", dist.CategoricalLogits(logits=Vindex(prior.log_where)[session]))
            what = numpyro.sample("what_0", dist.CategoricalLogits(logits=Vindex(prior.log_what)[session, where]))
        else:
            known: Any = (where,)
            what_before = what
            what = numpyro.sample(f"what_{t}", dist.CategoricalLogits(logits=Vindex(log_what_kernel[t])[where, what]))
            if log_where_kernel.ndim > 3:
                known = (where, what_before, what)
            where = numpyro.sample(f"where_{t}", dist.CategoricalLogits(logits=Vindex(log_where_kernel[t])[known]))
        numpyro.factor(f"probe_{t}", Vindex(probe[t])[session, where, what])
        with numpyro.handlers.mask(mask=used[t]), numpyro.handlers.scale(scale=exponent):
            taps.observe(t, session, where, what)
