"""Whether taps are unlike anything the model was trained on: a p-value for each tap, and a test over an episode.

Each class says how much its own training taps misfit it (`models.novelty`), so the root of the misfit, which is like
a distance, is measured from the mean of the class. The p-value of a tap under a class is conformal: the share of all
training taps that misfit their own class as much. It is honest, P(p <= a) <= a, for taps that could be exchanged with
the training taps.

An episode is told by where it began and at which object: L M hypotheses, each of which names a class for every tap,
because the moves that were really made are known. P-values become stakes in bets against each hypothesis that win on
small ones and multiply up. Something is new when every hypothesis has lost. The true one, if there is one, loses with
probability alpha at most, however long the episode is and whenever it is ended (Ville's inequality), if its p-values
are honest given those before. So nothing depends on the belief, its threshold or its border, and a finger that feels
nothing before and after a move of 7 mm is not believed to have been at the far end all the time.
"""

from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.errors import InputError
from ..models.histogram import HistogramModel
from ..models.model import TapModel
from ..models.novelty import FEWEST, centres, excess, own_excess, smoothed

FLAGGED = 0.01
"""A p-value below which a single tap is called unusual."""
_EXPONENTS = (np.arange(10) + 0.5) / 10  # small ones bet on few tiny p-values, large ones on many rather small
_DOUBT = 2.0  # wealth above which a decision waits


class Novelty:
    """P-values of taps under the classes of a fitted model.

    Args:
        model: A histogram model without states, fitted with its novelty scores.

    Attributes:
        smallest: The least p-value that there is, 1 / (n + 1) with n training taps; that of untrained classes.

    Raises:
        InputError: It has none, or is another model.
    """

    def __init__(self, model: TapModel) -> None:
        if not _is_plain(model):
            raise InputError(
                f"--unknown needs a fitted histogram model to tell new things by, and this one is {model.name}."
            )
        if model.novelty is None:
            raise InputError("The model has no novelty scores to tell new things by; fit it again with this version.")
        if len(model.novelty.misfit) < FEWEST:
            raise InputError(
                f"The model has {len(model.novelty.misfit)} novelty scores and {FEWEST} are needed to tell new things "
                f"by; fit it to more taps of each class."
            )
        cells = model.counts.shape[0] * model.counts.shape[1]
        self._model = model
        self._centre = centres(model.novelty.misfit, model.novelty.cell, cells)
        self._own = np.sort(own_excess(model.novelty.misfit, model.novelty.cell))
        self._best = np.sort(model.novelty.best)
        self._log_prob = np.log(smoothed(model.counts, model.pseudocount)).reshape(cells, -1)
        self.smallest = 1 / (len(self._own) + 1)

    @property
    def shape(self) -> tuple[int, int]:
        """Where and what classes, (L, M)."""
        return self._model.grid.shape

    def excess(self, tap: ArrayLike) -> NDArray[np.float64]:
        """The root misfit of a tap to each class above the mean of the class, infinite for untrained ones.

        Args:
            tap: Prepared samples, shape (J, K).

        Returns:
            Shape (L, M).

        Raises:
            InputError: The tap has not the size of the training taps, or a sample is NaN.
        """
        bins = self._model.bins(tap)
        K, B = self._model.counts.shape[2:]
        share = np.bincount((np.arange(K) * B + bins).ravel(), minlength=K * B) / len(bins)
        value = excess(share[np.newaxis], self._log_prob, self._centre)[0].reshape(self.shape)
        return np.where(self._model.trained, value, np.inf)

    def of_class(self, excess: NDArray[np.float64]) -> NDArray[np.float64]:
        """P-values of a tap that belongs to a class, from its excess over the class; the same shape."""
        return _p_value(excess, self._own)

    def of_any(self, excess: NDArray[np.float64]) -> float:
        """P-value of a tap of which nothing is known, from its excess over all classes, shape (L, M).

        The class that it fits best is compared with those that training taps fit best, their own or not.
        """
        return float(_p_value(excess.min(), self._best))


class UnknownTest:
    """Whether the taps of an episode, all together, are unlike the training taps.

    Args:
        novelty: P-values of single taps.
        alpha: False alarms allowed, as a fraction of episodes; `None` calls nothing unknown.

    Attributes:
        p: The p-value of the last tap, the largest under any hypothesis that has not been rejected at `FLAGGED`.

    Raises:
        InputError: Alpha does not lie between 0 and 1.
    """

    def __init__(self, novelty: Novelty, alpha: float | None = None) -> None:
        if alpha is not None and not 0 < alpha < 1:
            raise InputError(f"The rate of false alarms must lie between 0 and 1, got {alpha}.")
        self._novelty = novelty
        self._limit = np.inf if alpha is None else -np.log(alpha)
        self._doubt = np.inf if alpha is None else np.log(_DOUBT)
        self._place = np.arange(novelty.shape[0])
        self._surprise = np.zeros(novelty.shape)
        self._taps = 0
        self.p = 1.0

    @property
    def log_wealth(self) -> NDArray[np.float64]:
        """Logarithm of what the bets won against each where and what class to begin with, shape (L, M)."""
        return log_wealth(self._surprise, self._taps)

    @property
    def unknown(self) -> bool:
        """Whether the taps so far are unlike the training taps."""
        return bool(self.log_wealth.min() >= self._limit)

    @property
    def doubtful(self) -> bool:
        """Whether the bets are winning against every hypothesis, so that a decision had better wait for more taps."""
        return bool(self.log_wealth.min() > self._doubt)

    def add(self, tap: ArrayLike, arrived: int) -> bool:
        """One more tap.

        Args:
            tap: Prepared samples, shape (J, K).
            arrived: Where classes that the sensor really moved before it.

        Returns:
            `doubtful` after it.

        Raises:
            InputError: The tap has not the size of the training taps, or a sample is NaN.
        """
        excess = self._novelty.excess(tap)
        self._place += arrived
        inside = (self._place >= 0) & (self._place < len(self._place))
        p = np.full(excess.shape, self._novelty.smallest)
        p[inside] = self._novelty.of_class(excess[self._place[inside]])
        won = self.log_wealth
        held = won <= max(-np.log(FLAGGED), won.min())
        self.p = float(p[held].max()) if self._taps else self._novelty.of_any(excess)
        self._surprise -= np.log(p)
        self._taps += 1
        return self.doubtful


def log_wealth(surprise: NDArray[np.float64], taps: int) -> NDArray[np.float64]:
    """Logarithm of the mean over a of prod_t a p_t^(a - 1): a starting wealth of 1, put on several bets and left there.

    Each factor has mean 1 for p uniform from 0 to 1, at most 1 for honest p-values (Vovk's simple mixture martingale).

    Args:
        surprise: Sums of -log p_t, any shape.
        taps: Their number.

    Returns:
        The shape of `surprise`.
    """
    bets = taps * np.log(_EXPONENTS) + (1 - _EXPONENTS) * surprise[..., np.newaxis]
    return np.logaddexp.reduce(bets, axis=-1) - np.log(len(_EXPONENTS))


def can_tell(model: TapModel) -> bool:
    """Whether a model was fitted with enough novelty scores for p-values."""
    return _is_plain(model) and model.novelty is not None and len(model.novelty.misfit) >= FEWEST


def _is_plain(model: TapModel) -> TypeGuard[HistogramModel]:
    """Whether it is a histogram without states."""
    return isinstance(model, HistogramModel) and len(model.states.gain) == 1


def _p_value(score: ArrayLike, usual: NDArray[np.float64]) -> NDArray[np.float64]:
    """The share of the usual scores, and the score itself, that are at least as high; `usual` is sorted."""
    n = len(usual)
    return (1 + n - np.searchsorted(usual, score, side="left")) / (n + 1)
