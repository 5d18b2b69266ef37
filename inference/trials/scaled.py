"""Compiled beliefs as scaled numbers, which neither overflow nor underflow.

A belief is carried unnormalised and without a floor, as numbers z 2^(-256 k): a class whose z gets small goes one unit
down in k and no longer counts in the marginals, but is carried on, so that it can come back after any number of taps.
Nothing is lost as it would be with plain probabilities, and no logarithm is taken as with log beliefs.

What is read from a belief after more taps than its saturation is the belief to a power, see `saturation` and `temper`.

Arrays have the axes (M, L), objects first, so that vector instructions run along the positions. Where the model carries
a state of the episode, rows are hypotheses instead, S M of them, see `models.measurement.states`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ...models.compiled import compiled
from ...models.elementary import LEAST, exponential, logarithm
from ...models.vectors import flat, multiply_rows, sum_rows
from .records import Classes, Likelihoods

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]
type Flags = NDArray[np.bool_]

UNIT = 256
_DOWN, _UP = 2.0**-UNIT, 2.0**UNIT
_LOG_UNIT = UNIT * math.log(2.0)
_SMALLEST = float(np.finfo(np.float64).tiny)
_NEVER = int(np.float64(np.inf).view(np.int64))
_NOTHING = 8  # units between two numbers of which the smaller one adds nothing
LEAST_PRODUCT = 2.0**-900  # its products with most likelihoods stay well clear of subnormal numbers, which are slow
_LEAST_TOTAL = 2.0**-128  # classes of the next k are smaller than this in proportion

UNIFORM, UNIFORM_WHAT, PRIOR, CLAMP, CIRCULAR = range(5)
"""Borders, in the order of `reference.BORDERS`."""


@compiled
def bits(number: float) -> np.int64:
    """A number of 0 or more as an integer, which is the larger the larger the number is."""
    return np.float64(number).view(np.int64)


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
def temper(
    z: Floats,
    k: Integers,
    total: float,
    share: float,
    ones: Floats,
    powers: Floats,
    where: Floats,
    what: Floats,
) -> float:
    """Sums the marginals of a belief to the power `share`, not normalised; the belief is unchanged.

    Args:
        z: Belief, no number of it subnormal.
        k: Its units.
        total: Total of the belief.
        share: The power, above 0.
        ones: Ones of the same shape.
        powers: Receives the powers.
        where: Receives the marginal over what, shape (L,).
        what: Receives the marginal over where, one number per row.

    Returns:
        The total of the powers.
    """
    M, L = z.shape
    log_total = math.log(total)
    numbers, units, raised = flat(z), flat(k), flat(powers)
    for c in range(z.size):
        depth = log_total + np.float64(np.int32(units[c])) * _LOG_UNIT
        power = share * (logarithm(max(numbers[c], _SMALLEST)) - depth)
        raised[c] = exponential(max(power, LEAST)) if numbers[c] > 0 else 0.0
    sum_rows(powers, 0, M, L, where)
    return multiply_rows(powers, ones, 0, M, L, what)


@compiled
def settle(z: Floats, k: Integers, on: Floats) -> float:
    """Rescales: the largest classes to k = 0, the total to about 1, all other z to above 2^-256.

    Returns:
        The smallest z above 0; 0 if every class is impossible.
    """
    C = z.size
    numbers, units, flags = flat(z), flat(k), flat(on)
    unsettled = 1
    while unsettled > 0:  # loops without branches become vector instructions
        unsettled = 0
        for c in range(C):
            up, down = np.int64(0 < numbers[c] < _DOWN), np.int64(numbers[c] >= 1)
            numbers[c] *= _UP if up else _DOWN if down else 1.0
            units[c] += up - down
            unsettled += up + down
    top = _NEVER
    for c in range(C):
        top = min(top, units[c] if numbers[c] > 0 else _NEVER)
    total = 0.0
    for c in range(C):
        total += numbers[c] if units[c] == top else 0.0
    if total == 0:
        return 0.0
    scale = math.ldexp(1.0, -math.frexp(total)[1])
    least = _NEVER
    for c in range(C):
        value, unit = numbers[c] * scale, units[c] - top
        up, down = np.int64(0 < value < _DOWN), np.int64(value >= 1 and unit > 0)
        value *= _UP if up else _DOWN if down else 1.0
        unit += up - down
        least = min(least, bits(value) if value > 0 else _NEVER)
        numbers[c], units[c] = value, unit
        flags[c] = 1.0 if unit == 0 else 0.0
    return np.int64(least).view(np.float64)


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
def follow(
    z: Floats,
    k: Integers,
    on: Floats,
    table: Likelihoods,
    classes: Classes,
    taps: Integers,
    moves: Integers,
    n: int,
    border: int,
    old_z: Floats,
    old_k: Integers,
) -> bool:
    """Updates a belief by taps and the moves between them; Eq. 3, 4 and 9, not normalised.

    Args:
        z: Belief, changed in place, with `k` and `on`; no number above 0 is below 2^-256, before and after.
        k: Its units.
        on: 1 where k = 0, else 0.
        table: The test taps.
        classes: Which classes belief may be in.
        taps: Indices of the taps.
        moves: Positions moved before each; 0 for no move.
        n: How many taps.
        border: Number of the border.
        old_z: Room for L numbers.
        old_k: Room for L integers.

    Returns:
        Whether the last tap is impossible under every class still believed in; the belief is that before it then.
    """
    M, L = classes.trained.shape
    numbers, units, rows, more = flat(z), flat(k), flat(table.rows), flat(table.units)
    least = _DOWN
    none_left = False
    for t in range(n):
        if moves[t] != 0:
            settle(z, k, on)
            total, _ = total_of(z, k, on, 0, len(z), 0, L)
            if classes.holes:
                new = shift_around(z, k, on, moves[t], border, classes.trained, classes.nearest, total, old_z, old_k)
            else:
                new = shift(z, k, on, moves[t], border, M, total, old_z, old_k)
            least = min(_DOWN, new)
        smallest = _DOWN if table.wide[taps[t]] else table.least[taps[t]]
        if least * smallest < LEAST_PRODUCT:
            settle(z, k, on)
            least = _DOWN
        least *= smallest
        first = np.uint64(taps[t] * z.size)  # unsigned, as loops over indices from the end on are not vectorised
        possible = np.int64(0)
        for c in range(z.size):
            possible |= bits(numbers[c] * rows[first + np.uint64(c)])
        if possible == 0:
            none_left = True
            break
        for c in range(z.size):
            numbers[c] *= rows[first + np.uint64(c)]
        if table.wide[taps[t]]:
            for c in range(z.size):
                units[c] += more[first + np.uint64(c)]
    settle(z, k, on)
    return none_left
