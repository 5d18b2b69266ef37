"""Evidence of a tap: log-likelihood ratio of its own class against the most similar one.

The evidence is the log-likelihood ratio at power 1, sample by sample. Every tap is judged by a model that did not see
it: the training taps are halved within their classes, each half fits a model, and a tap of either half is judged by the
model of the other one, against the rival that this model chooses; so are the taps of other sessions, halved likewise,
whose evidence can then be compared with that of the training session as one tap's with another's.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.histogram import HistogramModel, fit
from ...models.measurement.likelihood.bins import find_bins
from ...models.measurement.scaling import sum_by
from ...models.splits import rank_in_class
from ...models.taps import TapSet

_QUARTERED = 8  # taps of a class and session, from which on they are divided by quarters
_LEAST = 1e-9
"""Stands in for the probability 0 of a table without pseudocount, whose evidence would be infinite."""


class Evidence(NamedTuple):
    """Log-likelihood ratios of N taps of classes that both halves of the training taps know.

    Attributes:
        tap: Which taps these are, positions in the tap set, shape (N,).
        own: Class of each tap, where * M + what, shape (N,).
        half: Which half each tap belongs to, shape (N,).
        rival: Class against which the taps of each half and class are judged, shape (2, L M); -1 for unknown classes.
        values: Of every sample, in nats, shape (N, J, K).
        judge: Gives the values that other samples of the same taps would have.
    """

    tap: NDArray[np.intp]
    own: NDArray[np.intp]
    half: NDArray[np.intp]
    rival: NDArray[np.intp]
    values: NDArray[np.float64]
    judge: "Judge"


def evidence(
    train: TapSet, taps: TapSet, grid: ClassGrid, model: HistogramModel, judged: NDArray[np.bool_] | None = None
) -> Evidence:
    """The evidence of taps, the training taps among them.

    Args:
        train: The training taps.
        taps: The same and others behind them.
        grid: The classes.
        model: Fitted to all training taps; gives edges and pseudocount.
        judged: Which of the taps to judge, shape (N,); `None` for all.

    Raises:
        InputError: No class has two training taps, so that none can be judged by others.
    """
    train_half, others = halves(train, grid), np.arange(len(train), len(taps))
    if not train_half.any():
        raise InputError("The evidence cannot be cross-validated: no class has two training taps.")
    half = np.concatenate([train_half, halves(taps.select(others), grid)]) if len(others) else train_half
    tables = [
        fit(
            train.select(train_half != half_number),
            grid,
            bins=model.edges.shape[-1] - 1,
            pseudocount=model.pseudocount,
            power="none",
            edges=model.edges,
        )
        for half_number in (0, 1)
    ]
    trained = tables[0].trained & tables[1].trained
    where, what = taps.indices(grid)
    known = (where >= 0) & (what >= 0)
    if judged is not None:
        known &= judged
    known[known] = trained[where[known], what[known]]
    rival = np.stack([rivals(part, trained) for part in tables])
    own = where * grid.M + what
    known &= (rival[:, np.maximum(own, 0)] >= 0).all(axis=0)
    tap = np.flatnonzero(known)
    if not len(tap):
        raise InputError("No tap belongs to a class with two training taps and a rival.")
    own, half = own[tap], half[tap]
    judge = Judge(
        np.stack([_ratios(part, against) for part, against in zip(tables, rival, strict=True)]), half, own, model.edges
    )
    return Evidence(tap, own, half, rival, judge(taps.select(tap).taps), judge)


def halves(taps: TapSet, grid: ClassGrid) -> NDArray[np.intp]:
    """Which half of its class each tap belongs to, 0 or 1, shape (N,).

    The taps of a class in one session, in recorded order, go to the halves by quarters: first, second, first, second.
    Neighbours share slow noise and mostly stay together, and both halves see nearly the same places. Fewer than eight
    take turns, and where sessions hold one tap of a class each, so do the sessions.
    """
    half = rank_in_class(taps, grid)[0] % 2
    for session in np.unique(taps.session):
        chosen = np.flatnonzero(taps.session == session)
        rank, size = rank_in_class(taps.select(chosen), grid)
        by_rank = np.where(size < _QUARTERED, rank % 2, 4 * rank // np.maximum(size, 1) % 2)
        half[chosen] = np.where(size > 1, by_rank, half[chosen])
    return half


def rivals(model: HistogramModel, trained: NDArray[np.bool_]) -> NDArray[np.intp]:
    """The class that each one is most easily taken for, by the least Kullback-Leibler divergence of their tables.

    A rival holds another object, or, where there is one object only, is another position.

    Args:
        model: The fitted histograms.
        trained: Classes that count, shape (L, M).

    Returns:
        Class numbers where * M + what, -1 for classes that do not count or have no rival, shape (L M,).
    """
    L, M = model.grid.shape
    p = model.probabilities.reshape(L * M, -1)
    log_p = np.log(np.maximum(p, _LEAST))
    divergence = (p * log_p).sum(axis=1)[:, None] - p @ log_p.T
    what = np.arange(L * M) % M
    barred = (what[:, None] == what) if M > 1 else np.eye(L * M, dtype=bool)
    divergence[barred | ~trained.ravel()[None]] = np.inf
    best = divergence.argmin(axis=1)
    found = np.isfinite(divergence[np.arange(L * M), best]) & trained.ravel()
    return np.where(found, best, -1)


def _ratios(model: HistogramModel, rival: NDArray[np.intp]) -> NDArray[np.float64]:
    """Log ratio of each class's table to its rival's, shape (L M, K, B)."""
    K, B = model.log_prob.shape[2:]
    log_prob = model.log_prob.reshape(-1, K, B)
    finite = np.maximum(log_prob, np.log(_LEAST))
    return finite - finite[rival]


class Judge:
    """Looks up the log ratios of taps of known class and half."""

    def __init__(
        self, ratio: NDArray[np.float64], half: NDArray[np.intp], own: NDArray[np.intp], edges: NDArray[np.float64]
    ) -> None:
        self._ratio, self._half, self._own, self._edges = ratio, half, own, edges

    def __call__(self, samples: NDArray[np.floating]) -> NDArray[np.float64]:
        """The value of every sample, shape (N, J, K)."""
        bins = find_bins(samples, self._edges)
        return self._ratio[self._half[:, None, None], self._own[:, None, None], np.arange(samples.shape[2]), bins]

    def response(
        self, samples: NDArray[np.float64], way: NDArray[np.float64], step: float
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Mean change of the values per unit of a change of the samples, of each class that has taps.

        Args:
            samples: Shape (N, J, K).
            way: What one unit of change adds to them, same shape.
            step: How many units the response is taken over, to either side.

        Returns:
            The classes, in increasing order, and their responses, shape (classes, J, K).
        """
        change = (self(samples + step * way) - self(samples - step * way)) / (2 * step)
        classes, index, count = np.unique(self._own, return_inverse=True, return_counts=True)
        return classes, sum_by(index, change, len(classes)) / count[:, None, None]
