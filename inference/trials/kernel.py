"""Compiled belief update and trials.

A belief is carried unnormalised and without a floor, as scaled numbers z 2^(-256 k): a class whose z gets small goes
one unit down in k and no longer counts in the marginals, but is carried on, so that it can come back after any
number of taps. Nothing is lost as it would be with plain probabilities, and no logarithm is taken as with log beliefs.

What is read from a belief after more taps than its saturation is the belief to a power, see `saturation` and `temper`.

Arrays have the axes (M, L), objects first, so that vector instructions run along the positions. Where the model carries
a state of the episode, rows are hypotheses instead, S M of them, see `models.measurement.states`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ...models.compiled import compiled
from ...models.grid import TapPool
from ...models.seeds import HALF, LOW, TAPS, philox
from .records import Classes, Likelihoods, Rule, ScaledBelief, TrialPlan, Trials

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]
type Flags = NDArray[np.bool_]

UNIT = 256
_DOWN, _UP = 2.0**-UNIT, 2.0**UNIT
_LOG_UNIT = UNIT * math.log(2.0)
_NOTHING = 8  # units between two numbers of which the smaller one adds nothing
_LEAST = 2.0**-1000  # products of belief and likelihood stay above it, well clear of subnormal numbers
_LEAST_TOTAL = 2.0**-128  # classes of the next k are smaller than this in proportion

UNIFORM, UNIFORM_WHAT, PRIOR, CLAMP, CIRCULAR = range(5)
"""Borders, in the order of `reference.BORDERS`."""

_philox = compiled(philox)  # here and not beside the other uses of it: see `compiled`


@compiled
def multiply(z: Floats, on: Floats, row: Floats, where: Floats, what: Floats) -> float:
    """Multiplies a belief by the likelihoods of a tap and sums its marginals; Eq. 3 to 6, not normalised.

    Args:
        z: Belief, changed in place.
        on: 1 where k = 0, else 0.
        row: Likelihoods of the tap over their maximum.
        where: Receives the marginal over what, shape (L,).
        what: Receives the marginal over where, one number per row.

    Returns:
        The total.
    """
    M, L = z.shape
    for l in range(L):
        where[l] = 0.0
    total = 0.0
    for m in range(M):
        partial = 0.0
        for l in range(L):
            value = z[m, l] * row[m, l]
            z[m, l] = value
            counted = value * on[m, l]
            where[l] += counted
            partial += counted
        what[m] = partial
        total += partial
    return total


@compiled
def temper(z: Floats, k: Integers, total: float, share: float, where: Floats, what: Floats) -> float:
    """Sums the marginals of a belief to the power `share`, not normalised; the belief is unchanged.

    Args:
        z: Belief.
        k: Its units.
        total: Total of the belief.
        share: The power, above 0.
        where: Receives the marginal over what, shape (L,).
        what: Receives the marginal over where, one number per row.

    Returns:
        The total of the powers.
    """
    M, L = z.shape
    log_total = math.log(total)
    for l in range(L):
        where[l] = 0.0
    sum_ = 0.0
    for m in range(M):
        partial = 0.0
        for l in range(L):
            if z[m, l] > 0:
                value = math.exp(share * (math.log(z[m, l]) - log_total - k[m, l] * _LOG_UNIT))
                where[l] += value
                partial += value
        what[m] = partial
        sum_ += partial
    return sum_


@compiled
def settle(z: Floats, k: Integers, on: Floats) -> float:
    """Rescales: the largest classes to k = 0, the total to about 1, all other z to above 2^-256.

    Returns:
        The smallest z above 0; 0 if every class is impossible.
    """
    M, L = z.shape
    top = np.iinfo(np.int64).max
    for m in range(M):
        for l in range(L):
            if z[m, l] > 0:
                while z[m, l] < _DOWN:
                    z[m, l] *= _UP
                    k[m, l] += 1
                while z[m, l] >= 1:
                    z[m, l] *= _DOWN
                    k[m, l] -= 1
                top = min(top, k[m, l])
    total = 0.0
    for m in range(M):
        for l in range(L):
            if k[m, l] == top:
                total += z[m, l]
    if total == 0:
        return 0.0
    scale = math.ldexp(1.0, -math.frexp(total)[1])
    least = np.inf
    for m in range(M):
        for l in range(L):
            value = z[m, l] * scale
            unit = k[m, l] - top
            if value > 0:
                if value < _DOWN:
                    value *= _UP
                    unit += 1
                elif value >= 1 and unit > 0:
                    value *= _DOWN
                    unit -= 1
                least = min(least, value)
            z[m, l] = value
            k[m, l] = unit
            on[m, l] = 1.0 if unit == 0 else 0.0
    return least


@compiled
def add(z1: float, k1: int, z2: float, k2: int) -> tuple[float, int]:
    """Sum of two scaled numbers."""
    if z1 == 0 or (z2 > 0 and k2 < k1):
        z1, k1, z2, k2 = z2, k2, z1, k1
    if z2 == 0 or k2 - k1 > _NOTHING:
        return z1, k1
    return z1 + math.ldexp(z2, -UNIT * (k2 - k1)), k1


@compiled
def total_of(z: Floats, k: Integers, on: Floats, m0: int, m1: int, l0: int, l1: int) -> tuple[float, int]:
    """Sum of a block of classes, as a scaled number."""
    value, unit = 0.0, 0
    for m in range(m0, m1):
        for l in range(l0, l1):
            value += z[m, l] * on[m, l]
    if value >= _LEAST_TOTAL:
        return value, unit
    value = 0.0
    for m in range(m0, m1):
        for l in range(l0, l1):
            value, unit = add(value, unit, z[m, l], k[m, l])
    return value, unit


@compiled
def largest(values: Floats, n: int) -> int:
    """Index of the largest of the first n values, the first of equal ones."""
    best = values[0]
    for i in range(1, n):
        best = max(best, values[i])
    index = 0
    while values[index] < best:
        index += 1
    return index


@compiled
def shift(
    z: Floats, k: Integers, on: Floats, delta: int, border: int, M: int, total: float, old_z: Floats, old_k: Integers
) -> float:
    """Moves a belief by `delta` positions; Eq. 9, borders as in `reference.shift`.

    A move does not change the state of the episode: `UNIFORM` redraws the object within each. `PRIOR` knows no states.

    Args:
        z: Belief, changed in place, with `k` and `on`.
        k: Its units.
        on: 1 where k = 0, else 0.
        delta: Where classes moved, not 0.
        border: One of the numbers above.
        M: Objects, of each state.
        total: Total of the belief.
        old_z: Room for L numbers.
        old_k: Room for L integers.

    Returns:
        The smallest z above 0 that the vacated classes got; infinity where there is none.
    """
    rows, L = z.shape
    out = min(abs(delta), L)
    lost = L - out if delta > 0 else 0  # first class that leaves the range
    new_z, new_k = 0.0, 0
    if border == PRIOR:
        new_z = total / (L * M)
    least = np.inf
    following = 0  # first row of the next state
    for m in range(rows):
        if m == following:
            following += M
            if border == UNIFORM:
                new_z, new_k = total_of(z, k, on, m, following, lost, lost + out)
                new_z /= out * M
        for l in range(L):
            old_z[l], old_k[l] = z[m, l], k[m, l]
        piled_z, piled_k = 0.0, 0
        if border == UNIFORM_WHAT:
            new_z, new_k = total_of(z, k, on, m, m + 1, lost, lost + out)
            new_z /= out
        elif border == CLAMP:
            piled_z, piled_k = total_of(z, k, on, m, m + 1, lost, lost + out)
        for l in range(L):
            source = (l - delta) % L if border == CIRCULAR else l - delta
            if 0 <= source < L:
                z[m, l], k[m, l] = old_z[source], old_k[source]
            else:
                z[m, l], k[m, l] = new_z, new_k
        if border == CLAMP:
            end = L - 1 if delta > 0 else 0
            z[m, end], k[m, end] = add(z[m, end], k[m, end], piled_z, piled_k)
        if new_z > 0:
            least = min(least, new_z)
        for l in range(L):
            on[m, l] = 1.0 if k[m, l] == 0 else 0.0
    return least


@compiled
def _lands(trained: Flags, m: int, place: int) -> bool:
    """Whether a position is in the range and trained for an object."""
    return 0 <= place < trained.shape[1] and trained[m, place]


@compiled
def shift_around(
    z: Floats,
    k: Integers,
    on: Floats,
    delta: int,
    border: int,
    trained: Flags,
    nearest: Integers,
    total: float,
    old_z: Floats,
    old_k: Integers,
) -> float:
    """`shift` on a grid with holes: belief stays in trained classes.

    Args:
        z: Belief, 0 in untrained classes, changed in place, with `k` and `on`.
        k: Its units.
        on: 1 where k = 0, else 0.
        delta: Where classes moved, not 0.
        border: Number of the border.
        trained: Which classes belief may be in, shape (M, L).
        nearest: The nearest trained position of the object, shape (M, L).
        total: Total of the belief.
        old_z: Room for L numbers.
        old_k: Room for L integers.

    Returns:
        The smallest z above 0; infinity where there is none.
    """
    rows, L = z.shape
    M = len(trained)
    least = np.inf
    for first in range(0, rows, M):
        new_z, new_k = 0.0, 0
        vacated = 0
        for m in range(M):
            for l in range(L):
                if trained[m, l] and not _lands(trained, m, l + delta):
                    new_z, new_k = add(new_z, new_k, z[first + m, l], k[first + m, l])
                    vacated += 1
        if vacated > 0:
            new_z /= vacated
        if border == PRIOR:
            new_z, new_k = total / trained.sum(), 0
        for m in range(M):
            row = first + m
            if border == UNIFORM_WHAT:
                new_z, new_k, vacated = 0.0, 0, 0
                for l in range(L):
                    if trained[m, l] and not _lands(trained, m, l + delta):
                        new_z, new_k = add(new_z, new_k, z[row, l], k[row, l])
                        vacated += 1
                if vacated > 0:
                    new_z /= vacated
            for l in range(L):
                old_z[l], old_k[l] = z[row, l], k[row, l]
                z[row, l], k[row, l] = 0.0, 0
            behind = -1  # the last class whose belief wraps onto an untrained one
            for l in range(L):
                if not trained[m, l]:
                    continue
                if border == CLAMP:
                    at = nearest[m, min(max(l + delta, 0), L - 1)]
                    z[row, at], k[row, at] = add(z[row, at], k[row, at], old_z[l], old_k[l])
                elif border == CIRCULAR:
                    source = (l - delta) % L
                    if not trained[m, source]:
                        behind += 1
                        while not trained[m, behind] or trained[m, (behind + delta) % L]:
                            behind += 1
                        source = behind
                    z[row, l], k[row, l] = old_z[source], old_k[source]
                elif _lands(trained, m, l - delta):
                    z[row, l], k[row, l] = old_z[l - delta], old_k[l - delta]
                else:
                    z[row, l], k[row, l] = new_z, new_k
            for l in range(L):
                on[row, l] = 1.0 if k[row, l] == 0 else 0.0
                if z[row, l] > 0:
                    least = min(least, z[row, l])
    return least


@compiled
def play(
    table: Likelihoods,
    pool: TapPool,
    prior: ScaledBelief,
    classes: Classes,
    saturation: float,
    plan: TrialPlan,
    rule: Rule,
    first: int,
    last: int,
    trials: Trials,
) -> None:
    """Plays trials `first` to `last` - 1 of a plan and records their decisions at every threshold.

    Args:
        table: The test taps.
        pool: Which of them belong to which class.
        prior: Belief before the first tap.
        classes: Which classes belief may be in.
        saturation: Taps after which beliefs are read to a power, see `filter.share`.
        plan: The trials.
        rule: How they move and stop.
        first: First row of the plan.
        last: Behind the last one.
        trials: Its rows are filled in.
    """
    rows, L = prior.z.shape
    M = pool.nearest.shape[1]
    states = rows // M
    H = len(rule.thresholds)
    z, k, on = np.empty((rows, L)), np.empty((rows, L), np.int64), np.empty((rows, L))
    where, what, ones = np.empty(L), np.empty(rows), np.ones((rows, L))
    old_z, old_k = np.empty(L), np.empty(L, np.int64)
    order, taken, drawn = pool.order.copy(), np.zeros(L, np.int64), 0
    front, chosen, visited = np.empty((3, rule.deadline), np.int64)
    moving = rule.theta_x < 1
    best_where = best_what = stood = 0
    belief = 0.0
    word = word1 = word2 = word3 = np.uint64(0)
    for i in range(first, last):
        for m in range(rows):
            for l in range(L):
                z[m, l], k[m, l] = prior.z[m, l], prior.k[m, l]
                on[m, l] = 1.0 if k[m, l] == 0 else 0.0
        least = prior.least
        held = plan.what[i]
        at = pool.nearest[plan.where[i], held]
        clamped, substituted = 0, np.int64(at != plan.where[i])
        earlier_clamped = earlier_substituted = np.int64(0)  # up to the last tap
        while drawn > 0:  # a trial depends on its stream only, so what the last one shuffled is put back
            drawn -= 1
            order[front[drawn]], order[chosen[drawn]] = order[chosen[drawn]], order[front[drawn]]
            taken[visited[drawn]] = 0
        stream = np.uint64(plan.stream[i])
        decided = 0
        for tap in range(rule.deadline):
            lane = tap & 3
            if lane == 0:
                word, word1, word2, word3 = _philox(
                    np.uint64(tap >> 2), TAPS, stream & LOW, stream >> HALF, rule.key0, rule.key1
                )
            elif lane == 1:
                word = word1
            elif lane == 2:
                word = word2
            else:
                word = word3
            left = pool.count[at, held] - taken[at]
            if left == 0:
                best_where = largest(where, L)
                while decided < H:
                    h = rule.column[decided]
                    trials.taps[i, h] = tap
                    trials.what[i, h] = best_what
                    trials.where[i, h] = best_where
                    trials.true_where[i, h] = stood
                    trials.stopped[i, h] = False
                    trials.clamped[i, h] = earlier_clamped
                    trials.substituted[i, h] = earlier_substituted
                    trials.belief[i, h] = belief
                    trials.used_up[i, h] = True
                    decided += 1
                break
            place = pool.first[at, held] + taken[at] + np.int64((word * np.uint64(left)) >> HALF)
            index = order[place]
            if rule.fresh:  # a step of the shuffle of Fisher and Yates
                front[drawn], chosen[drawn], visited[drawn] = pool.first[at, held] + taken[at], place, at
                order[place], order[front[drawn]] = order[front[drawn]], index
                taken[at] += 1
                drawn += 1
                stood, earlier_clamped, earlier_substituted = at, clamped, substituted

            # Written out here: handed to a function, the arrays' reference counts would cost as much as the work.
            least *= table.least[index]
            if least < _LEAST:
                least = settle(z, k, on) * table.least[index]
            none_left = True
            for m in range(rows):
                for l in range(L):
                    if z[m, l] > 0 and table.rows[index, m, l] > 0:
                        none_left = False
                        break
                if not none_left:
                    break
            known = tap + 1  # taps that the belief knows of
            if none_left:
                known = tap
                least = settle(z, k, on)
                total = multiply(z, on, ones, where, what)
            else:
                total = multiply(z, on, table.rows[index], where, what)
                wide = table.wide[index]
                if wide:
                    for m in range(rows):
                        for l in range(L):
                            k[m, l] += table.units[index, m, l]
                if wide or total < _LEAST_TOTAL:
                    least = settle(z, k, on)
                    total = multiply(z, on, ones, where, what)
            read = total
            if known > saturation:
                read = temper(z, k, total, saturation / known, where, what)

            for s in range(1, states):
                for m in range(M):
                    what[m] += what[s * M + m]
            best_what = largest(what, M)
            belief = what[best_what] / read
            last_tap = none_left or tap == rule.deadline - 1
            if moving or last_tap or belief > rule.thresholds[decided]:
                best_where = largest(where, L)
            while decided < H and (belief > rule.thresholds[decided] or last_tap):
                h = rule.column[decided]
                trials.taps[i, h] = tap + 1
                trials.what[i, h] = best_what
                trials.where[i, h] = best_where
                trials.true_where[i, h] = at
                trials.stopped[i, h] = belief > rule.thresholds[decided] and not none_left
                trials.no_class_left[i, h] = none_left
                trials.clamped[i, h] = clamped
                trials.substituted[i, h] = substituted
                trials.belief[i, h] = belief
                decided += 1
            if decided == H:
                break

            if moving and where[best_where] > rule.theta_x * read:
                delta = plan.fixation[i] - best_where
                if delta != 0:
                    if classes.holes:
                        new = shift_around(
                            z, k, on, delta, rule.border, classes.trained, classes.nearest, total, old_z, old_k
                        )
                    else:
                        new = shift(z, k, on, delta, rule.border, M, total, old_z, old_k)
                    least = min(least, new)
                    commanded = at + delta
                    reached = min(max(commanded, 0), L - 1)
                    at = pool.nearest[reached, held]
                    clamped += reached != commanded
                    substituted += at != reached
