"""Very many perception episodes from a table of tap log-likelihoods.

Moves do not depend on the threshold theta_W, so one trajectory answers every threshold at once: it runs until the
slowest threshold is crossed, and each threshold takes the first tap at which its belief is exceeded.

Trials occupy a fixed number of slots; a slot whose trial has ended takes the next one, so nobody waits for the
slowest. Every random number comes from (seed, stream of the trial, tap), so the same seed gives the same trials
however they are cut into slots and rounds.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..hardware.pool import TapPool, tap_pool
from ..models.errors import InputError
from ..models.histogram import HistogramModel
from ..models.taps import TapSet
from . import filter as bayes
from .episode import DEADLINE
from .reference import BORDERS, Border, ZeroEvidenceError

# The paper's range of belief thresholds; its spacing is not given.
THRESHOLDS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.975, 0.99, 0.995)
_SLOTS = 1024
_ROUND = 8  # taps between two looks at which trials have ended


class TapTable(NamedTuple):
    """Test taps as perception sees them.

    Attributes:
        log_likelihood: log P(z | class) of every tap, shape (N, L, M).
        pool: Which taps belong to which class.
        log_prior: Log belief before the first tap, shape (L, M).
    """

    log_likelihood: NDArray[np.float64]
    pool: TapPool
    log_prior: NDArray[np.float64]


class TrialPlan(NamedTuple):
    """What distinguishes the trials, n of them.

    Attributes:
        where: Class in which the sensor starts, shape (n,).
        what: Class of the object, shape (n,).
        fixation: Class that the sensor aims for, shape (n,).
        stream: Random stream, shape (n,); trials of one stream see the same random numbers.
    """

    where: NDArray[np.intp]
    what: NDArray[np.intp]
    fixation: NDArray[np.intp]
    stream: NDArray[np.intp]


class Trials(NamedTuple):
    """Decisions of n trials at H thresholds; all arrays of shape (n, H).

    Attributes:
        taps: Reaction time.
        what: Decided what class.
        where: Decided where class, at the place of the last tap.
        true_where: Class in which the sensor stood then.
        stopped: Whether the threshold was crossed; otherwise the deadline came.
        clamped: Moves before the decision that the end of the range cut short.
        substituted: Times before the decision that a class without a tap was replaced by the nearest with one.
        belief: Belief in the decided what class.
    """

    taps: NDArray[np.int64]
    what: NDArray[np.int64]
    where: NDArray[np.int64]
    true_where: NDArray[np.int64]
    stopped: NDArray[np.bool_]
    clamped: NDArray[np.int64]
    substituted: NDArray[np.int64]
    belief: NDArray[np.float64]


class _Slots(NamedTuple):
    """State of the trials in progress, first axis the slot."""

    log_belief: jax.Array
    where: jax.Array
    what: jax.Array
    fixation: jax.Array
    stream: jax.Array
    tap: jax.Array
    clamped: jax.Array
    substituted: jax.Array


class _Seen(NamedTuple):
    """What one tap showed, before the move that follows it; JAX, later NumPy arrays with the axes (round, slot)."""

    what_belief: Any
    what: Any
    where: Any
    true_where: Any
    clamped: Any
    substituted: Any
    log_evidence: Any


class _Tables(NamedTuple):
    """Constant arrays of a run."""

    log_likelihood: jax.Array
    order: jax.Array
    first: jax.Array
    size: jax.Array
    nearest: jax.Array
    key: jax.Array


def tap_table(model: HistogramModel, taps: TapSet) -> TapTable:
    """The log-likelihoods of test taps and their pool.

    Args:
        model: The fitted measurement model.
        taps: Test taps, all of trained classes (see `HistogramModel.usable`).
    """
    where, what = taps.indices(model.grid)
    return TapTable(model.log_likelihood(taps.taps), tap_pool(where, what, model.grid.shape), model.log_prior)


def plan_trials(
    pool: TapPool, trials: int, seed: int, fixation: int = 0, where: int | None = None, first_stream: int = 0
) -> TrialPlan:
    """Trials that start in classes with a test tap, drawn uniformly over those.

    Args:
        pool: The test taps.
        trials: Number of trials.
        seed: Of the starting classes.
        fixation: Class that the sensor aims for.
        where: Start in this where class only; `None` for any.
        first_stream: Random stream of the first trial; the others follow.

    Raises:
        InputError: No class with a test tap is left, or there are no trials.
    """
    if trials < 1:
        raise InputError(f"There must be at least one trial, got {trials}.")
    cells = np.argwhere(pool.count > 0)
    if where is not None:
        cells = cells[cells[:, 0] == where]
    if not len(cells):
        raise InputError(f"There is no test tap in where class {where} to start from.")
    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence((seed, first_stream))))
    start = cells[generator.integers(len(cells), size=trials)]
    stream = first_stream + np.arange(trials)
    return TrialPlan(start[:, 0], start[:, 1], np.full(trials, fixation, dtype=np.intp), stream)


def join_plans(plans: Sequence[TrialPlan]) -> TrialPlan:
    """Several plans behind one another."""
    return TrialPlan(*(np.concatenate(parts) for parts in zip(*plans, strict=True)))


def trial_uniforms(seed: int, stream: int, taps: int) -> NDArray[np.float64]:
    """The random numbers of a trial, one per tap; number u picks tap floor(u * count) of the class."""
    with jax.enable_x64(True):
        return np.asarray(_uniforms(jax.random.key(seed), jnp.asarray(stream), taps))


def run_trials(
    table: TapTable,
    plan: TrialPlan,
    thresholds: ArrayLike,
    *,
    theta_x: float,
    border: Border = "uniform",
    deadline: int = DEADLINE,
    seed: int = 0,
    slots: int = _SLOTS,
    progress: Callable[[int], None] | None = None,
) -> Trials:
    """Plays the planned trials and decides each at every threshold.

    Agrees trial by trial with `episode.perceive` on a `ReplayRig` that is given `trial_uniforms`.

    Args:
        table: Test taps.
        plan: The trials.
        thresholds: theta_W, shape (H,), any order; 1 or more never stops.
        theta_x: Threshold for a move: 0 always moves, 1 never (passive).
        border: Reading of Eq. 9.
        deadline: Taps after which the most probable classes are taken.
        seed: Of the draws of taps.
        slots: Trials in progress at a time; changes the speed only.
        progress: Called with the number of trials finished since the last call.

    Raises:
        InputError: An argument is out of range.
        ZeroEvidenceError: A tap was impossible under every class still believed in.
    """
    thresholds = np.atleast_1d(np.asarray(thresholds, dtype=np.float64))
    if border not in BORDERS:
        raise InputError(f"The border must be one of {', '.join(BORDERS)}, got {border!r}.")
    if deadline < 1 or slots < 1 or not len(thresholds):
        raise InputError(f"Trials need a threshold, a deadline and slots, got {len(thresholds)}, {deadline}, {slots}.")
    with jax.enable_x64(True):
        return _play(table, plan, thresholds, theta_x, border, deadline, seed, min(slots, len(plan.where)), progress)


def _play(
    table: TapTable,
    plan: TrialPlan,
    thresholds: NDArray[np.float64],
    theta_x: float,
    border: Border,
    deadline: int,
    seed: int,
    slots: int,
    progress: Callable[[int], None] | None,
) -> Trials:
    pool = table.pool
    tables = _Tables(
        *(jnp.asarray(a) for a in (table.log_likelihood, pool.order, pool.first, pool.count, pool.nearest)),
        key=jax.random.key(seed),
    )
    ledger = _Ledger(len(plan.where), slots, thresholds, deadline)
    state = _fresh(plan, ledger.trial, table)
    while ledger.busy.any():
        state, seen = _round(tables, state, theta_x, border, theta_x < 1)
        ended = ledger.enter(_Seen(*(np.asarray(values) for values in seen)))
        if ended.any():
            ledger.refill(ended)
            state = _replace(state, jnp.asarray(ended), _fresh(plan, ledger.trial, table))
            if progress is not None:
                progress(int(ended.sum()))
    return ledger.trials


class _Ledger:
    """Which trial sits in which slot, and each threshold's first crossing.

    Attributes:
        trial: Trial of each slot, -1 for an idle slot.
        made: Taps it has made.
        undecided: Thresholds it has not crossed, shape (slots, H).
        trials: The decisions so far.
    """

    def __init__(self, n: int, slots: int, thresholds: NDArray[np.float64], deadline: int) -> None:
        H = len(thresholds)
        self.thresholds = np.where(thresholds >= 1, np.inf, thresholds)
        self.deadline = deadline
        self.trial = np.arange(slots)
        self.made = np.zeros(slots, dtype=np.int64)
        self.undecided = np.ones((slots, H), dtype=bool)
        self.trials = Trials(
            *(np.zeros((n, H), dtype=np.int64) for _ in range(4)),
            stopped=np.zeros((n, H), dtype=bool),
            clamped=np.zeros((n, H), dtype=np.int64),
            substituted=np.zeros((n, H), dtype=np.int64),
            belief=np.zeros((n, H)),
        )
        self._next = slots

    @property
    def busy(self) -> NDArray[np.bool_]:
        """Slots with a trial."""
        return self.trial >= 0

    def enter(self, seen: _Seen) -> NDArray[np.bool_]:
        """Records one round of taps and says in which slots a trial has ended.

        Raises:
            ZeroEvidenceError: A trial saw an impossible tap before its end.
        """
        tap = self.made + np.arange(len(seen.what))[:, None]
        above = (seen.what_belief[:, :, None] > self.thresholds) & (tap < self.deadline)[:, :, None]
        decides = above | (tap == self.deadline - 1)[:, :, None]
        first = decides.argmax(axis=0)
        new = decides.any(axis=0) & self.undecided & self.busy[:, None]
        self._note(new, first, above, seen)
        self.undecided &= ~new
        self.made += len(seen.what)
        ended = self.busy & ~self.undecided.any(axis=1)
        last = np.where(ended, np.where(new, first, -1).max(axis=1), len(seen.what) - 1)
        impossible = np.isneginf(seen.log_evidence) & self.busy & (np.arange(len(seen.what))[:, None] <= last)
        if impossible.any():
            raise ZeroEvidenceError(
                f"In {int(impossible.any(axis=0).sum())} trials a tap was impossible under every class that was still "
                "believed in."
            )
        return ended

    def refill(self, ended: NDArray[np.bool_]) -> None:
        """Gives the slots of ended trials the next ones, or none."""
        slots = np.flatnonzero(ended)
        waiting = self._next + np.arange(len(slots))
        self.trial[slots] = np.where(waiting < len(self.trials.taps), waiting, -1)
        self._next += len(slots)
        self.made[slots] = 0
        self.undecided[slots] = True

    def _note(self, new: NDArray[np.bool_], first: NDArray[np.intp], above: NDArray[np.bool_], seen: _Seen) -> None:
        slot, h = np.nonzero(new)
        step, row = first[slot, h], self.trial[slot]
        self.trials.taps[row, h] = self.made[slot] + step + 1
        self.trials.stopped[row, h] = above[step, slot, h]
        for name in ("what", "where", "true_where", "clamped", "substituted"):
            getattr(self.trials, name)[row, h] = getattr(seen, name)[step, slot]
        self.trials.belief[row, h] = seen.what_belief[step, slot]


def _fresh(plan: TrialPlan, trial: NDArray[np.intp], table: TapTable) -> _Slots:
    """The state before the first tap of these trials; idle slots repeat the first."""
    rows = np.maximum(trial, 0)
    where, what = table.pool.nearest[plan.where[rows], plan.what[rows]], plan.what[rows]
    zeros = jnp.zeros(len(trial), dtype=jnp.int64)
    return _Slots(
        log_belief=jnp.broadcast_to(jnp.asarray(table.log_prior), (len(trial), *table.log_prior.shape)),
        where=jnp.asarray(where),
        what=jnp.asarray(what),
        fixation=jnp.asarray(plan.fixation[rows]),
        stream=jnp.asarray(plan.stream[rows]),
        tap=zeros,
        clamped=zeros,
        substituted=jnp.asarray((where != plan.where[rows]).astype(np.int64)),
    )


@jax.jit
def _replace(state: _Slots, ended: jax.Array, fresh: _Slots) -> _Slots:
    def choose(old: jax.Array, new: jax.Array) -> jax.Array:
        return jnp.where(ended.reshape(-1, *([1] * (old.ndim - 1))), new, old)

    return jax.tree.map(choose, state, fresh)


@partial(jax.jit, static_argnames=("border", "moving"))
def _round(tables: _Tables, state: _Slots, theta_x: float, border: Border, moving: bool) -> tuple[_Slots, _Seen]:
    """A few taps in every slot."""
    step = jax.vmap(partial(_tap, tables, theta_x=theta_x, border=border, moving=moving))
    return jax.lax.scan(lambda slots, _: step(slots), state, length=_ROUND)


def _tap(tables: _Tables, slot: _Slots, *, theta_x: float, border: Border, moving: bool) -> tuple[_Slots, _Seen]:
    """One tap of one trial and the move after it; the order of `episode.perceive`."""
    uniform = _uniform(tables.key, slot.stream, slot.tap)
    number = jnp.floor(uniform * tables.size[slot.where, slot.what]).astype(jnp.int64)
    index = tables.order[tables.first[slot.where, slot.what] + number]
    log_belief, log_evidence = bayes.update(slot.log_belief, tables.log_likelihood[index])
    where_belief, what_belief = bayes.marginals(log_belief)
    seen = _Seen(
        what_belief=what_belief.max(),
        what=what_belief.argmax(),
        where=where_belief.argmax(),
        true_where=slot.where,
        clamped=slot.clamped,
        substituted=slot.substituted,
        log_evidence=log_evidence,
    )
    slot = slot._replace(log_belief=log_belief, tap=slot.tap + 1)
    return (_move(tables, slot, where_belief, theta_x, border) if moving else slot), seen


def _move(tables: _Tables, slot: _Slots, where_belief: jax.Array, theta_x: float, border: Border) -> _Slots:
    """Eq. 8 to 10; the true class is clipped to the range, the belief shifts by what was commanded."""
    delta = jnp.where(where_belief.max() > theta_x, slot.fixation - where_belief.argmax(), 0)
    commanded = slot.where + delta
    reached = jnp.clip(commanded, 0, len(where_belief) - 1)
    landed = tables.nearest[reached, slot.what]
    return slot._replace(
        log_belief=bayes.shift(slot.log_belief, delta, border),
        where=landed,
        clamped=slot.clamped + (reached != commanded),
        substituted=slot.substituted + (landed != reached),
    )


def _uniform(key: jax.Array, stream: jax.Array, tap: jax.Array) -> jax.Array:
    return jax.random.uniform(jax.random.fold_in(jax.random.fold_in(key, stream), tap), dtype=jnp.float64)


@partial(jax.jit, static_argnames="taps")
def _uniforms(key: jax.Array, stream: jax.Array, taps: int) -> jax.Array:
    return jax.vmap(partial(_uniform, key, stream))(jnp.arange(taps))
