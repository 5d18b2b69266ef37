"""Log probability of intervals under normal and Student's t distributions, accurate in the tails."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, stdtr


def log_normal_probability(lower: ArrayLike, upper: ArrayLike) -> NDArray[np.float64]:
    """Log probability of a standard normal between `lower` and `upper`, arrays that broadcast."""
    return _log_probability(lower, upper, log_ndtr)


def log_student_probability(lower: ArrayLike, upper: ArrayLike, freedom: ArrayLike) -> NDArray[np.float64]:
    """Log probability of Student's t with `freedom` degrees of freedom, as `log_normal_probability`."""

    def log_cdf(x: NDArray[np.float64]) -> NDArray[np.float64]:
        with np.errstate(divide="ignore"):
            return np.log(stdtr(np.broadcast_to(freedom, x.shape), x))

    return _log_probability(lower, upper, log_cdf)


def _log_probability(lower: ArrayLike, upper: ArrayLike, log_cdf: Any) -> NDArray[np.float64]:
    lower, upper = np.broadcast_arrays(np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64))
    with np.errstate(invalid="ignore"):
        right = lower + upper > 0  # mirrored, because distribution functions are exact near 0 and not near 1
    low, high = np.where(right, -upper, lower), np.where(right, -lower, upper)
    log_high = log_cdf(high)
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = log_cdf(low) - log_high
        return np.where(np.isneginf(log_high), -np.inf, log_high + np.log(-np.expm1(gap)))
