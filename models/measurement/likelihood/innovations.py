"""Compiled loops for the probability of the bins of many taps under Gaussian models.

A Gaussian over the samples of a tap is a chain of forecasts: each sample is normal given those before it, in the order
of time and, within one time, of the taxels. Whitening gives all of its innovations at once, sample minus forecast, and
the probability that the sample falls into its bin is a difference of two normal distribution functions.
"""

import math

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from scipy.special import erfcx

from ...compiled import compiled, polynomial
from ...elementary import LEAST, exponential, logarithm

_ROOT_HALF = math.sqrt(0.5)
_SMALL = 1e-150  # products above it can take one more factor without leaving the range of float64
_AT_ONCE = 256  # intervals that are computed together, so that they stay in cache
_NARROW = 0.01  # widths, times the distance to 0 if that is above 1, for which three terms of a series are exact
_DENSITY = 1 / math.sqrt(2 * math.pi)
_PIVOT = 3.75  # of the map of [0, inf) to [-1, 1); Shepherd and Laframboise, Math. Comp. 36 (1981) 249


def _scaled_tail(t):
    """(1 + 2 x) exp(x^2) erfc(x) at t = (x - pivot) / (x + pivot), from -1 to 1."""
    x = _PIVOT * (1 + t) / np.maximum(1 - t, 1e-12)
    return (1 + 2 * x) * erfcx(x)


_tail = polynomial(Chebyshev.interpolate(_scaled_tail, 25).convert(kind=Polynomial).coef[::-1])


@compiled
def scaled_tail(z):
    """Upper tail probability of a standard normal over exp(-z^2 / 2), for z of at least 0."""
    x = z * _ROOT_HALF
    beyond, growth = x + _PIVOT, 1 + 2 * x
    quotient = 1 / (beyond * growth)  # one division instead of two
    return 0.5 * _tail((x - _PIVOT) * growth * quotient) * beyond * quotient


@compiled
def intervals(a, b, near, factor):
    """Probability of a standard normal in each interval, as factor * exp(-near^2 / 2).

    Each loop is short, so that it uses vector instructions.

    Args:
        a: Lower ends, shape (n,); receives the end nearer to 0, mirrored to a tail above 0, if both have one sign.
        b: Upper ends above them, shape (n,); receives the other end.
        near: Receives the distance to 0, shape (n,).
        factor: Receives the factor, shape (n,); `_SMALL` where rounding has left no width.
    """
    for i in range(a.size):
        low, high = max(a[i], -1e100), min(b[i], 1e100)
        mirrored = low + high < 0  # to the side where tails are small and nothing is lost in their difference
        a[i] = -high if mirrored else low
        b[i] = -low if mirrored else high
    for i in range(a.size):
        near[i] = max(a[i], 0.0)
    for i in range(a.size):
        drop = -0.5 * (b[i] - near[i]) * (b[i] + near[i])
        factor[i] = scaled_tail(b[i]) * exponential(max(drop, LEAST))
    for i in range(a.size):
        tail = scaled_tail(abs(a[i]))
        inside = 1 - tail * exponential(max(-0.5 * a[i] * a[i], LEAST))
        factor[i] = max((tail if a[i] >= 0 else inside) - factor[i], _SMALL)


@compiled
def log_probabilities(lower, upper, out):
    """Writes the log probability of a standard normal in each interval, NaN where an end is, all of shape (n,).

    It is -inf in an interval without width.
    """
    room = np.empty((4, _AT_ONCE))
    for start in range(0, len(out), _AT_ONCE):
        own = out[start : start + _AT_ONCE]
        low, high = lower[start : start + _AT_ONCE], upper[start : start + _AT_ONCE]
        a, b, near, factor = room[0, : len(own)], room[1, : len(own)], room[2, : len(own)], room[3, : len(own)]
        for i in range(len(own)):
            a[i], b[i] = low[i], high[i]
        intervals(a, b, near, factor)
        for i in range(len(own)):
            width, middle = high[i] - low[i], 0.5 * (low[i] + high[i])
            square, steps = middle * middle, width * width
            series = 1 + steps * ((square - 1) / 24 + steps * ((square - 6) * square + 3) / 1920)
            narrow = width * max(1.0, abs(middle)) < _NARROW  # where the difference of two tails is rounding
            mass, drop = (_DENSITY * width * series, square) if narrow else (factor[i], near[i] * near[i])
            value = logarithm(mass) - 0.5 * drop if mass > _SMALL else -np.inf
            own[i] = value if low[i] <= high[i] else np.nan


@compiled
def total_log_probability(a, b, near, factor):
    """Sum of the log probabilities of a standard normal in intervals, see `intervals`."""
    intervals(a, b, near, factor)
    total, product = 0.0, 1.0
    for i in range(a.size):
        total -= 0.5 * near[i] * near[i]
    for i in range(a.size):
        product *= factor[i]
        if product < _SMALL:
            total += math.log(product)
            product = 1.0
    return total + math.log(product)


@compiled
def whiten_time(tap, time, out):
    """Multiplies the samples of each taxel by a unit lower triangular matrix.

    Args:
        tap: Shape (J, K).
        time: Shape (J, J) for all taxels or (K, J, J) for each, as (G, J, J).
        out: Shape (J, K).
    """
    J, K = tap.shape
    shared = len(time) == 1
    for j in range(J):
        for k in range(K):
            out[j, k] = tap[j, k]
    for j in range(1, J):
        for i in range(j):
            if shared:
                weight = time[0, j, i]
                if weight != 0:
                    for k in range(K):
                        out[j, k] += weight * tap[i, k]
            else:
                for k in range(K):
                    out[j, k] += time[k, j, i] * tap[i, k]


@compiled
def whiten_taxels(tap, taxel, room, J):
    """Multiplies the K samples of each time by a unit lower triangular matrix, in place.

    Args:
        tap: Shape (J K,).
        taxel: Shape (K, K).
        room: Room for J K numbers; the times of each taxel lie together there, so that loops use vector instructions.
        J: Number of times.
    """
    K = len(taxel)
    if J == 1:
        for k in range(K - 1, 0, -1):
            total = tap[k]
            for i in range(k):
                total += taxel[k, i] * tap[i]
            tap[k] = total
        return
    for k in range(K):
        for j in range(J):
            room[k * J + j] = tap[j * K + k]
    for k in range(K - 1, 0, -1):
        own = room[k * J : (k + 1) * J]
        for i in range(k):
            weight, other = taxel[k, i], room[i * J : (i + 1) * J]
            for j in range(J):
                own[j] += weight * other[j]
    for k in range(K):
        for j in range(J):
            tap[j * K + k] = room[k * J + j]


@compiled
def tap_log_probability(whitened, below, above, mean, taxel, scale, room):
    """Log probability of the bins of one tap under one Gaussian.

    Args:
        whitened: The tap, whitened in time, shape (J, K).
        below: Lower edge of each sample's bin minus the sample, shape (J, K).
        above: Upper edge minus the sample, likewise.
        mean: Mean of the whitened tap, shape (J, K).
        taxel: Unit lower triangular matrix that whitens across taxels, shape (K, K), or (0, 0) for none.
        scale: Standard deviation of each innovation, shape (J, K).
        room: Room for 5 J K numbers, shape (5, J K).
    """
    J, K = whitened.shape
    n = J * K
    innovation, a, b = room[0], room[1], room[2]
    flat, centre, spread, down, up = (
        whitened.reshape(n),
        mean.reshape(n),
        scale.reshape(n),
        below.reshape(n),
        above.reshape(n),
    )
    for i in range(n):
        innovation[i] = flat[i] - centre[i]
    if len(taxel) > 0:
        whiten_taxels(innovation, taxel, a, J)
    for i in range(n):
        per_spread = 1 / spread[i]
        a[i] = (down[i] + innovation[i]) * per_spread
        b[i] = (up[i] + innovation[i]) * per_spread
    return total_log_probability(a, b, room[3], room[4])


@compiled
def class_log_probability(taps, below, above, mean, taxel, scale, time, log_weight, out):
    """Log probability of the bins of every tap under every class, each a mixture of Q Gaussians.

    Args:
        taps: Shape (n, J, K).
        below: Lower edge of each sample's bin minus the sample, shape (n, J, K).
        above: Upper edge minus the sample, likewise.
        mean: Means whitened in time, shape (Q, C, J, K).
        taxel: Shape (C, K, K), (1, K, K) for all alike or (1, 0, 0) for none.
        scale: Shape (Q, C, J, K).
        time: Shape (G, J, J).
        log_weight: Log weights of the mixture, shape (Q,).
        out: Receives the result, shape (n, C).
    """
    n, J, K = taps.shape
    Q, C = mean.shape[:2]
    whitened, parts, room = np.empty((J, K)), np.empty(Q), np.empty((5, J * K))
    for i in range(n):
        whiten_time(taps[i], time, whitened)
        for c in range(C):
            mix = taxel[c if len(taxel) > 1 else 0]
            for q in range(Q):
                parts[q] = log_weight[q] + tap_log_probability(
                    whitened, below[i], above[i], mean[q, c], mix, scale[q, c], room
                )
            out[i, c] = log_sum(parts)


@compiled
def vectors_log_probability(innovation, below, above, scale, out):
    """Log probability of the bins of taps of one sample under one Gaussian.

    Args:
        innovation: Of all taxels, shape (n, K).
        below: Lower edge of each sample's bin minus the sample, likewise.
        above: Upper edge minus the sample, likewise.
        scale: Standard deviation of each innovation, shape (K,).
        out: Receives the result, shape (n,).
    """
    n, K = innovation.shape
    room = np.empty((4, K))
    for i in range(n):
        for k in range(K):
            per_spread = 1 / scale[k]
            room[0, k] = (below[i, k] + innovation[i, k]) * per_spread
            room[1, k] = (above[i, k] + innovation[i, k]) * per_spread
        out[i] = total_log_probability(room[0], room[1], room[2], room[3])


@compiled
def independent_log_probability(c, bins, lower, upper, mean, scale, log_weight, out):
    """`class_log_probability` for class c with independent samples; the log probability of a bin is computed once.

    Args:
        c: The class.
        bins: Bins of all samples, shape (J, K, n).
        lower: Lower edge of each bin, -inf for the first of a taxel, shape (K, B).
        upper: Upper edge of each bin, inf for the last of a taxel, shape (K, B).
        mean: Shape (Q, C, J, K).
        scale: Shape (Q, C, J, K).
        log_weight: Log weights of the mixture, shape (Q,).
        out: Receives the result in row c, shape (C, n).
    """
    J, K, n = bins.shape
    Q, B = len(mean), lower.shape[1]
    log_probability, parts, room = np.empty(B), np.empty((Q, n)), np.empty((4, B))
    for q in range(Q):
        part = parts[q]
        part[:] = log_weight[q]
        for j in range(J):
            for k in range(K):
                for b in range(B):
                    room[0, b] = (lower[k, b] - mean[q, c, j, k]) / scale[q, c, j, k]
                    room[1, b] = (upper[k, b] - mean[q, c, j, k]) / scale[q, c, j, k]
                intervals(room[0], room[1], room[2], room[3])
                for b in range(B):
                    log_probability[b] = math.log(room[3, b]) - 0.5 * room[2, b] * room[2, b]
                for i in range(n):
                    part[i] += log_probability[bins[j, k, i]]
    for i in range(n):
        out[c, i] = log_sum(parts[:, i])


@compiled
def true_class_log_probability(taps, below, above, own, mean, taxel, scale, time, log_weight, out):
    """`class_log_probability` of each tap under its own class `own`, shape (n,), but with means as they are.

    `out` has shape (n,).
    """
    n, J, K = taps.shape
    Q = len(mean)
    centred, whitened, nothing = np.empty((J, K)), np.empty((J, K)), np.zeros((J, K))
    parts, room = np.empty(Q), np.empty((5, J * K))
    for i in range(n):
        c = own[i]
        mix = taxel[c if len(taxel) > 1 else 0]
        for q in range(Q):
            for j in range(J):
                for k in range(K):
                    centred[j, k] = taps[i, j, k] - mean[q, c, j, k]
            whiten_time(centred, time, whitened)
            parts[q] = log_weight[q] + tap_log_probability(
                whitened, below[i], above[i], nothing, mix, scale[q, c], room
            )
        out[i] = log_sum(parts)


@compiled
def log_sum(values):
    """Log of the sum of exponentials."""
    top = values[0]
    for value in values:
        top = max(top, value)
    total = 0.0
    for value in values:
        total += math.exp(value - top)
    return top + math.log(total)
