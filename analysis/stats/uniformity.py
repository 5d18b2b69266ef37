"""Exact tests of the calibration of beliefs of many independent episodes.

If beliefs are exact, the truth is a draw from them. Then two things hold for any belief, however it came about:

- **Ranks.** The belief in all classes before the true one, plus a random share of that in the true one, is uniform
  between 0 and 1, in any order of the classes that does not know the truth. Two orders are used: that of the grid
  (`rank`), and the most probable class first (`credible set`: a set of probability q holds the truth with probability
  q). Both are judged by the exact distribution of Kolmogorov's statistic.
- **Decisions.** Given all taps, the errors of decisions are independent, each with probability 1 - belief, so their
  number has the Poisson-binomial distribution. It is judged over all trials (`decisions`), and in bins of belief
  (`decisions by belief`), where the least of the p-values counts as many times as there are bins.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

BINS = 5
PRECISION = 1e-12
"""Smaller p-values are rounding."""


class JudgedBeliefs(NamedTuple):
    """Ranks and beliefs of the truth in n beliefs over C classes.

    Attributes:
        rank: Belief in the classes before the true one, in the order of the grid, plus a random share of that in the
            true one, shape (n,); empty where only decisions are known.
        credible: The same with the most probable class first.
        belief: Belief in the most probable class, shape (n,).
        right: Whether that is the true one, shape (n,).
    """

    rank: NDArray[np.float64]
    credible: NDArray[np.float64]
    belief: NDArray[np.float64]
    right: NDArray[np.bool_]

    @property
    def doubt(self) -> NDArray[np.float64]:
        """Probability that each decision is wrong, shape (n,)."""
        return np.clip(1 - self.belief, 0.0, 1.0)


class Factor(NamedTuple):
    """Wrong decisions over the number expected from the beliefs, with a 95% interval; 1 if calibrated."""

    value: float
    low: float
    high: float


def judge(belief: NDArray[np.float64], true: NDArray[np.intp], generator: np.random.Generator) -> JudgedBeliefs:
    """Where the truth stands in beliefs, and what they decide.

    Args:
        belief: Shape (n, C).
        true: The true classes, shape (n,).
        generator: Of the shares of the belief in the true class.
    """
    n, C = belief.shape
    own = belief[np.arange(n), true]
    earlier = np.arange(C) < true[:, np.newaxis]
    above = (belief > own[:, np.newaxis]) | (earlier & (belief == own[:, np.newaxis]))
    share = generator.random((2, n)) * own
    return JudgedBeliefs(
        rank=np.clip((belief * earlier).sum(axis=1) + share[0], 0.0, 1.0),
        credible=np.clip((belief * above).sum(axis=1) + share[1], 0.0, 1.0),
        belief=belief.max(axis=1),
        right=belief.argmax(axis=1) == true,
    )


def p_values(judged: JudgedBeliefs) -> dict[str, float]:
    """The p-value of every test that can be made, by its name."""
    from scipy.stats import kstest  # noqa: PLC0415 - SciPy takes long to import

    found = {}
    if len(judged.rank):
        found["rank"] = float(kstest(judged.rank, "uniform").pvalue)
        found["credible set"] = float(kstest(judged.credible, "uniform").pvalue)
    parts = equal_doubt(judged.doubt, BINS)
    masses = [poisson_binomial(judged.doubt[part]) for part in parts]
    counts = [int((~judged.right[part]).sum()) for part in parts]
    least = min(count_p(count, mass) for count, mass in zip(counts, masses, strict=True))
    found["decisions"] = count_p(sum(counts), poisson_binomial(judged.doubt))
    found["decisions by belief"] = min(1.0, len(parts) * least)
    return found


def count_p(count: int, mass: NDArray[np.float64]) -> float:
    """Two-sided p-value of a count of which `mass` is the distribution."""
    return float(np.clip(2 * min(mass[: count + 1].sum(), mass[count:].sum()), 0.0, 1.0))


def poisson_binomial(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probability of 0 to n events of which each has its own probability (n,), to about 1e-15; shape (n + 1,)."""
    from scipy.fft import next_fast_len  # noqa: PLC0415 - SciPy takes long to import

    mass = np.stack([1 - p, p], axis=1)
    while len(mass) > 1:
        if len(mass) % 2:
            mass = np.concatenate([mass, np.eye(1, mass.shape[1])])
        size = 2 * mass.shape[1] - 1
        fast = next_fast_len(size, real=True)
        spectrum = np.fft.rfft(mass, fast, axis=1)
        mass = np.fft.irfft(spectrum[::2] * spectrum[1::2], fast, axis=1)[:, :size]
    return np.clip(mass[0, : len(p) + 1], 0.0, 1.0)


def equal_doubt(doubt: NDArray[np.float64], bins: int) -> list[NDArray[np.intp]]:
    """Trials in groups of like belief, in which about equally many errors are expected."""
    order = np.argsort(doubt, kind="stable")
    expected = doubt[order].cumsum()
    ends = np.searchsorted(expected, expected[-1] * np.arange(1, bins) / bins)
    return [part for part in np.split(order, ends) if len(part)]


def error_factor(judged: JudgedBeliefs) -> Factor:
    """Errors over those announced; the interval is Wilson's for the share of errors, with the beliefs as they are."""
    from scipy.stats import binomtest  # noqa: PLC0415 - SciPy takes long to import

    n, wrong, expected = len(judged.right), int((~judged.right).sum()), float(judged.doubt.sum())
    if expected == 0:
        return Factor(*(np.inf if wrong else np.nan,) * 3)
    interval = binomtest(wrong, n).proportion_ci(method="wilson")
    return Factor(wrong / expected, interval.low * n / expected, interval.high * n / expected)


def rejected(p: Sequence[float], level: float) -> NDArray[np.bool_]:
    """Which of several p-values are too small, in Holm's way: one true null is rejected with probability `level`."""
    values = np.asarray(p, dtype=np.float64)
    order = np.argsort(values, kind="stable")
    small = values[order] <= level / np.arange(len(values), 0, -1)
    found = np.zeros(len(values), dtype=bool)
    found[order[np.logical_and.accumulate(small)]] = True
    return found
