"""A quick histogram fit to half of a recording: accuracy of single taps, and taps to a decision.

The default histograms in plain NumPy, so that inspecting loads no compiled code. The numbers are rough; studies have
the exact ones.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...models import seeds
from ...models.grid import ClassGrid
from ...models.settings import FitSettings, PlaySettings
from ...models.splits import rank_in_class
from ...models.taps import TapSet
from ..stats.detection import detectable_factor_of, half_width, wrong_decisions_for

MOST_SAMPLES = 1 << 24  # samples of all taps and taxels; reading more takes longer than a few seconds
MOST_TAPS = 100  # of a trial
_TRIALS = 400
_WORK = 4e9  # multiplications for the test taps
_BLOCK = 1 << 22  # counts held at a time
_ALL_BUT = 0.1  # share of the decisions that may take more than `QuickFit.most`


class Told(NamedTuple):
    """Accuracy of single test taps.

    Attributes:
        accuracy: Share of the test taps of which the object, or with a single one the position, is inferred.
        chance: The same by always naming the most frequent class.
        taps: Number of test taps.
    """

    accuracy: float
    chance: float
    taps: int

    @property
    def low(self) -> float:
        """Lower end of about a 95% interval, taps taken as independent."""
        return self.accuracy - half_width(self.taps, self.accuracy)


class RightDecisions(NamedTuple):
    """Decisions of a correct model.

    Attributes:
        taps: Mean taps to a decision.
        doubt: Mean of 1 - belief in the decision, which is how often it is wrong.
    """

    taps: float
    doubt: float

    def wrong(self, taps: int) -> float:
        """Independent wrong decisions that so many taps, of all classes together, give."""
        return taps / self.taps * self.doubt

    def factor(self, taps: int) -> float:
        """The smallest miscalibration factor that so many taps show, see `detectable_factor_of`."""
        return detectable_factor_of(self.wrong(taps))

    def taps_for(self, factor: float) -> float:
        """Taps that show such a factor, infinite where decisions are never wrong."""
        return wrong_decisions_for(factor) * self.taps / self.doubt if self.doubt > 0 else np.inf


class QuickFit(NamedTuple):
    """What a quick fit infers; the last session tests, or of a single session every second tap of each class.

    Attributes:
        whole: From whole taps.
        first: From the samples before contact, or the first sample where none is known to be; `None` without one.
        offset: From the offsets that were subtracted when recording; `None` without them.
        most: Taps within which nine in ten trials without moves decide; `MOST_TAPS` + 1 where they do not.
        right: Decisions on taps drawn from the fit, of which its beliefs are right; after as many taps at the latest
            as are judged of each class.
        right_to_the_end: The same up to `MOST_TAPS`.
    """

    whole: Told
    first: Told | None
    offset: Told | None
    most: int
    right: RightDecisions
    right_to_the_end: RightDecisions

    @property
    def share(self) -> float:
        """Share of the accuracy above chance that `first` has at the lower end of its interval, at least 0."""
        above = self.whole.accuracy - self.whole.chance
        return max(0.0, self.first.low - self.whole.chance) / above if self.first is not None and above > 0 else 0.0


def too_large(taps: TapSet) -> bool:
    """Whether a quick fit would not be quick, or the recording is not held in memory."""
    return taps.scanned is not None or taps.samples.size > MOST_SAMPLES


def quick_fit(taps: TapSet, grid: ClassGrid, before: int = 0, judged: int = MOST_TAPS) -> QuickFit | None:
    """Fits histograms and plays trials without moves.

    Args:
        taps: What was recorded.
        grid: The classes.
        before: Samples known to be before contact; 0 where none is, so that the first one stands for them.
        judged: Taps of each class on which beliefs are judged.

    Returns:
        `None` where the recording is too large, or no class has taps to train and to test with, or no sample is known.
    """
    if too_large(taps):
        return None
    where, what = taps.indices(grid)
    cell = np.where(np.minimum(where, what) >= 0, where * grid.M + what, -1)
    train, test = _parts(taps, grid, cell)
    trained = np.unique(cell[train])
    test = test[np.isin(cell[test], trained)]
    if not len(test) or len(trained) < 2 or np.isnan(taps.extremes[train]).all():
        return None
    test = _fewer(test, cell, int(_WORK / (len(trained) * taps.samples.shape[2] * FitSettings().bins)))
    of_class = _Named(cell, trained, grid)

    def told(samples: NDArray[Any]) -> Told:
        return of_class.told(of_class.fit(samples, train).log_likelihood(samples[test]), test)

    samples, n, offset = np.asarray(taps.samples), before or 1, taps.dataset.get("offset")
    fitted = of_class.fit(samples, train)
    evidence = fitted.log_likelihood(samples[test])
    played = _of_test_taps(evidence, cell[test], of_class)

    def right(most: int) -> RightDecisions:
        ended = _of_the_fit(fitted.table, most, of_class)
        return RightDecisions(float(np.minimum(ended.taps, most).mean()), float(ended.doubt.mean()))

    return QuickFit(
        whole=of_class.told(evidence, test),
        first=told(samples[:, :n]) if n < samples.shape[1] else None,
        offset=told(offset.values[:, np.newaxis]) if offset is not None and offset.dims == ("tap", "taxel") else None,
        most=int(np.quantile(played.taps, 1 - _ALL_BUT, method="higher")),
        right=right(judged),
        right_to_the_end=right(MOST_TAPS),
    )


class _Named(NamedTuple):
    """The classes as the fit names them: cell of each tap, the trained cells, and the grid."""

    cell: NDArray[np.intp]
    trained: NDArray[np.intp]
    grid: ClassGrid

    def answers(self, cell: NDArray[np.intp]) -> NDArray[np.intp]:
        """What is to be inferred of each cell: its object, or with a single one its position."""
        return cell % self.grid.M if self.grid.M > 1 else cell // self.grid.M

    def belief(self, log: NDArray[np.float64]) -> NDArray[np.float64]:
        """Belief in each answer from logs of the belief in trained cells, shapes (n, answers) and (n, cells)."""
        belief = np.exp(log - log.max(axis=1, keepdims=True))
        answer = self.answers(self.trained)
        folded = belief @ (answer[:, np.newaxis] == np.unique(answer)).astype(np.float64)
        return folded / folded.sum(axis=1, keepdims=True)

    def right(self, cell: NDArray[np.intp]) -> NDArray[np.intp]:
        """Column of `belief` that is the true answer of each cell."""
        return np.searchsorted(np.unique(self.answers(self.trained)), self.answers(cell))

    def fit(self, samples: NDArray[Any], train: NDArray[np.intp]) -> "_Histograms":
        """Histograms of the trained cells."""
        return _Histograms.fit(samples, train, np.searchsorted(self.trained, self.cell[train]))

    def told(self, evidence: NDArray[np.float64], test: NDArray[np.intp]) -> Told:
        """Accuracy of single test taps with these log-likelihoods, shape (n, cells)."""
        right = self.right(self.cell[test])
        hits = self.belief(evidence).argmax(axis=1) == right
        return Told(float(hits.mean()), float(np.bincount(right).max() / len(right)), len(test))


def _parts(taps: TapSet, grid: ClassGrid, cell: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Numbers of training and test taps."""
    sessions = np.unique(taps.session)
    odd = len(sessions) == 1
    tests = rank_in_class(taps, grid)[0] % 2 == 1 if odd else taps.session == sessions[-1]
    return np.flatnonzero((cell >= 0) & ~tests), np.flatnonzero((cell >= 0) & tests)


def _fewer(test: NDArray[np.intp], cell: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """All taps of classes spread over the grid, about `most` together."""
    classes = np.unique(cell[test])
    step = -(-len(test) // max(most, 1))
    return test[np.isin(cell[test], classes[::step])]


class _Histograms(NamedTuple):
    """The default histograms of some samples: log probabilities, shape (cells, K, B), and where their bins are."""

    table: NDArray[np.float64]
    low: float
    scale: float

    @classmethod
    def fit(cls, samples: NDArray[Any], train: NDArray[np.intp], own: NDArray[np.intp]) -> Self:
        """Of the taps `train`, whose classes are `own`."""
        chosen, settings = samples[train], FitSettings()
        low, high = np.nan_to_num([np.fmin.reduce(chosen, axis=None), np.fmax.reduce(chosen, axis=None)]).tolist()
        empty = np.zeros((int(own.max()) + 1, samples.shape[2], settings.bins))
        bins = cls(empty, low, settings.bins / (high - low) if high > low else 0.0)
        for part in bins.blocks(len(train), samples.shape[1]):
            empty += bins.counts(samples[train[part]], own[part])
        counts = empty + settings.pseudocount
        return bins._replace(table=np.log(counts / counts.sum(axis=2, keepdims=True)))

    def blocks(self, taps: int, J: int) -> Iterator[slice]:
        """Parts of so many taps of J samples that fit into memory."""
        _, K, B = self.table.shape
        step = max(1, _BLOCK // (K * max(B, J)))
        return (slice(begin, begin + step) for begin in range(0, taps, step))

    def counts(self, samples: NDArray[Any], row: NDArray[np.intp] | None = None) -> NDArray[np.intp]:
        """How many samples fall into each bin, shape (rows, K, B), by the rows of the taps or of each tap."""
        _, K, B = self.table.shape
        rows, row = (len(samples), np.arange(len(samples))) if row is None else (len(self.table), row)
        known = ~np.isnan(samples)
        binned = np.clip((np.where(known, samples, self.low) - self.low) * self.scale, 0, B - 1).astype(np.intp)
        flat = (row[:, np.newaxis, np.newaxis] * K + np.arange(K)) * B + binned
        return np.bincount(flat[known], minlength=rows * K * B).reshape(rows, K, B)

    def log_likelihood(self, samples: NDArray[Any]) -> NDArray[np.float64]:
        """Eq. 1 at power J, shape (n, cells)."""
        table = self.table.reshape(len(self.table), -1).T.astype(np.float32)
        parts = []
        for part in self.blocks(len(samples), samples.shape[1]):
            counts = self.counts(samples[part])
            parts.append(counts.reshape(len(counts), -1).astype(np.float32) @ table)
        return np.concatenate(parts).astype(np.float64) / samples.shape[1]


class _Trials(NamedTuple):
    """Trials without moves: number of taps, or `most` + 1 of those that end undecided, and 1 - belief at the end."""

    taps: NDArray[np.intp]
    doubt: NDArray[np.float64]


def _play(tap: Callable[[int, NDArray[np.intp]], NDArray[np.float64]], most: int, of_class: _Named) -> _Trials:
    """Plays trials of `most` taps at most.

    Args:
        tap: Log-likelihoods of tap number n from 0 on of the trials with these numbers, shape (trials, cells).
        most: Taps.
        of_class: The classes.
    """
    log = np.zeros((_TRIALS, len(of_class.trained)))
    taken, doubt, left = np.full(_TRIALS, most + 1), np.ones(_TRIALS), np.arange(_TRIALS)
    for n in range(most):
        log[left] += tap(n, left)
        doubt[left] = 1 - of_class.belief(log[left]).max(axis=1)
        sure = doubt[left] <= 1 - PlaySettings().threshold
        taken[left[sure]], left = n + 1, left[~sure]
        if not len(left):
            break
    return _Trials(taken, doubt)


def _of_test_taps(evidence: NDArray[np.float64], cell: NDArray[np.intp], of_class: _Named) -> _Trials:
    """Trials on test taps, distinct ones as long as a class has them."""
    generator = seeds.generator(0, seeds.Purpose.QUICK_FIT, 0)
    order = np.argsort(cell, kind="stable")
    classes, first, count = np.unique(cell[order], return_index=True, return_counts=True)
    of_trial = generator.permutation(np.resize(np.arange(len(classes)), _TRIALS))
    first, count = first[of_trial], count[of_trial]
    ranks = generator.random((_TRIALS, int(count.max())))
    ranks[np.arange(ranks.shape[1]) >= count[:, np.newaxis]] = 2.0  # classes with fewer taps
    drawn = ranks.argsort(axis=1)
    return _play(lambda n, t: evidence[order[first[t] + drawn[t, n % count[t]]]], MOST_TAPS, of_class)


def _of_the_fit(table: NDArray[np.float64], taps: int, of_class: _Named) -> _Trials:
    """Trials on taps drawn from the fit, of one sample per taxel, of which its beliefs are right at power J."""
    generator = seeds.generator(0, seeds.Purpose.QUICK_FIT, 1)
    cells, K, B = table.shape
    of_trial = generator.permutation(np.resize(np.arange(cells), _TRIALS))
    upper = np.exp(table).cumsum(axis=2)
    rows = np.arange(cells * K).reshape(cells, K)
    ends = (upper / upper[:, :, -1:] + rows[:, :, np.newaxis]).ravel()

    def tap(_: int, trials: NDArray[np.intp]) -> NDArray[np.float64]:
        row = rows[of_trial[trials]]
        bins = np.searchsorted(ends, row + generator.random(row.shape), side="right") - row * B
        return np.sum([table[:, k, np.minimum(bins[:, k], B - 1)].T for k in range(K)], axis=0)

    return _play(tap, taps, of_class)
