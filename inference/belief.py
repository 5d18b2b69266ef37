"""From the belief that Bayes' rule carries to the belief that decisions use: at most n0 taps' evidence, no states.

Taps of one episode share unknowns such as the gain of the sensor that day, so n taps carry less evidence than n
independent ones. Bayes' rule over taps and moves treats them as independent; decisions and displays after n taps use
that belief to the power min(1, n0 / n), normalised. In logs this is the mean evidence of the taps so far, counted n0
times. The order of the classes stays, so the power delays decisions; answers change only through moves and through the
sums of marginals. `kernel.temper` and `trials.gpu.temper` are the same, compiled.

Models with states carry a belief over hypotheses, shape (L, H) with H = S M, see `models.measurement.states`; decisions
use its sum over the states.
"""

import numpy as np
from numpy.typing import NDArray


def share(taps: int, saturation: float) -> float:
    """The power of a belief after some taps, 1 up to `saturation` of them."""
    return 1.0 if taps <= saturation else saturation / taps


def temper(log_belief: NDArray[np.float64], power: float) -> NDArray[np.float64]:
    """Beliefs to a power, normalised over the classes or hypotheses; at power 1 the very same array.

    Args:
        log_belief: Shape (..., L, H), with something above log 0 in each.
        power: Above 0.
    """
    if power == 1:
        return log_belief
    raised = power * log_belief
    top = raised.max(axis=(-2, -1), keepdims=True)
    return raised - (top + np.log(np.exp(raised - top).sum(axis=(-2, -1), keepdims=True)))


def fold(belief: NDArray[np.float64], M: int) -> NDArray[np.float64]:
    """The belief in where and what, shape (..., L, M), from one over hypotheses, shape (..., L, S M)."""
    H = belief.shape[-1]
    return belief if H == M else belief.reshape(*belief.shape[:-1], H // M, M).sum(axis=-2)


def log_fold(log_belief: NDArray[np.float64], M: int) -> NDArray[np.float64]:
    """`fold` in logs."""
    H = log_belief.shape[-1]
    if H == M:
        return log_belief
    return np.logaddexp.reduce(log_belief.reshape(*log_belief.shape[:-1], H // M, M), axis=-2)
