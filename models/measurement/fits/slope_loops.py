"""Compiled loops over the slopes by which samples are predicted from others."""

import numpy as np

from ...compiled import compiled
from ...elementary import logarithm


@compiled
def innovation_squares(slope, scatter, out):
    """Sums of squared samples minus what others add to them, the diagonal of (1 - B) S (1 - B)'.

    Args:
        slope: B, strictly lower triangular, shape (C, K, K).
        scatter: S, symmetric, shape (C, J, K, K).
        out: Receives the sums, shape (C, J, K).
    """
    C, J, K = out.shape
    weight = np.empty(K)
    for c in range(C):
        for k in range(K):
            for i in range(k):
                weight[i] = -slope[c, k, i]
            weight[k] = 1.0
            for j in range(J):
                square = 0.0
                for i in range(k + 1):
                    row, total = scatter[c, j, i], 0.0
                    for x in range(k + 1):
                        total += row[x] * weight[x]
                    square += weight[i] * total
                out[c, j, k] = max(square, 0.0)


@compiled
def log_evidence(rho, constant, linear, quadratic, a, b, out):
    """Log probability of samples up to a constant, given slopes in time and the inverse gamma prior of variances.

    Args:
        rho: Slopes of each taxel, shape (K, G).
        constant: Sums of squares without a slope, shape (C, K).
        linear: What these lose by twice a slope of 1, shape (C, K).
        quadratic: What they gain by its square, shape (C, K).
        a: Shape of the posterior of each variance, shape (C, K).
        b: Rate of the prior, shape (K,).
        out: Receives the sums over C, shape (K, G).
    """
    (C, K), G = constant.shape, rho.shape[1]
    out[:] = 0.0
    for c in range(C):
        for k in range(K):
            slopes, total = rho[k], out[k]
            none, once, twice, shape, rate = constant[c, k], linear[c, k], quadratic[c, k], a[c, k], b[k]
            for g in range(G):
                square = none - 2 * slopes[g] * once + slopes[g] * slopes[g] * twice
                total[g] -= shape * logarithm(rate + 0.5 * max(square, 0.0))
