"""Exact posteriors by enumeration of the NumPyro models in `models.touch` over all positions, objects and states.

Two independent routes. `NumpyroEngine` evaluates the log joint of the one-tap model at every position and hypothesis,
compiled once, and recurses in the log domain, for any number of taps. `enumerate_sequence` passes the model of a whole
sequence to funsor, which sums over all paths of classes; it contracts in the linear domain and underflows on long
sequences, so it serves as a check for up to 20 taps.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp
from numpy.typing import ArrayLike, NDArray
from numpyro.infer.util import log_density

from ...models.errors import InputError
from ...models.measurement.likelihood.bins import TableForm
from ...models.measurement.likelihood.forms import GaussianForm
from ...models.measurement.likelihood.mixture import MixtureForm
from ...models.measurement.model import TapModel
from ...models.touch import (
    KERNEL_BORDERS,
    CountedTaps,
    MoveKernel,
    SplitPrior,
    StackedForm,
    TouchTables,
    WeighedTaps,
    move_kernel,
    observe_tap,
    one_tap,
    split_prior,
    tap_sequence,
)
from ..reference import Border, ZeroEvidenceError
from .hole_kernel import hole_kernel

MAX_SEQUENCE = 20
# Stands for log 0 in the linear-domain contraction, whose gradient is NaN at -inf: below any probability that can
# matter in float64, above its underflow at -745.
_IMPOSSIBLE = -600.0
_PRECISION = 1e-16
_COPIES = 8  # numbers per sample and class that a generative model holds
_TAPS = 16
# Compiling the sum over all paths takes seconds: it runs a few times, in a third less time with a few optimizations.
_FEW_RUNS = {"xla_backend_optimization_level": 1, "xla_llvm_disable_expensive_passes": True}
_LITTLE = {"xla_backend_optimization_level": 1}  # updates as fast as with all optimizations, compiled in less time
# Positions, objects, samples, taxels and bins that tables, beliefs, moves and taps are filled up to, so that small ones
# share a program.
_WHERE, _WHAT, _SAMPLES, _TAXELS, _BINS = 6, 4, 4, 4, 16
_AT_ONCE = 1 << 23  # numbers that one step of an enumeration holds


class SequenceUnderflowError(ArithmeticError):
    """The enumeration of a whole sequence left the range of float64; use fewer taps."""


class SequencePosterior(NamedTuple):
    """Posteriors of the enumerated sequence model; index t counts taps from 0.

    Attributes:
        log_evidence: log P(z_0 .. z_t) for every t, shape (T,).
        filtered: P(where and hypothesis at t | z_0 .. z_t), shape (T, L, H).
        smoothed: P(where and hypothesis at t | z_0 .. z_{T-1}), shape (T, L, H).
    """

    log_evidence: NDArray[np.float64]
    filtered: NDArray[np.float64]
    smoothed: NDArray[np.float64]


def touch_tables(model: TapModel) -> TouchTables:
    """The fitted model as float64 JAX arrays; requires x64 to be enabled."""
    form, edges, log_trained = model.form, model.edges, np.where(model.trained, 0.0, -np.inf)
    if isinstance(form, TableForm):
        log_prob = _filled(form.log_prob, (_BINS,), -np.inf)
        if form.shape == log_trained.shape:  # one state
            log_prob = _filled(log_prob, (_WHERE, _WHAT, 1, 1), 0.0)
            log_trained = _filled(log_trained, (_WHERE, _WHAT), -np.inf)
        form, edges = TableForm(_filled(log_prob, (_TAXELS, _BINS), 0.0)), np.empty(0)  # tables are not over samples
    elif isinstance(form, MixtureForm):
        form = StackedForm(jax.tree.map(lambda *parts: np.stack(parts), *form.parts))
    # `asarray` would compile a program for every new shape.
    form, edges, log_trained = jax.device_put((form, edges, log_trained))
    return TouchTables(form, edges, log_trained, model.exponent)


def observed(model: TapModel, taps: ArrayLike) -> NDArray[np.generic]:
    """Taps (..., J, K) as `models.touch.observe_tap` takes them: bins for table forms, samples for others.

    Bins are filled up to `_SAMPLES` and `_TAXELS` with some that do not count.

    Raises:
        InputError: The taps differ in shape from the training taps, or a sample is NaN or infinite.
    """
    bins = model.bins(taps)
    if isinstance(model.form, TableForm):
        return _filled(bins, (_SAMPLES, _TAXELS), -1)
    return np.asarray(taps, dtype=np.float64)


def _filled(values: NDArray[Any], least: tuple[int, ...], value: float) -> NDArray[Any]:
    """Values with more of them at the end of the last axes, where these are shorter."""
    have = values.shape[-len(least) :]
    filled = np.full((*values.shape[: -len(least)], *map(max, have, least)), value, values.dtype)
    filled[(..., *map(slice, have))] = values
    return filled


@jax.jit
def log_joint(tables: TouchTables, log_prior: jax.Array, tap: jax.Array) -> jax.Array:
    """Log p(where, hypothesis, tap) of the one-tap model, shape (L, H)."""
    L, H = log_prior.shape
    M = tables.log_trained.shape[1]
    in_states = log_prior.reshape(L, H // M, M)

    def at(c: jax.Array) -> jax.Array:
        sites = {"where": c // H, "session": c % H // M, "what": c % M}
        return jnp.asarray(log_density(one_tap, (tables, in_states, tap), {}, sites)[0])

    return _everywhere(at, tables, tap)


def log_likelihoods(model: TapModel, taps: ArrayLike) -> NDArray[np.float64]:
    """Log p(tap | where, hypothesis) at power 1 of every tap (T, J, K), shape (T, L, H); requires x64 to be enabled."""
    seen, (L, H) = observed(model, taps), model.form.shape
    T, missing = len(seen), -len(seen) % _TAPS
    if T == 0:
        return np.empty((0, L, H))
    tables, padded = touch_tables(model), np.concatenate([seen, np.repeat(seen[-1:], missing, axis=0)])
    parts = [np.asarray(_of_taps(tables, part)) for part in padded.reshape(-1, _TAPS, *seen.shape[1:])]
    return np.concatenate(parts)[:T, :L, :H]


@partial(jax.jit, compiler_options=_FEW_RUNS)
def _of_taps(tables: TouchTables, taps: jax.Array) -> jax.Array:
    """Log-likelihoods of `_TAPS` taps, so that other numbers of taps are not compiled anew."""
    H = tables.form.shape[1]

    def of(tap: jax.Array) -> jax.Array:
        def at(c: jax.Array) -> jax.Array:
            return jnp.asarray(log_density(observe_tap, (tables, c // H, c % H, tap), {}, {})[0])

        return _everywhere(at, tables, tap)

    return jax.lax.map(of, taps)


def _everywhere(at: Callable[[jax.Array], jax.Array], tables: TouchTables, tap: jax.Array) -> jax.Array:
    """`at` for every position and hypothesis c = l H + h, in batches that fit into memory; shape (L, H)."""
    L, H = tables.form.shape
    form = tables.form
    copies = _COPIES
    if isinstance(form, TableForm):
        copies = form.log_prob.shape[-1]
    elif isinstance(form, GaussianForm):
        copies = len(form.log_weight)
    step = max(1, _AT_ONCE // (copies * tap.size))
    cells = jnp.arange(L * H)
    values = jax.vmap(at)(cells) if step >= L * H else jax.lax.map(at, cells, batch_size=step)
    return values.reshape(L, H)


@partial(jax.jit, compiler_options=_LITTLE)
def _update(tables: TouchTables, log_belief: jax.Array, tap: jax.Array) -> tuple[jax.Array, jax.Array]:
    joint = log_joint(tables, log_belief, tap)
    log_evidence = logsumexp(joint)
    return joint - log_evidence, log_evidence


@partial(jax.jit, compiler_options=_LITTLE)
def _predict(before: jax.Array, where_kernel: jax.Array, redraws_what: jax.Array, log_objects: float) -> jax.Array:
    """The belief (L, S, M) through a `MoveKernel`: the sum over all previous classes, in logs, state by state."""
    drawn = logsumexp(before, axis=2, keepdims=True) - log_objects
    moved = jnp.where(redraws_what[:, None, None], drawn, before)
    return logsumexp(jnp.log(where_kernel)[:, :, None, None] + moved[:, None], axis=0)


@partial(jax.jit, compiler_options=_LITTLE)
def _predict_around(before: jax.Array, where_kernel: jax.Array, redrawn: jax.Array, vacated: jax.Array) -> jax.Array:
    """As `_predict`, through a `HoleKernel`."""
    kept = jnp.where(redrawn[:, None], -jnp.inf, before)
    drawn = logsumexp(jnp.where(redrawn[:, None], before, -jnp.inf), axis=(0, 2), keepdims=True)
    same_what = logsumexp(jnp.log(jnp.moveaxis(where_kernel, 2, 1))[:, :, None] + kept[:, None], axis=0)
    return jnp.logaddexp(same_what, drawn + jnp.log(vacated)[:, None])


@dataclass(frozen=True)
class NumpyroEngine:
    """The one-tap NumPyro model, enumerated over all classes, with recursion in the log domain, in float64.

    Attributes:
        model: The fitted measurement model.
        border: Interpretation of Eq. 9 at the ends of the range; must be a Markov kernel.

    Raises:
        InputError: The border is `prior`, which is not a kernel.
    """

    model: TapModel
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
        seen, (L, H) = observed(self.model, tap), log_belief.shape
        before = _filled(log_belief, self.tables.log_trained.shape, -np.inf)
        with jax.enable_x64(True):
            posterior, log_evidence = _update(self.tables, before, seen)
            log_evidence = float(log_evidence)  # before the array, whose copy would be waited for on another thread
            if not math.isfinite(log_evidence):
                raise ZeroEvidenceError("The tap is impossible under every class with nonzero belief.")
            return np.asarray(posterior)[:L, :H], log_evidence

    def shift(self, log_belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Eq. 9 as the transition of the sequence model."""
        trained, (L, M) = self.model.trained, self.model.grid.shape
        before = _filled(log_belief.reshape(L, -1, M), (_WHERE, 1, _WHAT), -np.inf)
        with jax.enable_x64(True):
            if trained.all():
                kernel = move_kernel(L, int(delta), self.border)
                parts = _filled(kernel.where, (_WHERE, _WHERE), 0.0), _filled(kernel.redraws_what, (_WHERE,), False)
                after = _predict(before, *parts, math.log(M))
            else:
                around = hole_kernel(trained, int(delta), self.border)
                sizes = (_WHERE, _WHAT, _WHERE), (_WHERE, _WHAT), (_WHERE, _WHAT)
                after = _predict_around(before, *map(_filled, around, sizes, (0, 0, 0)))
            return np.asarray(after)[:L, :, :M].reshape(log_belief.shape)


def check_kernel_border(border: str) -> None:
    """Refuses borders that are not Markov kernels.

    Raises:
        InputError: The border is not a kernel.
    """
    if border not in KERNEL_BORDERS:
        raise InputError(
            f"The NumPyro models do not support border {border!r}, which renormalises the belief and is not a Markov "
            f"kernel; use {', '.join(KERNEL_BORDERS)}."
        )


def enumerate_sequence(
    model: TapModel, taps: ArrayLike, deltas: Sequence[int], border: Border = "uniform"
) -> SequencePosterior:
    """Posterior of a whole sequence by funsor's sum over all paths of classes and all states.

    The filtered posteriors are the gradients of the log evidence of each prefix, the smoothed ones those of the
    whole.

    Args:
        model: The fitted measurement model.
        taps: Preprocessed samples, shape (T, J, K), T at most 20.
        deltas: Move before each tap except the first, T - 1 integers.
        border: Interpretation of Eq. 9 at the ends of the range; must be a Markov kernel.

    Raises:
        InputError: The border is not a kernel, or the numbers of taps and moves do not match.
        ZeroEvidenceError: A tap is impossible under every class.
        SequenceUnderflowError: The result is not finite.
    """
    check_kernel_border(border)
    taps = np.asarray(taps)
    T, (L, M), H = len(taps), model.grid.shape, model.log_prior.shape[1]
    if not 1 <= T <= MAX_SEQUENCE or len(deltas) != T - 1:
        raise InputError(
            f"A sequence must have 1 to {MAX_SEQUENCE} taps with one move between two taps, got {T} taps and "
            f"{len(deltas)} moves."
        )
    log_likelihood = model.log_likelihood(taps)
    likeliest = log_likelihood.max(axis=(1, 2))
    if np.isneginf(likeliest).any():
        raise ZeroEvidenceError("A tap is impossible under every class.")
    where_kernels, what_kernels = _kernels(model, [0, *(int(delta) for delta in deltas)], border)
    with jax.enable_x64(True):
        arguments = (
            np.float64(model.exponent),
            _split_prior(model.log_prior.reshape(L, H // M, M)),
            _sequence_taps(model, taps, log_likelihood),
            _log_floored(where_kernels),
            _log_floored(what_kernels),
        )
        log_evidence, posterior = _sequence(arguments, np.tri(T, dtype=bool))
        log_evidence, posterior = np.asarray(log_evidence), np.moveaxis(np.asarray(posterior), 2, 3)
    # Largest weight of impossible paths; possible ones must weigh far more.
    ignored = _IMPOSSIBLE + likeliest.cumsum() + np.log(T * L * H)
    finite = np.isfinite(log_evidence).all() and np.isfinite(posterior).all()
    if not finite or (log_evidence < ignored - np.log(_PRECISION)).any():
        raise SequenceUnderflowError(
            f"Enumerating {T} taps at once underflowed, as funsor contracts in the linear domain; use fewer taps."
        )
    posterior = posterior.reshape(T, T, L, H)
    return SequencePosterior(log_evidence, posterior[np.arange(T), np.arange(T)], posterior[-1])


def _sequence_taps(
    model: TapModel, taps: NDArray[np.floating], log_likelihood: NDArray[np.float64]
) -> CountedTaps | WeighedTaps:
    """Taps (T, J, K) as the sequence model observes them, with a stand-in for log 0.

    Counts are used on full grids, for independent samples, without states, and if `log_likelihood` (T, L, H) varies
    so little over the classes that the stand-in is far below all of it.
    """
    form = model.form
    (L, H), M = form.shape, model.grid.M
    likeliest = log_likelihood.max(axis=(1, 2))
    full = model.trained.all()
    if full and isinstance(form, TableForm) and H == M and _spread(log_likelihood) < -_IMPOSSIBLE - 50:
        # So low that one sample there outweighs all others of its tap.
        impossible_bin = (_IMPOSSIBLE + likeliest.min()) / model.exponent
        counts = (model.bins(taps)[..., None] == np.arange(form.log_prob.shape[-1])).sum(axis=1)
        log_prob = np.where(np.isneginf(form.log_prob), impossible_bin, form.log_prob)
        return CountedTaps(*jax.device_put((log_prob, counts.astype(float))))
    least = (_IMPOSSIBLE + likeliest)[:, None, None] / model.exponent
    weights = np.maximum(log_likelihoods(model, taps), least)
    weights = weights.reshape(len(taps), L, H // M, M)
    if not full:  # paths through holes must not outweigh others, whatever their tables hold
        most = likeliest[:, None, None, None] / model.exponent
        weights = np.where(model.trained[:, None], weights, most)
    return WeighedTaps(jax.device_put(np.moveaxis(weights, 2, 1)))


@jax.jit
def _split_prior(log_prior: jax.Array) -> SplitPrior:
    """`split_prior` with a stand-in for log 0."""
    return SplitPrior(*(jnp.maximum(part, _IMPOSSIBLE) for part in split_prior(log_prior)))


@partial(jax.jit, compiler_options=_FEW_RUNS)
def _sequence(arguments: tuple, prefixes: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Log evidence (T,) and posteriors (T, T, S, L, M) of every prefix of a sequence; row t knows taps 0 .. t."""
    from numpyro.contrib.funsor import config_enumerate, enum  # noqa: PLC0415 - sets funsor's backend when imported
    from numpyro.contrib.funsor.infer_util import log_density as enumerated_log_density  # noqa: PLC0415

    model = enum(config_enumerate(tap_sequence), first_available_dim=-1)
    T, log_what = len(prefixes), arguments[1].log_what

    def log_evidence(probe: jax.Array, used: jax.Array) -> jax.Array:
        return jnp.asarray(enumerated_log_density(model, (*arguments, used, probe), {}, {})[0])

    return jax.vmap(partial(jax.value_and_grad(log_evidence), jnp.zeros((T, *log_what.shape))))(prefixes)


def _kernels(
    model: TapModel, deltas: Sequence[int], border: Border
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Kernels p(where' | ...) and p(what' | where, what) of each move, in the form of `tap_sequence`."""
    if model.trained.all():
        kernels = [move_kernel(model.grid.L, delta, border) for delta in deltas]
        return [kernel.where for kernel in kernels], [_what_kernel(kernel, model.grid.M) for kernel in kernels]
    around = [hole_kernel(model.trained, delta, border) for delta in deltas]
    return [kernel.where_kernel() for kernel in around], [kernel.what_kernel() for kernel in around]


def _what_kernel(kernel: MoveKernel, M: int) -> NDArray[np.float64]:
    """p(what' | where, what), shape (L, M, M)."""
    return np.where(kernel.redraws_what[:, None, None], 1.0 / M, np.eye(M))


def _log_floored(probability: ArrayLike) -> NDArray[np.float64]:
    """Logarithms with a stand-in for log 0."""
    with np.errstate(divide="ignore"):
        return np.maximum(np.log(probability), _IMPOSSIBLE)


def _spread(log_likelihood: NDArray[np.float64]) -> float:
    """Largest difference of log-likelihoods (T, L, H) between possible classes in one tap."""
    possible = np.where(np.isneginf(log_likelihood), np.nan, log_likelihood)
    return float((np.nanmax(possible, axis=(1, 2)) - np.nanmin(possible, axis=(1, 2))).max())
