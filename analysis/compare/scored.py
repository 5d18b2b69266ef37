"""Compiled loop for the belief in position and object after a fixed number of taps, and what it scores."""

import numpy as np

from ...models.compiled import compiled
from ...models.elementary import LEAST, exponential

_LANES = 16
_SMALL = 1e-290  # below it a belief may have lost digits


@compiled
def score(log_likelihood, log_prior, M, power, taps, where, what, values, top, hit):
    """Scores sequences of taps; where no class is left nothing is believed, so nothing is right.

    Args:
        log_likelihood: Of N taps under L x S M hypotheses, shape (N, L, S M).
        log_prior: Shape (L, S M).
        M: Number of objects.
        power: Of the belief.
        taps: Taps of each sequence, shape (sequences, n).
        where: True positions, shape (sequences,).
        what: True objects, shape (sequences,).
        values: Receives `classes.MEANS` in that order, shape (sequences, 9).
        top: Receives the belief in the most probable object and position, shape (sequences, 2).
        hit: Receives whether these are right, shape (sequences, 2).
    """
    L, log_joint, each = len(log_prior), np.empty(log_prior.shape), np.empty(log_prior.shape)
    belief, by_where, by_what = np.empty((L, M)), np.empty(L), np.empty(M)
    for i in range(len(taps)):
        l, m = where[i], what[i]
        most = _join(log_likelihood, log_prior, power, taps[i], log_joint)
        if most == -np.inf:
            values[i], top[i], hit[i] = 0.0, 0.0, 0.0
            values[i, 0], values[i, 1] = -np.inf, -np.inf
            values[i, 2], values[i, 3], values[i, 7], values[i, 8] = 1.0, 1.0, 1.0, 1.0
            continue
        log_total = most + np.log(_share(log_joint, most, each, belief))
        square, highest, first = 0.0, -1.0, 0
        by_what[:] = 0.0
        for other in range(L):
            row = 0.0
            for n in range(M):
                value = belief[other, n]
                row += value
                by_what[n] += value
                square += value * value
                if value > highest:
                    highest, first = value, other * M + n
            by_where[other] = row
        square_what = 0.0
        for n in range(M):
            square_what += by_what[n] * by_what[n]
        true = _log_sum(log_joint[l : l + 1, m::M]) - log_total
        small = by_what[m] < _SMALL
        best, best_where = _first_of(by_what), _first_of(by_where)
        top[i, 0], top[i, 1] = by_what[best], by_where[best_where]
        hit[i, 0], hit[i, 1] = best == m, best_where == l
        values[i, 0] = true
        values[i, 1] = _log_sum(log_joint[:, m::M]) - log_total if small else np.log(by_what[m])
        values[i, 2] = square - 2 * np.exp(true) + 1
        values[i, 3] = square_what - 2 * by_what[m] + 1
        values[i, 4], values[i, 5], values[i, 6] = first == l * M + m, hit[i, 1], hit[i, 0]
        values[i, 7], values[i, 8] = true == -np.inf, 0.0


@compiled
def _first_of(values):
    """The first of the largest values."""
    first = 0
    for n in range(1, len(values)):
        if values[n] > values[first]:
            first = n
    return first


@compiled
def _join(log_likelihood, log_prior, power, taps, log_joint):
    """Writes the log joint of taps and hypotheses, to a power, and returns the largest."""
    size, n, k = log_prior.size, len(taps), 0
    joint, prior = log_joint.reshape(size), log_prior.reshape(size)
    for c in range(size):
        joint[c] = prior[c]
    while k + 4 <= n:  # four taps at a time save three of four passes over `joint`
        r0, r1 = log_likelihood[taps[k]].reshape(size), log_likelihood[taps[k + 1]].reshape(size)
        r2, r3 = log_likelihood[taps[k + 2]].reshape(size), log_likelihood[taps[k + 3]].reshape(size)
        for c in range(size):
            joint[c] += r0[c] + r1[c] + r2[c] + r3[c]
        k += 4
    while k < n:
        row = log_likelihood[taps[k]].reshape(size)
        for c in range(size):
            joint[c] += row[c]
        k += 1
    for c in range(size):
        joint[c] *= power
    tops = np.full(_LANES, -np.inf)
    for start in range(0, size - _LANES + 1, _LANES):  # without a single largest value, so that vectors are used
        for lane in range(_LANES):
            tops[lane] = max(tops[lane], joint[start + lane])
    most = -np.inf
    for lane in range(_LANES):
        most = max(most, tops[lane])
    for c in range(size - size % _LANES, size):
        most = max(most, joint[c])
    return most


@compiled
def _share(log_joint, most, each, belief):
    """Writes the belief in position and object, shape (L, M), and returns the sum that it was divided by.

    `each` receives that in every hypothesis, shape (L, S M), times this sum.
    """
    (L, M), total = belief.shape, 0.0
    logs, flat, sums = log_joint.reshape(log_joint.size), each.reshape(each.size), belief.reshape(belief.size)
    if len(logs) == len(sums):
        flat = sums
    for c in range(len(logs)):  # without states between, so that vector instructions are used
        flat[c] = exponential(max(logs[c] - most, LEAST))
    if len(logs) > len(sums):
        for l in range(L):
            own, row = belief[l], each[l]
            own[:] = 0.0
            for first in range(0, len(row), M):
                for m in range(M):
                    own[m] += row[first + m]
    for c in range(len(sums)):
        total += sums[c]
    for c in range(len(sums)):
        sums[c] /= total
    return total


@compiled
def _log_sum(logs):
    """Log of the sum of exponentials of two-dimensional logs."""
    most, total = -np.inf, 0.0
    for l in range(logs.shape[0]):
        for s in range(logs.shape[1]):
            most = max(most, logs[l, s])
    if most == -np.inf:
        return most
    for l in range(logs.shape[0]):
        for s in range(logs.shape[1]):
            total += np.exp(logs[l, s] - most)
    return most + np.log(total)
