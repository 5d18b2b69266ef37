"""A Gaussian process over (fixation point, logit of the threshold): what costs of some arms say of all others.

Costs are the value of a smooth function at the arm plus normal noise of the same size everywhere. The function has a
Matern covariance of order 5/2 with a length for each axis; lengths, size and noise are those of the highest posterior
under wide log-normal priors. Of an arm only number, mean and spread of its costs count. All is in units of the mean
and standard deviation of all costs so far, so no scale has to be given.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.spatial.distance import cdist
from scipy.special import logit

type Floats = NDArray[np.float64]
_JITTER = 1e-8
_PRIOR_SD = 1.0  # of the logarithm of each number


class Smoothness(NamedTuple):
    """How costs vary, in units of the standard deviation of all costs so far.

    Attributes:
        fixation: Length over which they do along the range, as a share of the tried one.
        theta: Likewise along the logit of the threshold.
        size: Standard deviation of mean costs over the arms.
        noise: That of single costs at an arm.
    """

    fixation: float
    theta: float
    size: float
    noise: float


_USUAL = Smoothness(0.3, 0.5, 0.5, 0.9)
"""Where nothing is known yet, and the medians of the priors."""


def places(fixation: ArrayLike, theta: ArrayLike) -> Floats:
    """Arms as points of the unit square, shape (A, 2)."""
    columns = np.asarray(fixation, dtype=np.float64), logit(np.asarray(theta, dtype=np.float64))
    return np.stack([(column - column.min()) / (np.ptp(column) or 1.0) for column in columns], axis=-1)


def arm_posterior(
    x: Floats, count: ArrayLike, mean: ArrayLike, squares: ArrayLike, smoothness: Smoothness | None = None
) -> tuple[Floats, Floats]:
    """Mean (A,) and covariance (A, A) of the mean costs of all arms.

    Args:
        x: The arms, see `places`, shape (A, 2).
        count: Costs seen of each, shape (A,), two or more together.
        mean: Their means, shape (A,).
        squares: Their sums of squared deviations, shape (A,).
        smoothness: `None` for the usual one.
    """
    smoothness = smoothness or _USUAL
    count, mean = np.asarray(count), np.asarray(mean, dtype=np.float64)
    centre, unit = _scale(count, mean, np.asarray(squares))
    seen = count > 0
    prior = covariance(x, smoothness)
    own = prior[np.ix_(seen, seen)] + np.diag(smoothness.noise**2 / count[seen] + _JITTER)
    factor = cho_factor(own, lower=True)
    cross = prior[:, seen]
    after = cross @ cho_solve(factor, (mean[seen] - centre) / unit)
    return centre + unit * after, unit**2 * (prior - cross @ cho_solve(factor, cross.T))


def covariance(x: Floats, smoothness: Smoothness) -> Floats:
    """Matern 5/2 between all arms, shape (A, A)."""
    scaled = x / np.array([smoothness.fixation, smoothness.theta])
    r = np.sqrt(5) * cdist(scaled, scaled)
    return smoothness.size**2 * (1 + r + r**2 / 3) * np.exp(-r)


def fitted_smoothness(x: Floats, count: ArrayLike, mean: ArrayLike, squares: ArrayLike) -> Smoothness:
    """The smoothness with the highest posterior; arguments as of `arm_posterior`."""
    count, mean, squares = np.asarray(count), np.asarray(mean, dtype=np.float64), np.asarray(squares)
    usual = np.log(_USUAL)

    def surprise(log: Floats) -> float:
        prior = (((log - usual) / _PRIOR_SD) ** 2).sum() / 2
        return prior - log_likelihood(x, count, mean, squares, Smoothness(*np.exp(log)))

    bounds = [(at - 4 * _PRIOR_SD, at + 4 * _PRIOR_SD) for at in usual]
    found = minimize(surprise, usual, method="L-BFGS-B", bounds=bounds)
    return Smoothness(*map(float, np.exp(found.x)))


def log_likelihood(x: Floats, count: ArrayLike, mean: ArrayLike, squares: ArrayLike, smoothness: Smoothness) -> float:
    """Log density of all costs, in units of their own mean and deviation; arguments as of `arm_posterior`."""
    count, mean, squares = np.asarray(count), np.asarray(mean, dtype=np.float64), np.asarray(squares)
    centre, unit = _scale(count, mean, squares)
    seen = count > 0
    n, z = count[seen], (mean[seen] - centre) / unit
    variance = smoothness.noise**2
    own = covariance(x[seen], smoothness) + np.diag(variance / n + _JITTER)
    factor = cho_factor(own, lower=True)
    means = -0.5 * z @ cho_solve(factor, z) - np.log(np.diag(factor[0])).sum() - len(n) / 2 * np.log(2 * np.pi)
    free = n.sum() - len(n)
    within = -squares.sum() / unit**2 / (2 * variance) - free / 2 * np.log(2 * np.pi * variance)
    return float(means + within - 0.5 * np.log(n).sum())


def _scale(count: NDArray[np.int64], mean: Floats, squares: Floats) -> tuple[float, float]:
    """Mean and standard deviation of all costs; 1 where they are all alike."""
    total = count.sum()
    centre = float(count @ mean / total)
    return centre, float(np.sqrt((squares.sum() + count @ (mean - centre) ** 2) / total)) or 1.0
