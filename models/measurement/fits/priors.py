"""Training taps and priors in the form that stories and fits take."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Taps(NamedTuple):
    """Training taps of known class.

    Attributes:
        samples: Scaled, shape (N, J, K).
        where: Where class of each tap, shape (N,).
        what: What class of each tap, shape (N,).
        shape: (L, M).
    """

    samples: NDArray[np.float64]
    where: NDArray[np.intp]
    what: NDArray[np.intp]
    shape: tuple[int, int]


class CellPrior(NamedTuple):
    """Normal-inverse-gamma prior of the level and variance of a cell, a class at a time and taxel.

    Attributes:
        level: Expected level, broadcast over (L, M, J, K).
        strength: How many samples that expectation is worth; 0 for a flat prior.
        a: Shape of the inverse gamma distribution of the variance, broadcast likewise.
        b: Its rate.
    """

    level: Any
    strength: Any
    a: Any
    b: Any


class KroneckerPrior(NamedTuple):
    """Wishart priors of two precision matrices, and a normal one of the means.

    Attributes:
        time_freedom: Degrees of freedom in time.
        time_scale: Expected covariance in time times the freedom, shape (J, J).
        taxel_freedom: Degrees of freedom across taxels.
        taxel_scale: Expected covariance across taxels times the freedom, shape (K, K).
        strength: How many taps the prior of the mean, at 0, is worth; 0 for a flat prior.
    """

    time_freedom: float
    time_scale: NDArray[np.float64]
    taxel_freedom: float
    taxel_scale: NDArray[np.float64]
    strength: float


class CurvePrior(NamedTuple):
    """A Gaussian process over position on a basis of D functions.

    Attributes:
        basis: Basis functions at the position of each tap, shape (N, D).
        width: Prior standard deviation of the weights, shape (D, K).
        a: Shape of the inverse gamma distribution of the variances, shape (K,).
        b: Its rate, shape (K,).
    """

    basis: NDArray[np.float64]
    width: NDArray[np.float64]
    a: NDArray[np.float64]
    b: NDArray[np.float64]
