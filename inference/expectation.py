"""Expectations over the taps of a pool, in compiled loops without temporary arrays.

Classes are numbered through, C of them. The probability of a tap together with a group of classes is the sum of its
probabilities given the classes, weighted by the belief in them.
"""

import numpy as np
from numpy.typing import NDArray

from ..models.compiled import compiled
from ..models.elementary import logarithm

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]

_TINY = float(np.finfo(np.float64).tiny)
_NEGLIGIBLE = 1e-100  # of a belief; products of what is larger are no subnormal numbers, which are slow
_NO_SHARE = 2.0**-60  # of a belief of sum one; all classes with less together are within rounding


@compiled
def entropy(p):
    """-sum p log p, for numbers that need not sum to one."""
    total = 0.0
    for n in range(len(p)):
        total -= p[n] * logarithm(max(p[n], _TINY))
    return total


@compiled
def restrict(beliefs: Floats, possible: NDArray[np.bool_], kept: Floats) -> None:
    """Restricts beliefs to possible classes.

    Args:
        beliefs: Shape (S, C).
        possible: Shape (C,).
        kept: Receives the beliefs, with sum one, or zero if nothing is left; shape (S, C).
    """
    for s in range(len(beliefs)):
        total = 0.0
        for c in range(len(possible)):
            kept[s, c] = beliefs[s, c] if possible[c] and beliefs[s, c] >= _NEGLIGIBLE else 0.0
            total += kept[s, c]
        if total > 0:
            for c in range(len(possible)):
                kept[s, c] /= total


@compiled
def entropies(beliefs: Floats, given: Floats, groups: Integers, found: Floats) -> None:
    """Entropy of the next tap, and the loss of entropy of groups of classes to groups and taps together.

    Args:
        beliefs: Of sum one or zero, shape (S, C).
        given: P(tap | class), shape (C, N).
        groups: The classes of each group, shape (G, C / G).
        found: Receives H(tap) and H(group) - H(tap, group) in nats, shape (S, 2).
    """
    N = given.shape[1]
    tap, both, room = np.empty(N), np.empty(N), np.empty(groups.shape[1], np.int64)
    for s in range(len(beliefs)):
        tap[:] = 0.0
        gained = 0.0
        for g in range(len(groups)):
            mass = _mix(beliefs[s], given, groups[g], room, both)
            if mass > 0:
                gained -= mass * logarithm(mass) + entropy(both)
                for n in range(N):
                    tap[n] += both[n]
        found[s, 0], found[s, 1] = entropy(tap), gained


@compiled
def losses(beliefs: Floats, given: Floats, groups: Integers, loss: Floats, found: Floats) -> None:
    """Expected loss of the best decision after the next tap.

    Args:
        beliefs: Of sum one or zero, shape (S, C).
        given: P(tap | class), shape (C, N).
        groups: The classes of each object, shape (M, C / M).
        loss: Loss of each decision for each object, shape (A, M).
        found: Receives the losses, shape (S,).
    """
    M, N = len(groups), given.shape[1]
    both, mass, room = np.empty((M, N)), np.empty(M), np.empty(groups.shape[1], np.int64)
    least, decided = np.empty(N), np.empty(N)
    for s in range(len(beliefs)):
        for m in range(M):
            mass[m] = _mix(beliefs[s], given, groups[m], room, both[m])
        for a in range(len(loss)):
            decided[:] = 0.0
            for m in range(M):
                if mass[m] > 0 and loss[a, m] > 0:
                    _add(decided, loss[a, m], both[m])
            for n in range(N):
                least[n] = decided[n] if a == 0 else min(least[n], decided[n])
        found[s] = least.sum()


@compiled
def _mix(belief, given, classes, room, taps):
    """Probabilities of all taps together with one group of classes.

    Args:
        belief: Shape (C,).
        given: P(tap | class), shape (C, N).
        classes: Of the group.
        room: For as many integers.
        taps: Receives the probabilities, shape (N,), if the belief in the group is not zero.

    Returns:
        The belief in the group.
    """
    count, mass = 0, 0.0
    for c in classes:
        if belief[c] > _NO_SHARE:
            room[count] = c
            count += 1
            mass += belief[c]
    if count == 0:
        return mass
    taps[:] = 0.0
    whole = count - count % 4
    for i in range(0, whole, 4):  # four at a time, as each passage reads and writes all sums
        a, b, c, d = room[i], room[i + 1], room[i + 2], room[i + 3]
        _add_four(taps, belief[a], given[a], belief[b], given[b], belief[c], given[c], belief[d], given[d])
    for i in range(whole, count):
        _add(taps, belief[room[i]], given[room[i]])
    return mass


@compiled
def _add(sums, share, numbers):
    for n in range(len(sums)):
        sums[n] += share * numbers[n]


@compiled
def _add_four(sums, p, a, q, b, r, c, s, d):
    for n in range(len(sums)):
        sums[n] += (p * a[n] + q * b[n]) + (r * c[n] + s * d[n])
