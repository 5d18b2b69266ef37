"""Covariance of the samples of taps, regressed on the patterns of gain, timing and shared noise.

Across taxels the patterns are a gain, a shift in time, the level that former taps leave, and a common disturbance at
each step of lags; what these leave within taxels is noise of single ones. Regressing products on products is the method
of moments for variance components (Searle, Casella and McCulloch, "Variance Components", 1992, ch. 4).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .classes import EvidenceClass

GAIN, TIMING, FORMER = 0, 1, 2
"""Patterns by their place."""
PATTERNS = 3
"""How many there are that are not a common disturbance."""
_LAGS = (0, 1, 2, 3, 5, 9, 17, 33, 65, 129, 257)  # first lag of each step of an autocovariance


class SampleMoments(NamedTuple):
    """What the samples of each class say of their covariance; stacked over C classes.

    Patterns are gain, timing, the level that former taps leave, and a common disturbance at each of S steps of lags.

    Attributes:
        normal: Products of the patterns across taxels, shape (C, P, P).
        right: Products of the patterns with the observed covariance, shape (C, P).
        lagged: Observed covariance within taxels, summed at each step of lags, shape (C, S).
        pairs: Number of pairs of samples there, shape (C, S).
        patterns_within: What each pattern at variance 1 adds to that covariance, shape (C, P, S).
    """

    normal: NDArray[np.float64]
    right: NDArray[np.float64]
    lagged: NDArray[np.float64]
    pairs: NDArray[np.float64]
    patterns_within: NDArray[np.float64]

    def solve(self, weight: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Variances of the patterns, (..., P), and of noise at each step of lags, (..., S), by weights (..., C)."""
        normal, right, lagged, pairs, within = (np.tensordot(weight, part, 1) for part in self)
        theta = _least_squares(normal, right)
        left = lagged - (theta[..., np.newaxis, :] @ within)[..., 0, :]
        return theta, np.divide(left, pairs, out=np.zeros_like(left), where=pairs > 0)


def lag_steps(J: int) -> NDArray[np.intp]:
    """The step of each lag, shape (J,)."""
    return np.searchsorted(_LAGS, np.arange(J), side="right") - 1


def sample_moments(one: EvidenceClass, samples: NDArray[np.float64], steps: NDArray[np.intp]) -> SampleMoments:
    """The moments of one class's samples (n, J, K)."""
    residual, freedom = one.without(samples, one.session)
    live = ((residual**2).sum(axis=0) > 0).astype(np.float64)
    mean = samples.mean(axis=0)
    patterns = np.stack([mean, slope(mean), np.broadcast_to((mean - mean[0]).mean(axis=0), mean.shape)]) * live
    S, J = int(steps.max()) + 1, len(steps)
    normal, right = np.zeros((PATTERNS + S, PATTERNS + S)), np.zeros(PATTERNS + S)
    within = np.zeros((PATTERNS + S, S))
    across, same = taxel_pairs(live)
    normal[PATTERNS:, PATTERNS:] = np.diag(by_step(across, steps))
    within[PATTERNS:] = np.diag(by_step(same, steps))
    for a, pattern in enumerate(patterns):
        for b, other in enumerate(patterns):
            by_taxel = (pattern * other).sum(axis=0)
            normal[a, b] = by_taxel.sum() ** 2 - (by_taxel**2).sum()
        across, same = taxel_pairs(pattern)
        normal[a, PATTERNS:] = normal[PATTERNS:, a] = by_step(across, steps)
        within[a] = by_step(same, steps)
        projected = np.einsum("njk,jk->nk", residual, pattern)
        right[a] = (projected.sum(axis=1) ** 2).sum() - (projected**2).sum()
    sums = residual.sum(axis=2)
    flat = residual.transpose(1, 0, 2).reshape(J, -1)
    observed_within = flat @ flat.T
    right[PATTERNS:] = by_step(sums.T @ sums - observed_within, steps)
    pairs = by_step(taxel_pairs(live)[1], steps)
    return SampleMoments(normal, right / freedom, by_step(observed_within, steps) / freedom, pairs, within)


def slope(taps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Change from sample to sample of taps (..., J, K); 0 with one sample."""
    return np.gradient(taps, axis=-2) if taps.shape[-2] > 1 else np.zeros_like(taps)


def taxel_pairs(a: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sums over pairs of taxels of a_jk a_j'k', of different ones and of the same, each of shape (J, J)."""
    same, total = a @ a.T, a.sum(axis=1)
    return np.outer(total, total) - same, same


def by_step(matrix: NDArray[np.float64], steps: NDArray[np.intp]) -> NDArray[np.float64]:
    """Sums of a matrix (J, J) over the pairs of times at each step of lags."""
    lag = np.abs(np.arange(len(steps))[:, None] - np.arange(len(steps)))
    return np.bincount(steps[lag].ravel(), matrix.ravel(), minlength=int(steps.max()) + 1)


def _least_squares(normal: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """The solution of normal equations, the shortest one where patterns are missing or cannot be told apart."""
    scale = np.sqrt(np.diagonal(normal, axis1=-2, axis2=-1))
    scale = np.where(scale == 0, 1.0, scale)
    inverse = np.linalg.pinv(normal / (scale[..., np.newaxis] * scale[..., np.newaxis, :]), rcond=1e-8)
    return (inverse @ (right / scale)[..., np.newaxis])[..., 0] / scale
