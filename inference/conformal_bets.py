"""Bets against a class, with expected gain at most 1 given the calibration taps, at a stated confidence.

n taps of a class calibrate, and j of them misfit it at least as much as a new tap. The usual p-value, (1 + j)/(n + 1),
is honest on average over calibration sets and not given one: where these n happen to fit well, every episode sees too
many small p-values. Given them the chance that a new tap misfits more than the r-th worst of them is at most the r-th
smallest of n uniform numbers, which has the Beta(r, n + 1 - r) distribution and so an exact upper bound U_r (Vovk 2012,
training-conditional validity). Bounds at r = 1, 2, 4, ... hold together by Bonferroni, those of all classes by
independence. A tap in the step from U_(i-1) to U_i then wins (U_i^a - U_(i-1)^a) / (U_i - U_(i-1)), which has mean 1
if each bound is met and less otherwise, since it falls with i.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

CONFIDENCE = 0.95
"""Confidence with which the bounds of all classes hold together, over the draw of the calibration taps."""
EXPONENTS = (np.arange(10) + 0.5) / 10
"""Exponents of the bets; small ones suit few very unusual taps, large ones many slightly unusual taps."""


def ranks(n: int) -> NDArray[np.intp]:
    """Ranks with a bound: 1, 2, 4, ... up to half of n calibration taps, and at least 1 if there is a tap."""
    return 2 ** np.arange(int(np.log2(max(n // 2, 1))) + 1) if n else np.empty(0, dtype=np.intp)


def upper_bounds(n: int, classes: int, confidence: float = CONFIDENCE) -> NDArray[np.float64]:
    """Increasing bounds U_r at the `ranks` of n calibration taps; all classes hold together at the confidence."""
    r = ranks(n)
    error = (1 - confidence ** (1 / classes)) / max(len(r), 1)
    return beta.isf(error, r, n + 1 - r)


def log_bets(bounds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log gain of a tap in each step of its bounds.

    Args:
        bounds: U_r, increasing, shape (R,).

    Returns:
        For each exponent and step, the most unusual taps first, shape (A, R + 1); decreasing.
    """
    ends = np.concatenate([[0.0], bounds, [1.0]])
    return np.log(np.diff(ends ** EXPONENTS[:, np.newaxis], axis=1) / np.diff(ends))


def log_mixture(log_wealth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log of the mean wealth over the exponents, the first axis."""
    return np.logaddexp.reduce(log_wealth, axis=0) - np.log(len(EXPONENTS))


def soonest(log_bet: NDArray[np.float64], alpha: float, most: int = 1000) -> int | None:
    """Fewest taps after which bets that always win reach 1 / alpha; `None` if more than `most`.

    Args:
        log_bet: What the most unusual tap wins, shape (A,).
        alpha: False alarms allowed.
        most: Taps looked at.
    """
    wealth = log_mixture(np.outer(log_bet, np.arange(1, most + 1)))
    won = np.flatnonzero(wealth >= -np.log(alpha))
    return int(won[0]) + 1 if len(won) else None


def calibration_needed(taps: int, classes: int, alpha: float) -> int:
    """Fewest calibration taps per class for which an alarm is possible within a number of taps."""
    n = 1
    while soonest(log_bets(upper_bounds(n, classes))[:, 0], alpha, taps) is None:
        n += 1
    return n
