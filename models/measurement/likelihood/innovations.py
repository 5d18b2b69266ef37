"""Compiled loops for the probability of the bins of many taps under Gaussian models.

A Gaussian over the samples of a tap is a chain of forecasts: each sample is normal given those before it, in the order
of time and, within one time, of the taxels. Whitening gives all of its innovations at once, sample minus forecast, and
the probability that the sample falls into its bin is a difference of two normal distribution functions.

All of these functions are in this one file, see `compiled`.
"""

import math

import numpy as np

from ...compiled import compiled

_ROOT_HALF = math.sqrt(0.5)
_HALF_LOG_TWO_PI = 0.5 * math.log(2 * math.pi)
_FAR = 25.0  # standard deviations beyond which a normal probability is taken by its logarithm
_SMALL = 1e-150  # products above it can take one more factor without leaving the range of float64


@compiled
def log_tail(z):
    """Log upper tail probability of a standard normal, for z above about 5; Abramowitz and Stegun 26.2.12."""
    s = 1 / (z * z)
    series = 1 - s * (1 - 3 * s * (1 - 5 * s * (1 - 7 * s)))
    return -0.5 * z * z - math.log(z) - _HALF_LOG_TWO_PI + math.log(series)


@compiled
def log_interval(a, b):
    """Log probability of a standard normal between a and b > a, both far on one side of 0."""
    if a < 0:
        a, b = -b, -a
    near = log_tail(a)
    if b > 1e150:
        return near
    gap = log_tail(b) - near
    return near + math.log(-math.expm1(gap)) if gap < 0 else near - 745.0


@compiled
def interval_probability(a, b):
    """Probability of a standard normal between a and b > a; 0 far out, where `log_interval` is needed."""
    if a > _FAR or b < -_FAR:
        return 0.0
    if a + b > 0:  # on the side where the tails are small, nothing is lost in the difference
        return 0.5 * (math.erfc(a * _ROOT_HALF) - math.erfc(b * _ROOT_HALF))
    return 0.5 * (math.erfc(-b * _ROOT_HALF) - math.erfc(-a * _ROOT_HALF))


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
def tap_log_probability(whitened, below, above, mean, taxel, scale, innovation):
    """Log probability of the bins of one tap under one Gaussian.

    Args:
        whitened: The tap, whitened in time, shape (J, K).
        below: Lower edge of each sample's bin minus the sample, shape (J, K).
        above: Upper edge minus the sample, likewise.
        mean: Mean of the whitened tap, shape (J, K).
        taxel: Unit lower triangular matrix that whitens across taxels, shape (K, K), or (0, 0) for none.
        scale: Standard deviation of each innovation, shape (J, K).
        innovation: Room for K numbers.
    """
    J, K = whitened.shape
    mixes = len(taxel) > 0
    total, product = 0.0, 1.0
    for j in range(J):
        for k in range(K):
            innovation[k] = whitened[j, k] - mean[j, k]
        if mixes:
            for k in range(K - 1, 0, -1):
                for i in range(k):
                    innovation[k] += taxel[k, i] * innovation[i]
        for k in range(K):
            a = (below[j, k] + innovation[k]) / scale[j, k]
            b = (above[j, k] + innovation[k]) / scale[j, k]
            mass = interval_probability(a, b)
            if mass < _SMALL:
                total += log_interval(a, b)
                continue
            product *= mass
            if product < _SMALL:
                total += math.log(product)
                product = 1.0
    return total + math.log(product)


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
    whitened, innovation, parts = np.empty((J, K)), np.empty(K), np.empty(Q)
    for i in range(n):
        whiten_time(taps[i], time, whitened)
        for c in range(C):
            mix = taxel[c if len(taxel) > 1 else 0]
            for q in range(Q):
                parts[q] = log_weight[q] + tap_log_probability(
                    whitened, below[i], above[i], mean[q, c], mix, scale[q, c], innovation
                )
            out[i, c] = log_sum(parts)


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
    log_probability, parts = np.empty(B), np.empty((Q, n))
    for q in range(Q):
        part = parts[q]
        part[:] = log_weight[q]
        for j in range(J):
            for k in range(K):
                for b in range(B):
                    low = (lower[k, b] - mean[q, c, j, k]) / scale[q, c, j, k]
                    high = (upper[k, b] - mean[q, c, j, k]) / scale[q, c, j, k]
                    mass = interval_probability(low, high)
                    log_probability[b] = log_interval(low, high) if mass < _SMALL else math.log(mass)
                for i in range(n):
                    part[i] += log_probability[bins[j, k, i]]
    for i in range(n):
        out[c, i] = log_sum(parts[:, i])


@compiled
def true_class_log_probability(taps, below, above, own, mean, taxel, scale, time, log_weight, out):
    """`class_log_probability` of each tap under its own class `own`, shape (n,); `out` has shape (n,)."""
    n, J, K = taps.shape
    Q = len(mean)
    whitened, innovation, parts = np.empty((J, K)), np.empty(K), np.empty(Q)
    for i in range(n):
        whiten_time(taps[i], time, whitened)
        c = own[i]
        mix = taxel[c if len(taxel) > 1 else 0]
        for q in range(Q):
            parts[q] = log_weight[q] + tap_log_probability(
                whitened, below[i], above[i], mean[q, c], mix, scale[q, c], innovation
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
