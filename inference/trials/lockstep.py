"""Trials under any control strategy, all in lockstep, with a record of every tap.

The compiled trials of `trials.run` know the strategies of the paper. Here a strategy is asked for the moves of all
trials at once, which suits those that multiply beliefs with large tables. Trials have the random numbers of
`trials.run.run_trials`, and under its strategies take the same taps to the same beliefs. Nothing is decided here: no
move depends on when one stops, so stopping rules are read from the record afterwards, see `stopping.recorded`.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models import seeds
from ...models.errors import InputError
from ..engines.compiled import border_number, refuse_border
from ..episode import DEADLINE
from ..filter import log_fold, share, temper
from ..moves.control import MovePolicy
from ..moves.holes import Mask
from ..moves.shifts import log_sum, shift_all
from ..reference import Border
from ..stopping.stopping import Watch
from .records import TapTable, TrialPlan, checked_plan

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]


class Record(NamedTuple):
    """Record of every tap of n trials, at most T each; after the last tap its values are repeated.

    Attributes:
        what_marginal: P(w_m) after the tap, shape (n, T, M).
        where: Most probable place, shape (n, T).
        where_belief: Belief in it, shape (n, T).
        at: Place where the sensor stood, shape (n, T).
        travelled: Classes really moved before the tap, shape (n, T).
        clamped: Moves before it that the end of the range cut short, shape (n, T).
        substituted: Times before it that a class without a tap was replaced by the nearest with one, shape (n, T).
        moves: Commanded after the tap, shape (n, T); 0 behind the last.
        length: Taps made, shape (n,).
        held: Class of the object, shape (n,).
        watched: What a `Watch` said, by name, shapes (n, T).
        no_class_left: Whether the last tap was impossible under every class still believed in, shape (n,); what is
            recorded of it is then the belief before it.
    """

    what_marginal: Floats
    where: Integers
    where_belief: Floats
    at: Integers
    travelled: Integers
    clamped: Integers
    substituted: Integers
    moves: Integers
    length: Integers
    held: Integers
    watched: dict[str, Floats]
    no_class_left: NDArray[np.bool_]

    @property
    def what(self) -> Integers:
        """Most probable object, shape (n, T)."""
        return self.what_marginal.argmax(axis=-1)

    @property
    def what_belief(self) -> Floats:
        """Belief in the most probable object, shape (n, T)."""
        return self.what_marginal.max(axis=-1)


class _Running(NamedTuple):
    """Trials in progress; all arrays have one row per trial."""

    row: Integers
    log_belief: Floats
    at: Integers
    travelled: Integers
    clamped: Integers
    substituted: Integers

    def keep(self, which: NDArray[np.bool_]) -> "_Running":
        """Selected trials."""
        return _Running(
            self.row[which],
            self.log_belief[which],
            self.at[which],
            self.travelled[which],
            self.clamped[which],
            self.substituted[which],
        )


def play(
    table: TapTable,
    plan: TrialPlan,
    policy: MovePolicy,
    *,
    border: Border = "uniform",
    deadline: int = DEADLINE,
    enough: float = 1.0,
    seed: int = 0,
    watch: Watch | None = None,
    progress: Callable[[int], None] | None = None,
) -> Record:
    """Plays the planned trials.

    Args:
        table: Test taps.
        plan: The trials; where they are to fixate is the business of the policy.
        policy: Control strategy.
        border: Reading of Eq. 9.
        deadline: Taps of a trial at most.
        enough: A trial ends when the belief in an object exceeds this; 1 goes on to the deadline.
        seed: Random seed of the draws of taps and of the numbers that strategies at random get.
        watch: Asked after every tap.
        progress: Called with the number of trials since the last call.

    Raises:
        InputError: An argument is out of range.
    """
    if deadline < 1:
        raise InputError(f"deadline must be at least 1 tap, got {deadline}.")
    plan = checked_plan(plan, table.pool)
    (L, M), hypotheses = table.pool.shape, table.log_prior.shape[1]
    refuse_border(border_number(border), hypotheses, M)
    n = len(plan.where)
    record = _empty(n, deadline, M, plan.what)
    numbers = seeds.words(seed, plan.stream, seeds.TAPS, 0, deadline)
    chance = seeds.uniform(seeds.words(seed, plan.stream, seeds.CHANCE, 0, deadline))
    at = table.pool.nearest[plan.session, plan.where, plan.what]
    zero = np.zeros(n, np.int64)
    state = _Running(
        np.arange(n),
        np.broadcast_to(table.log_prior, (n, L, hypotheses)),
        at,
        zero,
        zero,
        (at != plan.where).astype(np.int64),
    )
    for t in range(deadline):
        session, held = plan.session[state.row], plan.what[state.row]
        tap = drawn_taps(table, session, state.at, held, numbers[state.row, t])
        log_belief, none_left = updated(state.log_belief, table.log_likelihood[tap])
        state = state._replace(log_belief=log_belief)
        read = temper(log_belief, share(t + 1, table.saturation))
        if none_left.any():
            read = np.where(none_left[:, np.newaxis, np.newaxis], temper(log_belief, share(t, table.saturation)), read)
            record.no_class_left[state.row[none_left]] = True
        belief = np.exp(log_fold(read, M))
        moves = np.asarray(policy(belief, chance[state.row, t]), dtype=np.int64)
        _write(record, state, t, belief, moves)
        if watch is not None:
            _write_watched(record, state.row, t, watch(belief, moves), deadline)
        ended = belief.sum(axis=1).max(axis=1) > enough if enough < 1 else np.zeros(len(belief), np.bool_)
        ended |= none_left
        if t == deadline - 1:
            ended[:] = True
        record.length[state.row[ended]] = t + 1
        record.moves[state.row[ended], t] = 0
        if progress is not None:
            progress(int(ended.sum()))
        if ended.all():
            break
        state = _moved(state.keep(~ended), moves[~ended], session[~ended], held[~ended], table, border)
    return _filled(record)


def updated(log_belief: Floats, log_likelihood: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Log posteriors of n beliefs (n, L, H) after a tap each, Eq. 3, and which taps left no class, shape (n,).

    A tap that is impossible under every class still believed in leaves the belief as it was.
    """
    joint = log_belief + log_likelihood
    total = log_sum(joint, (1, 2))
    none_left = np.isneginf(total)
    if none_left.any():
        joint, total = np.where(none_left, log_belief, joint), np.where(none_left, 0.0, total)
    return joint - total, none_left[:, 0, 0]


def drawn_taps(table: TapTable, session: Integers, at: Integers, held: Integers, word: NDArray[np.uint64]) -> Integers:
    """Test tap of each trial's class selected by a random word, as in `run_trials`; shape (n,)."""
    pool = table.pool
    number = seeds.below(word, pool.count[session, at, held].astype(np.uint64)).astype(np.int64)
    return pool.order[pool.first[session, at, held] + number]


def shifted(log_belief: Floats, delta: Integers, border: Border, M: int, trained: Mask | None = None) -> Floats:
    """`Engine.shift` of n log beliefs (n, L, S M), each by its own move (n,), separately for each state.

    Belief stays in `trained` classes (L, M); default all.
    """
    moved = delta != 0
    if not moved.any():
        return log_belief
    result = log_belief.copy()
    part = log_belief[moved]
    n, L, H = part.shape
    states = np.moveaxis(part.reshape(n, L, H // M, M), 2, 1).reshape(-1, L, M)
    after = shift_beliefs(states, np.repeat(delta[moved], H // M), border, trained)
    result[moved] = np.moveaxis(after.reshape(n, H // M, L, M), 1, 2).reshape(n, L, H)
    return result


def shift_beliefs(log_belief: Floats, delta: Integers, border: Border, trained: Mask | None = None) -> Floats:
    """`reference.shift_log` of n beliefs (n, L, M), each by its own move (n,); all but `prior` keep the sum."""
    after = shift_all(log_belief, delta[:, np.newaxis], border, trained, logs=True)[:, 0]
    return after - log_sum(after, (1, 2)) if border == "prior" else after


def _moved(
    state: _Running, delta: Integers, session: Integers, held: Integers, table: TapTable, border: Border
) -> _Running:
    """Sensors after their moves, limited to the range, and beliefs shifted by the commanded moves."""
    L, M = table.pool.shape
    reached = np.clip(state.at + delta, 0, L - 1)
    at = table.pool.nearest[session, reached, held]
    return state._replace(
        log_belief=shifted(state.log_belief, delta, border, M, table.trained),
        at=at,
        travelled=state.travelled + np.abs(at - state.at),
        clamped=state.clamped + (reached != state.at + delta),
        substituted=state.substituted + (at != reached),
    )


def _empty(n: int, T: int, M: int, held: Integers) -> Record:
    def integers() -> Integers:
        return np.zeros((n, T), np.int64)

    return Record(
        what_marginal=np.zeros((n, T, M)),
        where=integers(),
        where_belief=np.zeros((n, T)),
        at=integers(),
        travelled=integers(),
        clamped=integers(),
        substituted=integers(),
        moves=integers(),
        length=np.zeros(n, np.int64),
        held=np.asarray(held, np.int64),
        watched={},
        no_class_left=np.zeros(n, np.bool_),
    )


def _write(record: Record, state: _Running, t: int, belief: Floats, moves: Integers) -> None:
    row, where = state.row, belief.sum(axis=2)
    record.what_marginal[row, t] = belief.sum(axis=1)
    record.where[row, t] = where.argmax(axis=1)
    record.where_belief[row, t] = where.max(axis=1)
    record.at[row, t] = state.at
    record.travelled[row, t] = state.travelled
    record.clamped[row, t] = state.clamped
    record.substituted[row, t] = state.substituted
    record.moves[row, t] = moves


def _write_watched(record: Record, row: Integers, t: int, seen: Mapping[str, Floats], T: int) -> None:
    for name, values in seen.items():
        record.watched.setdefault(name, np.zeros((len(record.length), T)))[row, t] = values


def _filled(record: Record) -> Record:
    """Record up to the longest trial, with last values repeated."""
    T = int(record.length.max())
    last = np.minimum(np.arange(T), record.length[:, np.newaxis] - 1)

    def fill(values: NDArray[np.generic]) -> NDArray[np.generic]:
        index = last.reshape(*last.shape, *(1,) * (values.ndim - 2))
        return np.take_along_axis(values, index, axis=1)

    watched = {name: fill(values) for name, values in record.watched.items()}
    changed = {name: fill(getattr(record, name)) for name in Record._fields[:8]}
    return record._replace(**changed, watched=watched)
