"""Covariances of classes: their prior where taps are few for the number of taxels, draws and Cholesky factors.

The prior is learned from all classes. The covariance of a class is inverse-Wishart around one of all classes, and that
one around a diagonal. Both distributions have their mean there, and so many degrees of freedom above the fewest with a
mean as make the taps most probable (Haff, Annals of Statistics 8 (1980) 586; the evidence is in closed form). The
covariance that a class is shrunk to is the pooled one, shrunk itself to its diagonal; how far classes keep to it is
judged from each class under that of the others, so that no class confirms itself.

The means of classes are normal around that of all, in proportion to the covariance. Of many taxels means of few taps
differ by chance alone, and without that prior every difference would count.

With S taps less than taxels a scatter has rank S, and all but one Cholesky factor for each class is of that size.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack, solve_triangular
from scipy.optimize import minimize_scalar
from scipy.special import gammaln

_LAPACK: Any = lapack  # whose stubs are not complete
LEAST_TIES, MOST_TIES = 1.0, 1e4
"""Range of the degrees of freedom above the fewest with a mean, K + 1: what the prior counts in taps."""
_LEAST_STRENGTH = 1e-3  # of the prior of means in taps; the most is that of ties


def shrinking_prior(scatter: NDArray[np.float64], freedom: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Degrees of freedom and inverse scale (K, K) of the Wishart distribution of the precisions of classes.

    Args:
        scatter: Sums of squares of each class in units of `Scaling`, shape (C, K, K).
        freedom: Their degrees of freedom, shape (C,); classes with none do not count.
    """
    K, used = scatter.shape[-1], np.flatnonzero(freedom > 0)
    total, taps = np.sum(scatter, axis=0), float(freedom.sum())
    # A sample of variance 1 more, without which a taxel that never changes would have none.
    variance = (np.diag(total) + 1) / (taps + 1)
    deviation = np.sqrt(variance)
    ties = _most_probable(K, [(taps, _spectrum(_root(total) / deviation[:, None]))])
    np.einsum("kk->k", total)[:] += ties * variance
    if len(used) == 1:
        return K + 1 + MOST_TIES, total * (MOST_TIES / (ties + taps))
    judged = []
    for c in used:
        others = np.linalg.cholesky((total - scatter[c]) / (ties + taps - freedom[c]))
        judged.append((float(freedom[c]), _spectrum(solve_triangular(others, _root(scatter[c]), lower=True))))
    common = _most_probable(K, judged) if judged else MOST_TIES
    return K + 1 + common, total * (common / (ties + taps))


def strength_of_means(mean: NDArray[np.float64], taps: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    """How many taps the prior of a mean, at 0, is worth: the most probable number, 0 for a single class.

    Args:
        mean: Means of the classes from that of all, shape (C, K); of those without a tap they do not count.
        taps: How many taps each class has, shape (C,).
        covariance: Typical covariance of a class, shape (K, K).
    """
    mean, taps = mean[taps > 0], taps[taps > 0]
    C, K = mean.shape
    if C == 1:
        return 0.0
    white = solve_triangular(np.linalg.cholesky(covariance), mean.T, lower=True)
    square = np.square(white).sum(axis=0)

    def minus_log_evidence(log_strength: float) -> float:
        strength = np.exp(log_strength)
        share = strength / (strength + taps)
        # The mean of all is estimated, which takes one class's worth of freedom.
        return -0.5 * float((K * (1 - 1 / C) * np.log(share) - share * taps * square).sum())

    return _best(minus_log_evidence, _LEAST_STRENGTH)


def _root(scatter: NDArray[np.float64]) -> NDArray[np.float64]:
    """A matrix (K, R) of full rank whose product with its transpose is a scatter (K, K)."""
    factor, order, rank, _ = _LAPACK.dpstrf(scatter, lower=1)
    root = np.empty((len(scatter), rank))
    root[order - 1] = np.tril(factor)[:, :rank]
    return root


def _spectrum(root: NDArray[np.float64]) -> NDArray[np.float64]:
    """Eigenvalues above 0 of the product of a matrix (K, R) with its transpose, shape (R,)."""
    return np.maximum(np.linalg.eigvalsh(root.T @ root), 0.0)


def _most_probable(K: int, judged: Sequence[tuple[float, NDArray[np.float64]]]) -> float:
    """Degrees of freedom above K + 1 of a prior with mean 1 under which scatters are most probable.

    Args:
        K: Number of taxels.
        judged: Degrees of freedom and eigenvalues above 0 of each scatter, in units of the mean.
    """

    def minus_log_evidence(log_ties: float) -> float:
        ties, rows = float(np.exp(log_ties)), np.arange(K)
        before = K + 1 + ties
        total = 0.0
        for taps, eigenvalues in judged:
            after = before + taps
            total += (gammaln(0.5 * (after - rows)) - gammaln(0.5 * (before - rows))).sum()
            total += 0.5 * (before * len(eigenvalues) - taps * (K - len(eigenvalues))) * log_ties
            total -= 0.5 * after * np.log(ties + eigenvalues).sum()
        return -float(total)

    return _best(minus_log_evidence, LEAST_TIES)


def _best(minus_log_evidence: Callable[[float], float], least: float) -> float:
    """Number from `least` on at whose logarithm the function is smallest."""
    limits = np.log(least), np.log(MOST_TIES)
    found: Any = minimize_scalar(minus_log_evidence, bounds=limits, method="bounded", options={"xatol": 1e-4})
    return float(np.exp(found.x))


def inverse_wishart(
    scale: NDArray[np.float64], freedom: NDArray[np.float64], generator: np.random.Generator
) -> NDArray[np.float64]:
    """Inverse Wishart draws of covariances (..., D, D); Bartlett's decomposition."""
    D = scale.shape[-1]
    factor = np.tril(generator.standard_normal(scale.shape), -1)
    diagonal = np.sqrt(generator.chisquare(freedom[..., None] - np.arange(D)))
    factor[..., np.arange(D), np.arange(D)] = diagonal
    # precision = C F F' C' with C C' = inverse of the scale, so covariance = (F' C')^-1 (C F)^-1
    root = np.linalg.cholesky(np.linalg.inv(scale)) @ factor
    inverse = np.linalg.inv(root)
    return inverse.swapaxes(-1, -2) @ inverse


def unit_triangular(covariance: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit lower triangular matrices that whiten covariances (..., D, D), and the remaining variances (..., D)."""
    factor = np.linalg.cholesky(covariance)
    diagonal = np.diagonal(factor, axis1=-2, axis2=-1).copy()
    for which in np.ndindex(factor.shape[:-2]):  # one after the other, as each may be large
        inverse, _ = _LAPACK.dtrtri(factor[which], lower=1)
        factor[which] = inverse * diagonal[which][:, None]
    return factor, diagonal**2
