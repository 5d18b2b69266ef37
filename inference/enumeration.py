"""Exact posteriors by enumerating the NumPyro models of `models.touch` over all classes.

Two independent routes. `NumpyroEngine` evaluates the log joint of the one-tap model at every class, compiled once,
and recurses in the log domain, so any number of taps will do. `enumerate_sequence` hands the model of a whole
sequence to funsor, which sums over all paths of classes; it contracts in the linear domain and underflows on long
sequences, so it serves as a check for up to 20 taps.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp
from numpy.typing import ArrayLike, NDArray
from numpyro.infer.util import log_density

from ..models.errors import InputError
from ..models.histogram import HistogramModel
from ..models.touch import KERNEL_BORDERS, MoveKernel, TouchTables, move_kernel, one_tap, split_prior, tap_sequence
from .reference import Border, ZeroEvidenceError

MAX_SEQUENCE = 20
# Stands for log 0 in the linear-domain contraction, whose gradient is NaN at -inf: below any probability that can
# matter in float64, above its underflow at -745.
_IMPOSSIBLE = -600.0
_PRECISION = 1e-16


class SequenceUnderflowError(ArithmeticError):
    """The whole-sequence enumeration left the range of float64; fewer taps may fit."""


class SequencePosterior(NamedTuple):
    """What the enumerated sequence model says; index t counts taps from 0.

    Attributes:
        log_evidence: log P(z_0 .. z_t) for every t, shape (T,).
        filtered: P(class_t | z_0 .. z_t), shape (T, L, M).
        smoothed: P(class_t | z_0 .. z_{T-1}), shape (T, L, M).
    """

    log_evidence: NDArray[np.float64]
    filtered: NDArray[np.float64]
    smoothed: NDArray[np.float64]


def touch_tables(model: HistogramModel) -> TouchTables:
    """The fitted model as float64 JAX arrays; to be called where x64 is enabled."""
    return TouchTables(
        jnp.asarray(model.log_prob), jnp.where(jnp.asarray(model.trained), 0.0, -jnp.inf), model.exponent
    )


@jax.jit
def log_joint(tables: TouchTables, log_prior: jax.Array, bins: jax.Array) -> jax.Array:
    """Log p(class, tap) of the one-tap model at every class, shape (L, M)."""
    L, M = log_prior.shape

    def at(c: jax.Array) -> jax.Array:
        return jnp.asarray(log_density(one_tap, (tables, log_prior, bins), {}, {"where": c // M, "what": c % M})[0])

    return jax.vmap(at)(jnp.arange(L * M)).reshape(L, M)


@jax.jit
def _update(tables: TouchTables, log_belief: jax.Array, bins: jax.Array) -> tuple[jax.Array, jax.Array]:
    joint = log_joint(tables, log_belief, bins)
    log_evidence = logsumexp(joint)
    return joint - log_evidence, log_evidence


@jax.jit
def _predict(log_belief: jax.Array, where_kernel: jax.Array, redraws_what: jax.Array) -> jax.Array:
    """The belief through a `MoveKernel`: the sum over all previous classes, in logs."""
    M = log_belief.shape[1]
    log_kernel = jnp.log(where_kernel)
    kept = jnp.where(redraws_what[:, None], -jnp.inf, log_belief)
    drawn = jnp.where(redraws_what, logsumexp(log_belief, axis=1) - jnp.log(M), -jnp.inf)
    same_what = logsumexp(log_kernel[:, :, None] + kept[:, None, :], axis=0)
    new_what = logsumexp(log_kernel + drawn[:, None], axis=0)
    return jnp.logaddexp(same_what, new_what[:, None])


@dataclass(frozen=True)
class NumpyroEngine:
    """The one-tap NumPyro model, enumerated over all classes and recursed in the log domain, in float64.

    Attributes:
        model: The fitted measurement model.
        border: Reading of Eq. 9; must be a Markov kernel.

    Raises:
        InputError: The border is `prior`, which is no kernel.
    """

    model: HistogramModel
    border: Border = "uniform"
    name: str = "numpyro"

    def __post_init__(self) -> None:
        """Checks the border."""
        check_kernel_border(self.border)

    @cached_property
    def tables(self) -> TouchTables:
        """The fitted model on the device."""
        with jax.enable_x64(True):
            return touch_tables(self.model)

    def update(self, log_belief: NDArray[np.float64], tap: ArrayLike) -> tuple[NDArray[np.float64], float]:
        """Eq. 1, 3 and 4.

        Raises:
            ZeroEvidenceError: The tap is impossible under every class.
        """
        bins = self.model.bins(tap)
        with jax.enable_x64(True):
            posterior, log_evidence = _update(self.tables, jnp.asarray(log_belief), jnp.asarray(bins))
            if not np.isfinite(log_evidence):
                raise ZeroEvidenceError("The tap is impossible under every class that is still believed in.")
            return np.asarray(posterior), float(log_evidence)

    def shift(self, log_belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Eq. 9 as the transition of the sequence model."""
        kernel = move_kernel(len(log_belief), int(delta), self.border)
        with jax.enable_x64(True):
            return np.asarray(
                _predict(jnp.asarray(log_belief), jnp.asarray(kernel.where), jnp.asarray(kernel.redraws_what))
            )


def check_kernel_border(border: str) -> None:
    """Refuses readings of Eq. 9 that are no Markov kernel.

    Raises:
        InputError: The border is no kernel.
    """
    if border not in KERNEL_BORDERS:
        raise InputError(
            f"The border {border!r} renormalises the belief and is no Markov kernel, so the NumPyro models cannot "
            f"carry it; they take {', '.join(KERNEL_BORDERS)}."
        )


def enumerate_sequence(
    model: HistogramModel, taps: ArrayLike, deltas: Sequence[int], border: Border = "uniform"
) -> SequencePosterior:
    """The posterior of a whole sequence by funsor's sum over all paths of classes.

    The filtered posteriors are the gradients of the log evidence of each prefix, the smoothed ones those of the
    whole.

    Args:
        model: The fitted measurement model.
        taps: Prepared samples, shape (T, J, K), T at most 20.
        deltas: The move before each tap but the first, T - 1 whole numbers.
        border: Reading of Eq. 9; must be a Markov kernel.

    Raises:
        InputError: The border is no kernel, or numbers of taps and moves do not fit.
        ZeroEvidenceError: A tap is impossible under every class.
        SequenceUnderflowError: The result is not finite.
    """
    check_kernel_border(border)
    taps = np.asarray(taps)
    T, (L, M) = len(taps), model.grid.shape
    if not 1 <= T <= MAX_SEQUENCE or len(deltas) != T - 1:
        raise InputError(
            f"Whole sequences of 1 to {MAX_SEQUENCE} taps with one move between two taps can be enumerated, "
            f"got {T} taps and {len(deltas)} moves."
        )
    log_likelihood = model.log_likelihood(taps)
    _check_spread(log_likelihood)
    likeliest = log_likelihood.max(axis=(1, 2))
    kernels = [move_kernel(L, 0, border), *(move_kernel(L, int(delta), border) for delta in deltas)]
    bins = model.bins(taps)
    counts = (bins[..., None] == np.arange(model.counts.shape[-1])).sum(axis=1)
    impossible_bin = _IMPOSSIBLE + likeliest.min()  # so low that one sample there outweighs all others of its tap
    with jax.enable_x64(True):
        log_where, log_what = split_prior(jnp.asarray(model.log_prior))
        tables = touch_tables(model)
        arguments = (
            tables._replace(
                log_prob=jnp.where(jnp.isneginf(tables.log_prob), impossible_bin / tables.exponent, tables.log_prob),
                log_trained=_floored(tables.log_trained),
            ),
            _floored(log_where),
            _floored(log_what),
            jnp.asarray(counts, dtype=float),
            _floored(jnp.log(jnp.asarray([kernel.where for kernel in kernels]))),
            _floored(jnp.log(jnp.asarray([_what_kernel(kernel, M) for kernel in kernels]))),
        )
        log_evidence, posterior = _sequence(arguments, jnp.tril(jnp.ones((T, T), dtype=bool)))
        log_evidence, posterior = np.asarray(log_evidence), np.asarray(posterior)
    # Paths that are impossible weigh at most this much; what they stand beside must be far heavier.
    ignored = _IMPOSSIBLE + likeliest.cumsum() + np.log(T * L * M)
    finite = np.isfinite(log_evidence).all() and np.isfinite(posterior).all()
    if not finite or (log_evidence < ignored - np.log(_PRECISION)).any():
        raise SequenceUnderflowError(
            f"Enumerating {T} taps at once left the range of float64: funsor contracts in the linear domain."
        )
    return SequencePosterior(log_evidence, posterior[np.arange(T), np.arange(T)], posterior[-1])


@jax.jit
def _sequence(arguments: tuple, prefixes: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Log evidence (T,) and posteriors (T, T, L, M) of every prefix of a sequence; row t knows taps 0 .. t."""
    from numpyro.contrib.funsor import config_enumerate, enum  # noqa: PLC0415 - sets funsor's backend when imported
    from numpyro.contrib.funsor.infer_util import log_density as enumerated_log_density  # noqa: PLC0415

    model = enum(config_enumerate(tap_sequence), first_available_dim=-1)
    T, (L, M) = len(prefixes), arguments[2].shape

    def log_evidence(probe: jax.Array, used: jax.Array) -> jax.Array:
        return jnp.asarray(enumerated_log_density(model, (*arguments, used, probe), {}, {})[0])

    return jax.vmap(partial(jax.value_and_grad(log_evidence), jnp.zeros((T, L, M))))(prefixes)


def _what_kernel(kernel: MoveKernel, M: int) -> NDArray[np.float64]:
    """p(what' | where, what), shape (L, M, M)."""
    return np.where(kernel.redraws_what[:, None, None], 1.0 / M, np.eye(M))


def _floored(log_probability: jax.Array) -> jax.Array:
    return jnp.maximum(log_probability, _IMPOSSIBLE)


def _check_spread(log_likelihood: NDArray[np.float64]) -> None:
    """Raises where one tap alone spans more than the stand-in for log 0 can tell from impossible."""
    if np.isneginf(log_likelihood).all(axis=(1, 2)).any():
        raise ZeroEvidenceError("A tap is impossible under every class.")
    finite = np.where(np.isneginf(log_likelihood), np.nan, log_likelihood)
    spread = float((np.nanmax(finite, axis=(1, 2)) - np.nanmin(finite, axis=(1, 2))).max())
    if spread > -_IMPOSSIBLE - 50:
        raise SequenceUnderflowError(
            f"The log-likelihoods of one tap spread over {spread:.0f}, too far for the linear domain of funsor."
        )
