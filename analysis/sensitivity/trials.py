"""Trials under any reading of the paper, all in lockstep, with log beliefs.

The compiled trials (`inference.trials.run`) know our defaults and the borders. Here are the other orders, ends of the
range and ways to draw taps too, at a tenth of the speed; at the defaults every decision is the same.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...inference.moves.shifts import log_sum
from ...inference.trials.lockstep import drawn_taps, shift_beliefs
from ...inference.trials.records import Rule, TapTable, TrialPlan, Trials, checked_plan
from ...inference.trials.run import empty_trials, make_rule
from ...models import seeds
from ...models.settings import PlaySettings
from .choices import Reading

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]


class OpenTrials(NamedTuple):
    """Decisions of n trials at H thresholds and what further definitions of errors need.

    Attributes:
        trials: The decisions. Where a tap was impossible under every class still believed in, the trial ended with
            the belief before it, not stopped.
        tap: The last tap before the decision, an index of the test taps, shape (n, H).
        shifted: By how many classes the belief had been shifted in all, shape (n, H).
        impossible: Whether the trial met a tap that was impossible so, shape (n,).
    """

    trials: Trials
    tap: Integers
    shifted: Integers
    impossible: NDArray[np.bool_]


class _OpenState(NamedTuple):
    """Trials still under way; all arrays have one row for each."""

    row: Integers
    log_belief: Floats
    at: Integers
    clamped: Integers
    substituted: Integers
    shifted: Integers

    def keep(self, which: NDArray[np.bool_]) -> "_OpenState":
        """Some of the trials."""
        return _OpenState(
            self.row[which],
            self.log_belief[which],
            self.at[which],
            self.clamped[which],
            self.substituted[which],
            self.shifted[which],
        )


def play_open(
    table: TapTable, plan: TrialPlan, thresholds: ArrayLike, reading: Reading, theta_x: float, seed: int
) -> OpenTrials:
    """Plays the planned trials under a reading and decides each at every threshold.

    Args:
        table: Test taps, of a model without states.
        plan: The trials.
        thresholds: theta_W, shape (H,).
        reading: Its border, clamping, order, deadline and replacement count here.
        theta_x: Threshold for a move; 1 never moves.
        seed: Of the draws of taps, which are those of `run_trials`.

    Raises:
        InputError: An argument is out of range.
    """
    rule = make_rule(thresholds, PlaySettings(theta_x=theta_x, border=reading.border, deadline=reading.deadline), seed)
    plan = checked_plan(plan, table.pool)
    n, H = len(plan.where), len(rule.thresholds)
    done = OpenTrials(empty_trials(n, H), np.zeros((n, H), np.int64), np.zeros((n, H), np.int64), np.zeros(n, np.bool_))
    decided = np.zeros((n, H), np.bool_)
    words = seeds.words(seed, plan.stream, seeds.TAPS, 0, rule.deadline)
    at = table.pool.nearest[plan.where, plan.what]
    zero = np.zeros(n, np.int64)
    belief = np.broadcast_to(table.log_prior, (n, *table.log_prior.shape))
    state = _OpenState(np.arange(n), belief, at, zero, (at != plan.where).astype(np.int64), zero)
    used = None if reading.replacement else np.zeros((n, len(table.log_likelihood)), np.bool_)
    for number in range(rule.deadline):
        tap = _draw(table, plan.what[state.row], state, words[state.row, number], used)
        log_belief = state.log_belief + table.log_likelihood[tap]
        possible = log_belief.max(axis=(1, 2)) > -np.inf
        if not possible.all():
            lost = state.keep(~possible)
            done.impossible[lost.row] = True
            _decide(done, decided, lost, tap[~possible], number, rule, cut=True)
            state, tap, log_belief = state.keep(possible), tap[possible], log_belief[possible]
        state = state._replace(log_belief=log_belief - log_sum(log_belief, (1, 2)))
        if reading.order == "after":
            state = _move(state, plan, table, rule, reading)
        _decide(done, decided, state, tap, number, rule, cut=number == rule.deadline - 1)
        state = state.keep(~decided[state.row].all(axis=1))
        if not len(state.row):
            break
        if reading.order == "before":
            state = _move(state, plan, table, rule, reading)
    return done


def _draw(
    table: TapTable, what: Integers, state: _OpenState, word: NDArray[np.uint64], used: NDArray[np.bool_] | None
) -> Integers:
    """A test tap of each trial's class; those drawn are marked in `used` (n, N), where that is given."""
    if used is None:
        return drawn_taps(table, state.at, what, word)
    pool = table.pool
    first, count = pool.first[state.at, what], pool.count[state.at, what]
    place = np.arange(count.max())
    tap = pool.order[np.minimum(first[:, np.newaxis] + place, len(pool.order) - 1)]
    inside = place < count[:, np.newaxis]
    row = state.row[:, np.newaxis]
    free = inside & ~used[row, tap]
    again = ~free.any(axis=1)
    if again.any():
        which, column = np.nonzero(inside & again[:, np.newaxis])
        used[state.row[which], tap[which, column]] = False
        free[again] = inside[again]
    number = seeds.below(word, free.sum(axis=1).astype(np.uint64)).astype(np.int64)
    chosen = (free.cumsum(axis=1) > number[:, np.newaxis]).argmax(axis=1)
    tap = tap[np.arange(len(tap)), chosen]
    used[state.row, tap] = True
    return tap


def _move(state: _OpenState, plan: TrialPlan, table: TapTable, rule: Rule, reading: Reading) -> _OpenState:
    """Moves the sensors and shifts the beliefs; Eq. 8 to 10."""
    if rule.theta_x >= 1:
        return state
    where = np.exp(state.log_belief).sum(axis=2)
    best = where.argmax(axis=1)
    moves = where[np.arange(len(best)), best] > rule.theta_x
    delta = np.where(moves, plan.fixation[state.row] - best, 0)
    L = where.shape[1]
    commanded = state.at + delta
    reached = np.clip(commanded, 0, L - 1)
    beyond = reached != commanded
    if reading.clamping == "refused":
        delta, reached = np.where(beyond, 0, delta), np.where(beyond, state.at, reached)
    at = table.pool.nearest[reached, plan.what[state.row]]
    shift = at - state.at if reading.clamping == "real" else delta
    log_belief = state.log_belief.copy()
    moved = shift != 0
    if moved.any():
        log_belief[moved] = shift_beliefs(log_belief[moved], shift[moved], reading.border, table.trained)
    return state._replace(
        log_belief=log_belief,
        at=at,
        clamped=state.clamped + beyond,
        substituted=state.substituted + (at != reached),
        shifted=state.shifted + shift,
    )


def _decide(
    done: OpenTrials,
    decided: NDArray[np.bool_],
    state: _OpenState,
    tap: Integers,
    number: int,
    rule: Rule,
    *,
    cut: bool,
) -> None:
    """Writes down what is decided now: at thresholds that are crossed, and at all others where trials are cut short."""
    belief = np.exp(state.log_belief)
    what, where = belief.sum(axis=1), belief.sum(axis=2)
    best = what.argmax(axis=1)
    top = what[np.arange(len(best)), best]
    crossed = (top[:, np.newaxis] > rule.thresholds) & ~(cut & done.impossible[state.row])[:, np.newaxis]
    i, h = np.nonzero((crossed | cut) & ~decided[state.row])
    row, column = state.row[i], rule.column[h]
    decided[row, h] = True
    trials = done.trials
    trials.taps[row, column] = number + 1
    trials.what[row, column] = best[i]
    trials.where[row, column] = where.argmax(axis=1)[i]
    trials.true_where[row, column] = state.at[i]
    trials.stopped[row, column] = crossed[i, h]
    trials.clamped[row, column] = state.clamped[i]
    trials.substituted[row, column] = state.substituted[i]
    trials.belief[row, column] = top[i]
    done.tap[row, column] = tap[i]
    done.shifted[row, column] = state.shifted[i]
