"""Novelty of taps: a p-value for each tap, and a sequential test over an episode.

The p-value of a tap under a class is the share of all calibration taps (`models.measurement.novelty`) that misfit
their own class as much, after the mean misfit of each class is taken off. It holds its level on average over classes
and training sets, and is what is shown. The test needs more, as it multiplies up what the same calibration taps say of
every tap.

An episode has a beginning and an object: L M hypotheses, each of which names a class for every tap, because the moves
really made are known. Each is a wealth of 1 that is bet against it. Given the calibration taps the
wealth against the true hypothesis is a supermartingale, whatever chooses the moves, if the bounds of the classes hold,
which they do with confidence `CONFIDENCE`; so it reaches 1 / alpha with probability alpha at most, however long the
episode is (Ville's inequality). The answer is "unknown" when the wealth against every hypothesis has. The belief, its
threshold and its border have no part in this.

The bets: n taps of a class calibrate, and j of them misfit it at least as much as a new tap. The usual p-value,
(1 + j)/(n + 1), is honest on average over calibration sets and not given one: where these n happen to fit well, every
episode sees too many small p-values. Given them the chance that a new tap misfits more than the r-th worst of them is
at most the r-th smallest of n uniform numbers, which has the Beta(r, n + 1 - r) distribution and so an exact upper
bound U_r (Vovk 2012, training-conditional validity). Bounds at r = 1, 2, 4, ... hold together by Bonferroni, those of
all classes by independence. A tap in the step from U_(i-1) to U_i then wins (U_i^a - U_(i-1)^a) / (U_i - U_(i-1)),
which has mean 1 if each bound is met and less otherwise, since it falls with i.
"""

from typing import NamedTuple, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betainccinv

from ..models.errors import InputError
from ..models.measurement.histogram import HistogramModel
from ..models.measurement.likelihood.bins import find_bins, tap_counts
from ..models.measurement.model import TapModel
from ..models.measurement.novelty import FEWEST, centres, misfits, own_excess, smoothed

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
    return betainccinv(r, n + 1 - r, error)


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


FLAGGED = 0.01
"""P-value below which a single tap is called unusual."""
EASY = 10
"""Number of taps after which an alarm should be possible."""


class Promise(NamedTuple):
    """Guarantee for the answer "unknown" from the calibration taps of a model.

    Attributes:
        alpha: False alarms at most, as a fraction of the episodes at each object.
        fewest: Calibration taps of the class that has fewest.
        soonest: Taps after which the answer can come at the earliest, `None` for never.
        needed: Calibration taps of each class with which it can come after `EASY` taps.
    """

    alpha: float
    fewest: int
    soonest: int | None
    needed: int

    @property
    def sentence(self) -> str:
        """The guarantee, and when the answer is possible."""
        return (
            f"With {CONFIDENCE:.0%} confidence over the training taps, at most a fraction {self.alpha:.3g} of episodes "
            f"at a trained object end in `unknown`, if taps are distributed like those; {self.power}."
        )

    @property
    def power(self) -> str:
        """When the answer is possible, and what would allow it earlier if that is late."""
        when = "impossible" if self.soonest is None else f"possible after {self.soonest} taps at the earliest"
        late = self.soonest is None or self.soonest > EASY
        more = f"; {self.needed} in each class would allow it after {EASY} taps" if late else ""
        return (
            f"the answer is {when}, as a class has only {self.fewest} calibration taps, half of its training taps{more}"
        )


class Novelty:
    """P-values of taps under the classes of a fitted model, and bets against the classes.

    Args:
        model: A histogram model without states, fitted with its novelty scores.

    Attributes:
        smallest: The least p-value that there is, 1 / (n + 1) with n calibration taps; that of untrained classes.
        log_refuted: What a tap outside the range of positions wins, shape (A,): the most that any tap of a class can.

    Raises:
        InputError: It has none, or is another model.
    """

    def __init__(self, model: TapModel) -> None:
        if not _is_plain(model):
            raise InputError(f"--unknown requires a fitted histogram model, got {model.name}.")
        if model.novelty is None:
            raise InputError("The model has no novelty scores, which --unknown requires; fit it again.")
        scores = model.novelty
        if len(scores.misfit) < FEWEST:
            raise InputError(
                f"The model has {len(scores.misfit)} novelty scores, but --unknown requires {FEWEST}; fit it to more "
                f"taps of each class."
            )
        K, B = model.counts.shape[2:]
        cells = model.grid.L * model.grid.M
        self._model, self._edges = model, scores.edges
        self._log_prob = np.log(smoothed(scores.reference, model.pseudocount)).reshape(cells, K * B)
        self._known = scores.reference.any(axis=(2, 3)).ravel()
        self._centre = centres(scores.misfit, scores.cell, cells).reshape(model.grid.shape)
        self._own = np.sort(own_excess(scores.misfit, scores.cell))
        self.smallest = 1 / (len(self._own) + 1)
        self._set_bets(scores.misfit, scores.cell)

    def _set_bets(self, misfit: NDArray[np.float64], cell: NDArray[np.intp]) -> None:
        """Sets the falling misfit thresholds of each class, and the gain of a tap above each."""
        self._n = np.bincount(cell, minlength=len(self._known))
        classes = int(np.sum(self._n > 0))
        bounds = {n: upper_bounds(n, classes) for n in np.unique(self._n).tolist()}
        most = max(map(len, bounds.values()))
        self._threshold = np.full((len(self._known), most), -np.inf)
        self._log_bet = np.zeros((len(EXPONENTS), len(self._known), most + 1))
        order = np.lexsort([-misfit, cell])
        for own in np.split(order, np.flatnonzero(np.diff(cell[order])) + 1):
            R = len(bounds[len(own)])
            self._threshold[cell[own[0]], :R] = misfit[own[2 ** np.arange(R) - 1]]
            self._log_bet[:, cell[own[0]], : R + 1] = log_bets(bounds[len(own)])
        self.log_refuted = self._log_bet[:, :, 0].max(axis=1)

    @property
    def trained(self) -> NDArray[np.bool_]:
        """Mask of the classes with training taps, shape (L, M)."""
        return self._model.trained

    def misfit(self, taps: ArrayLike) -> NDArray[np.float64]:
        """Misfit of taps to each class, infinite for untrained ones; 0 where samples are missing, which shows nothing.

        Args:
            taps: Prepared samples, shape (..., J, K).

        Returns:
            Shape (..., L, M).

        Raises:
            InputError: The taps have not the size of the training taps, or a sample is NaN or infinite.
        """
        taps = np.asarray(taps)
        self._model.check_samples(taps)
        bins = find_bins(taps.reshape(-1, *taps.shape[-2:]), self._edges)
        share = np.concatenate(list(tap_counts(bins, self._model.counts.shape[3]))) / taps.shape[-2]
        whole = (bins >= 0).all(axis=(1, 2))
        found = np.where(whole[:, np.newaxis], misfits(share, self._log_prob), 0.0)
        value = np.where(self._known, found, np.inf)
        return value.reshape(*taps.shape[:-2], *self._model.grid.shape)

    def p_values(self, misfit: NDArray[np.float64]) -> NDArray[np.float64]:
        """P-values of taps under each class from their misfits, both of shape (..., L, M)."""
        excess = np.sqrt(misfit) - self._centre
        n = len(self._own)
        return (1 + n - np.searchsorted(self._own, excess, side="left")) / (n + 1)

    def log_bets(self, misfit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log gain of taps against each class, shape (A, ..., L, M), from their misfits (..., L, M).

        Classes without a calibration tap win nothing, as nothing is known of their misfits.
        """
        cells = misfit.reshape(-1, len(self._threshold), 1)
        step = np.sum(cells <= self._threshold, axis=-1)
        won = self._log_bet[:, np.arange(len(self._threshold)), step]
        return won.reshape(len(won), *misfit.shape)

    def promise(self, alpha: float) -> Promise:
        """Guarantee at a rate of false alarms."""
        calibrated = self._n[self._model.trained.ravel()]
        weakest = self._log_bet[:, self._model.trained.ravel(), 0].min(axis=1)
        needed = calibration_needed(EASY, int(np.sum(self._n > 0)), alpha)
        return Promise(alpha, int(calibrated.min()), soonest(weakest, alpha), needed)


class UnknownTest:
    """Sequential test whether the taps of an episode differ from the training taps.

    Args:
        novelty: P-values and bets of single taps.
        alpha: False alarms allowed, as a fraction of episodes; `None` calls nothing unknown.

    Attributes:
        p: The p-value of the last tap, the largest under any hypothesis that has not been rejected at `FLAGGED`.
        log_wealth: Logarithm of the wealth bet against each beginning and object, shape (L, M); infinite for untrained
            ones, which are no hypotheses.

    Raises:
        InputError: Alpha does not lie between 0 and 1.
    """

    def __init__(self, novelty: Novelty, alpha: float | None = None) -> None:
        if alpha is not None and not 0 < alpha < 1:
            raise InputError(f"The rate of false alarms must be between 0 and 1, got {alpha}.")
        self._novelty, self._alpha = novelty, alpha
        self._place = np.arange(len(novelty.trained))
        self._each = np.zeros((len(EXPONENTS), *novelty.trained.shape))
        self._each[:, ~novelty.trained] = np.inf
        self.log_wealth = log_mixture(self._each)
        self.p = 1.0

    @property
    def unknown(self) -> bool:
        """Whether the taps so far reject all hypotheses."""
        return self._alpha is not None and bool(self.log_wealth.min() >= -np.log(self._alpha))

    @property
    def doubtful(self) -> bool:
        """Whether the bets are winning against every hypothesis, so a decision should wait for more taps."""
        return self._alpha is not None and bool(self.log_wealth.min() > 0)

    def add(self, tap: ArrayLike, arrived: int) -> bool:
        """Adds a tap.

        Args:
            tap: Prepared samples, shape (J, K).
            arrived: Where classes that the sensor really moved before it.

        Returns:
            `doubtful` after it.

        Raises:
            InputError: The tap has not the size of the training taps, or a sample is NaN or infinite.
        """
        return self.follow(self._novelty.misfit(tap), arrived)

    def follow(self, misfit: NDArray[np.float64], arrived: int) -> bool:
        """Adds a tap given by its misfits, shape (L, M)."""
        self._place += arrived
        inside = (self._place >= 0) & (self._place < len(self._place))
        place = self._place[inside]
        held = self.log_wealth <= max(-np.log(FLAGGED), self.log_wealth.min())
        p = np.full(misfit.shape, self._novelty.smallest)
        p[inside] = self._novelty.p_values(misfit)[place]
        self.p = float(p[held].max())
        self._each[:, inside] += self._novelty.log_bets(misfit)[:, place]
        self._each[:, ~inside] += self._novelty.log_refuted[:, np.newaxis, np.newaxis]
        self.log_wealth = log_mixture(self._each)
        return self.doubtful


def can_tell(model: TapModel) -> bool:
    """Whether a model has enough novelty scores for p-values."""
    return _is_plain(model) and model.novelty is not None and len(model.novelty.misfit) >= FEWEST


def _is_plain(model: TapModel) -> TypeGuard[HistogramModel]:
    """Whether it is a histogram model without states."""
    return isinstance(model, HistogramModel) and len(model.states.gain) == 1
