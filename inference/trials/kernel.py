"""Compiled trials.

A trial carries its belief as plain numbers, unnormalised, so that a tap is one product and a sum. Classes that get so
small that they do not count are left out. Should others get as small, the belief is made again from the scaled numbers
of `scaled`, which leave nothing out, and from the taps and moves since; so decisions are those of exact beliefs.
"""

import math

import numpy as np

from ...models.compiled import compiled
from ...models.grid import TapPool
from ...models.seeds import HALF, LOW, PER_BLOCK, TAPS
from ...models.vectors import (
    BLOCKS,
    PART,
    WORDS,
    copy,
    flat,
    largest,
    multiply_narrow_rows,
    multiply_rows,
    random_blocks,
    sum_rows,
)
from .records import Classes, Likelihoods, Rule, ScaledBelief, TrialPlan, Trials
from .scaled import (
    CIRCULAR,
    CLAMP,
    LEAST_PRODUCT,
    PRIOR,
    UNIFORM,
    UNIFORM_WHAT,
    UNIT,
    Floats,
    Integers,
    bits,
    follow,
    shift_around,
    temper,
)

_LEAST_TOTAL = 2.0**-128  # of a belief; below, it is scaled up
_FAR = 2.0**-512  # classes below it are left out
_LEFT_OUT = 2.0**-256  # what is left out stays below it; with that total, its share is below 2^-128 per class
_POWER_LEFT_OUT = -64.0  # power of two that a class left out adds to a total of powers at most
_UNIT = 2.0**-UNIT
_SORTED = 8192  # trials whose records lie in the second cache while they are played by class
_MOVED = 1024  # classes moved at a time, so that they stay in the first cache
_NORMAL = 2.0**-1022  # below it, a product may have become 0


@compiled
def plain(z: Floats, k: Integers, numbers: Floats) -> tuple[float, float]:
    """Plain numbers from scaled ones, 0 where they are below `_FAR`.

    Args:
        z: Numbers z 2^(-256 k) in one belief or row of likelihoods.
        k: Their units.
        numbers: Receives the plain numbers.

    Returns:
        The smallest number above 0, and a bound of those left out.
    """
    values, units, made = flat(z), flat(k), flat(numbers)
    least, lost = bits(np.inf), np.int64(0)
    for c in range(z.size):
        number = values[c] * (1.0 if units[c] == 0 else _UNIT if units[c] == 1 else 0.0)
        made[c] = number
        least = min(least, bits(number if number > 0 else np.inf))
        lost += np.int64(units[c] > 1 and values[c] > 0)
    return np.int64(least).view(np.float64), _FAR if lost > 0 else 0.0


@compiled
def _move(
    belief: Floats,
    delta: int,
    border: int,
    M: int,
    total: float,
    summed: bool,
    sums: Floats,
    room: Floats,
    at_once: int,
) -> float:
    """`scaled.shift` of a belief in plain numbers.

    Args:
        belief: Changed in place.
        delta: Where classes moved, not 0.
        border: Number of the border.
        M: Objects, of each state.
        total: Total of the belief.
        summed: Whether `sums` are known, where there is one state.
        sums: The marginal over what, shape (L,), or room for it.
        room: Room for `at_once` objects of a belief and two more.
        at_once: How many are moved at a time; they should fit into the cache.

    Returns:
        The smallest number above 0 that the vacated classes got; infinity where there is none.
    """
    rows, L = belief.shape
    out = min(abs(delta), L)
    lost = L - out if delta > 0 else 0  # first class that leaves the range
    step = delta % L if border == CIRCULAR else out if delta > 0 else -out
    vacated = 0 if step > 0 else L - out
    new = total / (L * M) if border == PRIOR else 0.0
    least = np.inf
    following = 0  # first row of the next state, as remainders take long
    numbers = flat(belief)
    for first in range(0, rows, at_once):
        last = min(first + at_once, rows)
        copy(room, L, belief, first * L, (last - first) * L)
        for m in range(first, last):
            if border == UNIFORM and m == following:
                following += M
                if not summed:
                    sum_rows(belief, m * L, M, L, sums)
                new = 0.0
                for l in range(lost, lost + out):
                    new += sums[l]
                new /= out * M
            elif border == UNIFORM_WHAT:
                new = 0.0
                for l in range(lost, lost + out):
                    new += belief[m, l]
                new /= out
            if new > 0:
                least = min(least, new)
            row = (m - first + 1) * L  # in the room
            copy(belief, m * L, room, row - step, L)  # and what lies beside it there, where classes come in
            into = np.uint64(m * L + vacated)  # unsigned, as an index from the end on would scatter the numbers
            if border == CIRCULAR:
                for l in range(step):
                    numbers[into + np.uint64(l)] = room[row + L - step + l]
            else:
                for l in range(out):
                    numbers[into + np.uint64(l)] = new
            if border == CLAMP:
                end = L - 1 if delta > 0 else 0
                for l in range(lost, lost + out):
                    belief[m, end] += room[row + l]
    return least


@compiled
def _by_class(plan: TrialPlan, first: int, last: int, L: int, M: int) -> Integers:
    """Rows of a plan, sorted by object and then by start within each block of `_SORTED`."""
    rows = np.empty(last - first, np.int64)
    for block in range(first, last, _SORTED):
        end = min(block + _SORTED, last)
        begin = np.zeros(L * M + 1, np.int64)
        for i in range(block, end):
            begin[plan.what[i] * L + plan.where[i] + 1] += 1
        for c in range(L * M):
            begin[c + 1] += begin[c]
        for i in range(block, end):
            c = plan.what[i] * L + plan.where[i]
            rows[block - first + begin[c]] = i
            begin[c] += 1
    return rows


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
    hypotheses, L = prior.z.shape
    M = pool.nearest.shape[2]
    states, H = hypotheses // M, len(rule.thresholds)
    start, belief, ones = np.empty((hypotheses, L)), np.empty((hypotheses, L)), np.ones((hypotheses, L))
    start_least, start_left_out = plain(prior.z, prior.k, start)
    z, k, on = np.empty((hypotheses, L)), np.empty((hypotheses, L), np.int64), np.empty((hypotheses, L))
    zeros, old_z, old_k = np.zeros((hypotheses, L), np.int64), np.empty(L), np.empty(L, np.int64)
    where, what, sums = np.zeros(L + PART), np.empty(hypotheses), np.empty(L)
    at_once = min(hypotheses, max(1, _MOVED // L))
    room = np.empty((at_once + 2) * L)
    powers, numbers = np.empty((hypotheses, L)), flat(belief)
    likelihood, least_of, wide, thresholds = table.plain, table.least, table.wide, rule.thresholds
    taps, moves = np.empty((2, rule.deadline + 1), np.int64)
    words = np.empty(WORDS, np.uint64)
    order, taken, drawn = pool.order.copy(), np.zeros(L, np.int64), 0
    front, chosen, visited = np.empty((3, rule.deadline), np.int64)
    moving = rule.theta_x < 1
    summed = (moving or rule.fresh) and L == PART  # whether positions are summed with every product
    best_where = best_what = stood = 0
    top = 0.0
    rows = _by_class(plan, first, last, L, M)  # so the taps of a class stay in the cache
    for number in range(len(rows)):
        i = int(rows[number])
        for m in range(hypotheses):
            for l in range(L):
                belief[m, l] = start[m, l]
        least, left_out, exact = start_least, start_left_out, False
        since = 0  # taps that the scaled belief does not know of
        moves[0] = 0
        held, session = plan.what[i], plan.session[i]
        begin, count, nearest = pool.first[session], pool.count[session], pool.nearest[session]
        at = nearest[plan.where[i], held]
        clamped, substituted = 0, np.int64(at != plan.where[i])
        earlier_clamped = earlier_substituted = np.int64(0)  # up to the last tap
        while drawn > 0:  # a trial depends on its stream only, so what the last one shuffled is put back
            drawn -= 1
            order[front[drawn]], order[chosen[drawn]] = order[chosen[drawn]], order[front[drawn]]
            taken[visited[drawn]] = 0
        stream = np.uint64(plan.stream[i])
        decided = 0
        for tap in range(rule.deadline):
            if tap % WORDS == 0:
                block = np.uint64(tap // PER_BLOCK)
                random_blocks(words, block, TAPS, stream & LOW, stream >> HALF, rule.key0, rule.key1)
            word = words[tap % PER_BLOCK * BLOCKS + tap // PER_BLOCK % BLOCKS]
            left = count[at, held] - taken[at]
            if left == 0:
                while decided < H:
                    h = rule.column[decided]
                    trials.taps[i, h] = tap
                    trials.what[i, h] = best_what
                    trials.where[i, h] = best_where
                    trials.true_where[i, h] = stood
                    trials.stopped[i, h] = False
                    trials.clamped[i, h] = earlier_clamped
                    trials.substituted[i, h] = earlier_substituted
                    trials.belief[i, h] = top
                    trials.used_up[i, h] = True
                    decided += 1
                break
            place = begin[at, held] + taken[at] + np.int64((word * np.uint64(left)) >> HALF)
            index = order[place]
            if rule.fresh:  # a step of the shuffle of Fisher and Yates
                front[drawn], chosen[drawn], visited[drawn] = begin[at, held] + taken[at], place, at
                order[place], order[front[drawn]] = order[front[drawn]], index
                taken[at] += 1
                drawn += 1
                stood, earlier_clamped, earlier_substituted = at, clamped, substituted

            taps[since] = index
            since += 1
            moves[since] = 0
            none_left = False
            known = tap + 1  # taps that the belief knows of
            least *= least_of[index]
            if summed:
                total = multiply_narrow_rows(belief, likelihood, index * hypotheses * L, hypotheses, what, where)
            else:
                total = multiply_rows(belief, likelihood, index * hypotheses * L, hypotheses, L, what)
            if wide[index]:
                left_out = max(left_out, _FAR)
            most_left_out = np.inf
            if known > saturation:
                most_left_out = total * 2.0 ** (_POWER_LEFT_OUT * known / saturation)
            if total < _LEAST_TOTAL or least < LEAST_PRODUCT or left_out > most_left_out:
                scale = 1.0
                if least < _NORMAL:
                    left_out = max(left_out, _FAR)
                if 0 < total < _LEAST_TOTAL:
                    scale = math.ldexp(1.0, -math.frexp(total)[1])
                if total == 0 or scale * left_out > _LEFT_OUT or known > saturation:
                    if not exact:
                        for m in range(hypotheses):
                            for l in range(L):
                                z[m, l], k[m, l] = prior.z[m, l], prior.k[m, l]
                                on[m, l] = 1.0 if k[m, l] == 0 else 0.0
                        exact = True
                    none_left = follow(z, k, on, table, classes, taps, moves, since, rule.border, old_z, old_k)
                    known -= none_left
                    since = 0
                    moves[0] = 0
                    least, left_out = plain(z, k, belief)
                else:
                    lost = np.int64(0)
                    for c in range(belief.size):
                        value = numbers[c] * scale
                        far = value < _FAR
                        lost += np.int64(far and value > 0)
                        numbers[c] = 0.0 if far else value
                    left_out = max(left_out * scale, _FAR if lost > 0 else 0.0)
                    least = max(least * scale, _FAR)
                total = multiply_rows(belief, ones, 0, hypotheses, L, what)
                if summed:
                    sum_rows(belief, 0, hypotheses, L, where)
            read = total
            if known > saturation:
                if since == 0:
                    read = temper(z, k, total, saturation / known, ones, powers, where, what)
                else:
                    read = temper(belief, zeros, total, saturation / known, ones, powers, where, what)

            for s in range(1, states):
                for m in range(M):
                    what[m] += what[s * M + m]
            top = what[0]  # by a loop, as numbers that were stored one by one cannot be loaded at once without a delay
            for m in range(1, M):
                top = max(top, what[m])
            last_tap = none_left or tap == rule.deadline - 1
            crossed = top / read > thresholds[decided]
            if moving or rule.fresh or last_tap or crossed:
                if known <= saturation and not summed:
                    sum_rows(belief, 0, hypotheses, L, where)
                best_where = largest(where, L)
            if rule.fresh or last_tap or crossed:
                best_what = 0
                while what[best_what] < top:
                    best_what += 1
            top /= read
            while decided < H and (top > thresholds[decided] or last_tap):
                h = rule.column[decided]
                trials.taps[i, h] = tap + 1
                trials.what[i, h] = best_what
                trials.where[i, h] = best_where
                trials.true_where[i, h] = at
                trials.stopped[i, h] = top > thresholds[decided] and not none_left
                trials.no_class_left[i, h] = none_left
                trials.clamped[i, h] = clamped
                trials.substituted[i, h] = substituted
                trials.belief[i, h] = top
                decided += 1
            if decided == H:
                break

            if moving and where[best_where] > rule.theta_x * read:
                delta = plan.fixation[i] - best_where
                if delta != 0:
                    if classes.holes:
                        new = shift_around(
                            belief,
                            zeros,
                            ones,
                            delta,
                            rule.border,
                            classes.trained,
                            classes.nearest,
                            total,
                            old_z,
                            old_k,
                        )
                    else:
                        one = states == 1 and known <= saturation
                        new = _move(belief, delta, rule.border, M, total, one, where if one else sums, room, at_once)
                    least = min(least, new)
                    moves[since] = delta
                    commanded = at + delta
                    reached = min(max(commanded, 0), L - 1)
                    at = nearest[reached, held]
                    clamped += reached != commanded
                    substituted += at != reached
