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
_SMALL = 1e-150  # the least factor, far below what rounding leaves of an interval that has a width
_MANTISSA, _ONE = (1 << 52) - 1, 1023 << 52  # of the bits of a number; the exponent of 1
_LOG_TWO = math.log(2)
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
    total, exponents = 0.0, 0
    for i in range(a.size):
        total -= 0.5 * near[i] * near[i]
    for start in range(0, a.size, _AT_ONCE):  # mantissas below 2, whose product stays in the range of float64
        some, product = factor[start : start + _AT_ONCE], 1.0
        for i in range(some.size):
            word = np.float64(some[i]).view(np.int64)
            exponents += word >> 52
            product *= np.int64(word & _MANTISSA | _ONE).view(np.float64)
        total += math.log(product)
    return total + (exponents - 1023 * a.size) * _LOG_TWO


@compiled
def taxels_first(samples, out):
    """Writes samples (J, K) to `out` (J K,), where the times of each taxel lie together for vector instructions."""
    J, K = samples.shape
    for j in range(J):
        for k in range(K):
            out[k * J + j] = samples[j, k]


@compiled
def mixes_times(time):
    """Whether unit lower triangular matrices, shape (G, J, J), do anything."""
    J = time.shape[1]
    for own in time:
        for j in range(1, J):
            for i in range(j):
                if own[j, i] != 0:
                    return True
    return False


@compiled
def whiten_time(tap, time):
    """Multiplies the samples of each taxel by a unit lower triangular matrix, in place.

    Args:
        tap: See `taxels_first`.
        time: Shape (J, J) for all taxels or (K, J, J) for each, as (G, J, J).
    """
    J = time.shape[1]
    for k in range(tap.size // J):
        own, matrix = tap[k * J : (k + 1) * J], time[k if len(time) > 1 else 0]
        for j in range(J - 1, 0, -1):
            row, total = matrix[j], own[j]
            for i in range(j):
                total += row[i] * own[i]
            own[j] = total


@compiled
def whiten_taxels(tap, taxel):
    """Multiplies the K samples of each time by a unit lower triangular matrix, in place.

    Args:
        tap: See `taxels_first`.
        taxel: Shape (K, K).
    """
    K = len(taxel)
    J = tap.size // K
    for k in range(K - 1, 0, -1):
        own = tap[k * J : (k + 1) * J]
        if J == 1:
            total = own[0]
            for i in range(k):
                total += taxel[k, i] * tap[i]
            own[0] = total
        else:
            for i in range(k):
                weight, other = taxel[k, i], tap[i * J : (i + 1) * J]
                for j in range(J):
                    own[j] += weight * other[j]


@compiled
def tap_log_probability(whitened, below, above, mean, taxel, per_scale, room):
    """Log probability of the bins of one tap under one Gaussian.

    All samples are as `taxels_first` gives them.

    Args:
        whitened: The tap, whitened in time, shape (J K,).
        below: Lower edge of each sample's bin minus the sample, likewise.
        above: Upper edge minus the sample, likewise.
        mean: Mean of the whitened tap, likewise.
        taxel: Unit lower triangular matrix that whitens across taxels, shape (K, K), or (0, 0) for none.
        per_scale: One over the standard deviation of each innovation, shape (J K,).
        room: Room for 5 J K numbers, shape (5, J K).
    """
    innovation, a, b = room[0], room[1], room[2]
    for i in range(whitened.size):
        innovation[i] = whitened[i] - mean[i]
    if len(taxel) > 0:
        whiten_taxels(innovation, taxel)
    for i in range(whitened.size):
        a[i] = (below[i] + innovation[i]) * per_scale[i]
        b[i] = (above[i] + innovation[i]) * per_scale[i]
    return total_log_probability(a, b, room[3], room[4])


@compiled
def class_log_probability(taps, below, above, mean, taxel, per_scale, time, log_weight, out):
    """Log probability of the bins of every tap under every class, each a mixture of Q Gaussians.

    Args:
        taps: Shape (n, J, K).
        below: Lower edge of each sample's bin minus the sample, shape (n, J, K).
        above: Upper edge minus the sample, likewise.
        mean: Means whitened in time, shape (Q, C, K, J).
        taxel: Shape (C, K, K), (1, K, K) for all alike or (1, 0, 0) for none.
        per_scale: One over the standard deviation of each innovation, shape (Q, C, K, J).
        time: Shape (G, J, J).
        log_weight: Log weights of the mixture, shape (Q,).
        out: Receives the result, shape (n, C).
    """
    (Q, C), size, mixed = mean.shape[:2], taps[0].size, mixes_times(time)
    centre, spread = mean.reshape(Q, C, size), per_scale.reshape(Q, C, size)
    tap, parts, room = np.empty((3, size)), np.empty(Q), np.empty((5, size))
    for i in range(len(taps)):
        taxels_first(taps[i], tap[0])
        taxels_first(below[i], tap[1])
        taxels_first(above[i], tap[2])
        if mixed:
            whiten_time(tap[0], time)
        for c in range(C):
            mix = taxel[c if len(taxel) > 1 else 0]
            for q in range(Q):
                parts[q] = log_weight[q] + tap_log_probability(
                    tap[0], tap[1], tap[2], centre[q, c], mix, spread[q, c], room
                )
            out[i, c] = log_sum(parts)


@compiled
def vectors_log_probability(innovation, below, above, per_scale, out):
    """Log probability of the bins of taps of one sample under one Gaussian.

    Args:
        innovation: Of all taxels, shape (n, K).
        below: Lower edge of each sample's bin minus the sample, likewise.
        above: Upper edge minus the sample, likewise.
        per_scale: One over the standard deviation of each innovation, shape (K,).
        out: Receives the result, shape (n,).
    """
    n, K = innovation.shape
    room = np.empty((4, K))
    for i in range(n):
        for k in range(K):
            room[0, k] = (below[i, k] + innovation[i, k]) * per_scale[k]
            room[1, k] = (above[i, k] + innovation[i, k]) * per_scale[k]
        out[i] = total_log_probability(room[0], room[1], room[2], room[3])


@compiled
def independent_log_probability(c, bins, lower, upper, mean, per_scale, log_weight, out):
    """`class_log_probability` for class c with independent samples; the log probability of a bin is computed once.

    Args:
        c: The class.
        bins: Bins of all samples, shape (J, K, n).
        lower: Lower edge of each bin, -inf for the first of a taxel, shape (K, B).
        upper: Upper edge of each bin, inf for the last of a taxel, shape (K, B).
        mean: Shape (Q, C, K, J).
        per_scale: One over the standard deviation, shape (Q, C, K, J).
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
                    room[0, b] = (lower[k, b] - mean[q, c, k, j]) * per_scale[q, c, k, j]
                    room[1, b] = (upper[k, b] - mean[q, c, k, j]) * per_scale[q, c, k, j]
                intervals(room[0], room[1], room[2], room[3])
                for b in range(B):
                    log_probability[b] = math.log(room[3, b]) - 0.5 * room[2, b] * room[2, b]
                for i in range(n):
                    part[i] += log_probability[bins[j, k, i]]
    for i in range(n):
        out[c, i] = log_sum(parts[:, i])


@compiled
def true_class_log_probability(taps, below, above, own, mean, taxel, scale, time, log_weight, out):
    """`class_log_probability` of each tap under its own class `own`, shape (n,), with parameters as of a form.

    `mean`, as it is, and `scale` have shape (Q, C, J, K), `out` (n,).
    """
    (n, J, K), mixed = taps.shape, mixes_times(time)
    Q, size = len(mean), J * K
    tap, nothing = np.empty((4, size)), np.zeros(size)
    parts, room = np.empty(Q), np.empty((5, size))
    for i in range(n):
        c = own[i]
        mix = taxel[c if len(taxel) > 1 else 0]
        taxels_first(below[i], tap[1])
        taxels_first(above[i], tap[2])
        for q in range(Q):
            for j in range(J):
                for k in range(K):
                    tap[0, k * J + j] = taps[i, j, k] - mean[q, c, j, k]
                    tap[3, k * J + j] = 1 / scale[q, c, j, k]
            if mixed:
                whiten_time(tap[0], time)
            parts[q] = log_weight[q] + tap_log_probability(tap[0], tap[1], tap[2], nothing, mix, tap[3], room)
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
