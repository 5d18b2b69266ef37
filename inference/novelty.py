"""Whether a tap is unlike anything the model was trained on: a p-value for each tap, and a test over an episode.

Each class says how much its own training taps misfit it (`models.novelty`), so the root of the misfit, which is like
a distance, is measured from the mean of the class. A tap is as new as it is to the class it fits best, among those that
the belief before the tap still holds possible: a tap without contact is nothing new at the end of the range, and very
new at its centre.

The p-value is conformal: the share of training taps that misfit as much, the class that they fit best as long as
nothing is known, and their own class later. It is honest, P(p <= a) <= a, for taps that could be exchanged with the
training taps and whose class is still held possible; the more classes are held possible later, the more cautious.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.errors import InputError
from ..models.histogram import HistogramModel
from ..models.novelty import FEWEST, centres, excess, own_excess, smoothed

FLAGGED = 0.01
"""A p-value below which a single tap is called unusual."""
_POSSIBLE = 0.999  # mass of the classes held possible


class Novelty:
    """P-values of taps under a fitted model.

    Args:
        model: Must have been fitted with its novelty scores.

    Raises:
        InputError: It has none.
    """

    def __init__(self, model: HistogramModel) -> None:
        if model.novelty is None:
            raise InputError("The model has no novelty scores to tell new things by; fit it again with this version.")
        if len(model.novelty.misfit) < FEWEST:
            raise InputError(
                f"The model has {len(model.novelty.misfit)} novelty scores and {FEWEST} are needed to tell new things "
                f"by; fit it to more taps of each class."
            )
        cells = model.counts.shape[0] * model.counts.shape[1]
        self._model = model
        self._trained = np.flatnonzero(model.trained)
        self._centre = centres(model.novelty.misfit, model.novelty.cell, cells)
        self._own = np.sort(own_excess(model.novelty.misfit, model.novelty.cell))
        self._best = np.sort(model.novelty.best)
        self._log_prob = np.log(smoothed(model.counts, model.pseudocount)).reshape(cells, -1)

    def p_value(self, log_belief: NDArray[np.float64], tap: ArrayLike) -> float:
        """How usual a tap is, between 1 / (n + 1) and 1; small for new things.

        Args:
            log_belief: Before the tap, shape (L, M).
            tap: Prepared samples, shape (J, K).

        Raises:
            InputError: The tap has not the size of the training taps, or a sample is NaN.
        """
        held = possible(log_belief)
        ignorant = len(held) >= _POSSIBLE * len(self._trained)
        usual = self._best if ignorant else self._own
        score = self.excess(tap)[self._trained if ignorant else held].min()
        n = len(usual)
        return float(1 + n - np.searchsorted(usual, score, side="left")) / (n + 1)

    def excess(self, tap: ArrayLike) -> NDArray[np.float64]:
        """The root misfit of a tap to each class, less that of the class's training taps on average, shape (L M,).

        Raises:
            InputError: As `p_value`.
        """
        bins = self._model.bins(tap)
        K, B = self._model.counts.shape[2:]
        share = np.bincount((np.arange(K) * B + bins).ravel(), minlength=K * B) / len(bins)
        return excess(share[np.newaxis], self._log_prob, self._centre)[0]


class UnknownTest:
    """Whether all taps of an episode together are unlike the training taps.

    A p-value becomes the e-value 1 / (2 sqrt(p)), a bet that wins on small ones; e-values multiply. For honest
    p-values of independent taps the product exceeds 1 / alpha in at most a fraction alpha of all episodes, however
    long they are (Ville's inequality).

    Args:
        alpha: False alarms allowed, as a fraction of episodes.

    Raises:
        InputError: It does not lie between 0 and 1.
    """

    def __init__(self, alpha: float) -> None:
        if not 0 < alpha < 1:
            raise InputError(f"The rate of false alarms must lie between 0 and 1, got {alpha}.")
        self._limit = -np.log(alpha)
        self.log_wealth = 0.0

    def add(self, p: float) -> bool:
        """Whether the taps so far, this one included, are unlike the training taps."""
        self.log_wealth += -np.log(2) - 0.5 * np.log(p)
        return bool(self.log_wealth >= self._limit)


def can_tell(model: HistogramModel) -> bool:
    """Whether a model was fitted with enough novelty scores for p-values."""
    return model.novelty is not None and len(model.novelty.misfit) >= FEWEST


def possible(log_belief: NDArray[np.float64]) -> NDArray[np.intp]:
    """The most probable classes that together hold 99.9 % of the belief, as l M + m."""
    log_belief = log_belief.ravel()
    order = np.argsort(-log_belief, kind="stable")
    mass = np.exp(log_belief[order]).cumsum()
    kept = order[: np.searchsorted(mass, _POSSIBLE * mass[-1]) + 1]
    return kept[log_belief[kept] > -np.inf]
