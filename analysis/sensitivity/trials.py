"""Trials under any reading of the paper, compiled.

The trials of `inference.trials.run` know our defaults and the borders. Here are the other orders, ends of the range and
ways to draw taps too, in a loop that is simpler and several times slower; at the defaults every decision is the same.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...inference.engines.compiled import classes, likelihoods, scaled_belief
from ...inference.trials.records import (
    Classes,
    Likelihoods,
    Rule,
    ScaledBelief,
    TapTable,
    TrialPlan,
    Trials,
    checked_plan,
)
from ...inference.trials.run import empty_trials, make_rule
from ...inference.trials.scaled import multiply, settle, shift, shift_around
from ...models import seeds
from ...models.compiled import compiled
from ...models.grid import TapPool
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


class _Way(NamedTuple):
    """How a reading has trials played.

    Attributes:
        move_first: Whether the stop test comes after move and shift.
        real: Whether the belief is shifted by what the sensor really moved.
        refused: Whether moves beyond the range are refused.
        replacement: Whether test taps are drawn with replacement.
    """

    move_first: bool
    real: bool
    refused: bool
    replacement: bool


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
    clamping = reading.clamping
    way = _Way(reading.order == "after", clamping == "real", clamping == "refused", reading.replacement)
    taps, prior, trained = likelihoods(table.log_likelihood), scaled_belief(table.log_prior), classes(table.trained)
    words = seeds.words(seed, plan.stream, seeds.TAPS, 0, rule.deadline)
    _play(taps, table.pool, prior, trained, plan, rule, way, words, done)
    return done


@compiled
def _play(
    table: Likelihoods,
    pool: TapPool,
    prior: ScaledBelief,
    trained: Classes,
    plan: TrialPlan,
    rule: Rule,
    way: _Way,
    words: NDArray[np.uint64],
    done: OpenTrials,
) -> None:
    M, L = prior.z.shape
    H, trials = len(rule.thresholds), done.trials
    z, k, on, ones = np.empty((M, L)), np.empty((M, L), np.int64), np.empty((M, L)), np.ones((M, L))
    where, what, used = np.empty(L), np.empty(M), np.full(len(table.rows), -1)
    for i in range(len(plan.what)):
        for m in range(M):
            for l in range(L):
                z[m, l], k[m, l] = prior.z[m, l], prior.k[m, l]
        settle(z, k, on)
        held, session = plan.what[i], plan.session[i]
        first, count, nearest = (
            pool.first[session, :, held],
            pool.count[session, :, held],
            pool.nearest[session, :, held],
        )
        at = nearest[plan.where[i]]
        clamped, substituted, shifted, decided = 0, np.int64(at != plan.where[i]), 0, 0
        for number in range(rule.deadline):
            tap = _draw(pool.order, first[at], count[at], words[i, number], i, -1 if way.replacement else i, used)
            row, possible = table.rows[tap], False
            for m in range(M):
                for l in range(L):
                    possible |= z[m, l] > 0 and row[m, l] > 0
            if possible:
                multiply(z, on, row, where, what)
                if table.wide[tap]:
                    k += table.units[tap]
                settle(z, k, on)
            done.impossible[i] = not possible
            total = multiply(z, on, ones, where, what)
            if possible and way.move_first:
                at, beyond, elsewhere, delta = _move(
                    z, k, on, where, total, at, plan.fixation[i], nearest, trained, rule, way
                )
                clamped, substituted, shifted = clamped + beyond, substituted + elsewhere, shifted + delta
                total = multiply(z, on, ones, where, what)
            best = what.argmax()
            top, last = what[best] / total, not possible or number == rule.deadline - 1
            while decided < H and (top > rule.thresholds[decided] or last):
                h = rule.column[decided]
                trials.taps[i, h] = number + 1
                trials.what[i, h] = best
                trials.where[i, h] = where.argmax()
                trials.true_where[i, h] = at
                trials.stopped[i, h] = possible and top > rule.thresholds[decided]
                trials.clamped[i, h] = clamped
                trials.substituted[i, h] = substituted
                trials.belief[i, h] = top
                done.tap[i, h] = tap
                done.shifted[i, h] = shifted
                decided += 1
            if decided == H:
                break
            if not way.move_first:
                at, beyond, elsewhere, delta = _move(
                    z, k, on, where, total, at, plan.fixation[i], nearest, trained, rule, way
                )
                clamped, substituted, shifted = clamped + beyond, substituted + elsewhere, shifted + delta


@compiled
def _draw(order, first, count, word, trial, marked, used):
    """A test tap of a class.

    Args:
        order: Taps, those of the class side by side.
        first: Place of the first of them.
        count: How many they are.
        word: Random word that selects the tap.
        trial: Number of the trial.
        marked: The same if no tap is drawn twice until all of the class have been, else -1.
        used: The trial that has drawn each tap, changed in place; others are smaller numbers.
    """
    free = 0
    for place in range(first, first + count):
        free += used[order[place]] < trial
    if free == 0:
        free = count
        for place in range(first, first + count):
            used[order[place]] = -1
    left = np.int64((word * np.uint64(free)) >> seeds.HALF)
    for place in range(first, first + count):
        tap = order[place]
        if used[tap] < trial:
            if left == 0:
                used[tap] = marked
                return tap
            left -= 1
    return -1


@compiled
def _move(z, k, on, where, total, at, aim, nearest, trained, rule, way):
    """Moves the sensor and shifts the belief; Eq. 8 to 10.

    Returns:
        Where the sensor is, whether the move led beyond the range and to another class than the nearest with a tap, and
        by how much the belief was shifted.
    """
    M, L = z.shape
    best = where.argmax()
    if rule.theta_x >= 1 or where[best] <= rule.theta_x * total:
        return at, False, False, 0
    delta = aim - best
    reached = min(max(at + delta, 0), L - 1)
    beyond = reached != at + delta
    if beyond and way.refused:
        delta, reached = 0, at
    new = nearest[reached]
    if way.real:
        delta = new - at
    if delta != 0:
        old_z, old_k = np.empty(L), np.empty(L, np.int64)
        if trained.holes:
            shift_around(z, k, on, delta, rule.border, trained.trained, trained.nearest, total, old_z, old_k)
        else:
            shift(z, k, on, delta, rule.border, M, total, old_z, old_k)
    return new, beyond, new != reached, delta
