"""How badly a tap fits a class, and how badly the training taps fit their own.

A plain likelihood cannot tell a new thing: samples without contact are likely under every class. The misfit compares
with the best that any histograms could do instead: it is the divergence of the tap's own histograms from those of the
class, summed over the taxels. The misfits of training taps, each left out of its class, say what is usual.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import rel_entr, xlogy

from .bins import find_bins, tap_counts

if TYPE_CHECKING:
    from .histogram import HistogramModel
    from .model import TapModel
    from .taps import TapSet

FEWEST = 5
"""Scores of a class below which the mean of all scores stands for its own."""
_PSEUDOCOUNT = 0.01  # stands in for none, under which most misfits would be infinite


class NoveltyScores(NamedTuple):
    """How badly training taps fit a model that does not know them.

    Attributes:
        misfit: To their own class in nats, shape (n,).
        cell: Their class as l M + m, shape (n,).
        best: Excess over the class that they fit best, own or other, shape (n,); see `excess`.
    """

    misfit: NDArray[np.float64]
    cell: NDArray[np.intp]
    best: NDArray[np.float64]


def smoothed(occupation: NDArray[np.floating | np.integer], pseudocount: float) -> NDArray[np.float64]:
    """Eq. 2 for misfits, bins on the last axis, where no pseudocount is replaced by a small one."""
    raised = occupation + (pseudocount or _PSEUDOCOUNT)
    return raised / raised.sum(axis=-1, keepdims=True)


def misfit(counts: NDArray[np.floating], occupation: NDArray[np.floating], pseudocount: float) -> NDArray[np.float64]:
    """Divergence of the histograms of taps from those of classes, sum over k of KL(h_k / J || P_k), in nats.

    That is 1/J of the logarithm by which histograms of the tap's own would be likelier (Eq. 1).

    Args:
        counts: Samples of a tap in each bin, shape (..., K, B).
        occupation: Occupation numbers of the class, the same shape.
        pseudocount: As in Eq. 2.

    Returns:
        Shape (...).
    """
    own = counts / counts.sum(axis=-1, keepdims=True)
    return rel_entr(own, smoothed(occupation, pseudocount)).sum(axis=(-2, -1))


def novelty_scores(model: "HistogramModel", taps: "TapSet") -> NoveltyScores:
    """The scores of each training tap under the model without it, or without its session where there are several.

    Args:
        model: Fitted to these taps.
        taps: The training taps; those outside the grid or alone in their class have no score.
    """
    L, M, K, B = model.counts.shape
    where, what = taps.indices(model.grid)
    inside = np.flatnonzero((where >= 0) & (what >= 0))
    cell = (where * M + what)[inside]
    sessions, session = np.unique(taps.session[inside], return_inverse=True)
    bins = find_bins(taps.taps[inside], model.edges)
    occupation = model.counts.reshape(L * M, K, B)
    left_out = _session_counts(bins, cell * len(sessions) + session, L * M * len(sessions), B)
    misfits, start = [], 0
    for part in tap_counts(bins, B):
        counts, now = part.reshape(-1, K, B), slice(start, start + len(part))
        own = counts if len(sessions) == 1 else left_out[cell[now] * len(sessions) + session[now]].reshape(-1, K, B)
        rest = occupation[cell[now]] - own
        value = misfit(counts, rest, model.pseudocount)
        misfits.append(np.where(rest.any(axis=(1, 2)), value, np.nan))
        start += len(part)
    scores = np.concatenate(misfits)
    known = np.isfinite(scores)
    scores, cell, bins, session = scores[known], cell[known], bins[known], session[known]
    centre, best = centres(scores, cell, L * M), own_excess(scores, cell)
    for s in range(len(sessions)):
        others = left_out[s :: len(sessions)].reshape(L * M, K, B) if len(sessions) > 1 else 0.0
        now = np.flatnonzero(session == s)
        best[now] = np.minimum(best[now], _other_excess(bins[now], cell[now], occupation - others, model, centre))
    return NoveltyScores(scores, cell, best)


def with_scores(model: "TapModel", taps: "TapSet") -> "TapModel":
    """The model with the scores of its training taps, if it is the plain histogram, which alone can use them."""
    from .histogram import HistogramModel  # noqa: PLC0415 - which knows of scores

    if not isinstance(model, HistogramModel) or len(model.states.gain) > 1:
        return model
    return replace(model, novelty=novelty_scores(model, taps))


def centres(misfits: NDArray[np.float64], cell: NDArray[np.intp], cells: int) -> NDArray[np.float64]:
    """Mean root misfit of each class, of all where it has few scores; shape (cells,)."""
    root = np.sqrt(misfits)
    n = np.bincount(cell, minlength=cells)
    mean = np.bincount(cell, root, cells) / np.maximum(n, 1)
    return np.where(n < FEWEST, root.mean() if len(root) else 0.0, mean)


def own_excess(misfits: NDArray[np.float64], cell: NDArray[np.intp]) -> NDArray[np.float64]:
    """Each root misfit above the mean of the others of its class, so that it is on a par with that of a new tap."""
    root = np.sqrt(misfits)
    n = np.bincount(cell)[cell]
    others = (np.bincount(cell, root)[cell] - root) / np.maximum(n - 1, 1)
    return root - np.where(n < FEWEST, root.mean() if len(root) else 0.0, others)


def excess(
    share: NDArray[np.floating], log_prob: NDArray[np.floating], centre: NDArray[np.floating]
) -> NDArray[np.float64]:
    """The root misfit of taps to each class, less that of the class's own training taps on average.

    The root is like a distance, and the mean takes out that taps of some classes scatter more than those of others.

    Args:
        share: Samples of a tap in each bin as a fraction of J, shape (n, K B).
        log_prob: Logarithm of `smoothed`, shape (cells, K B).
        centre: Of each class, shape (cells,).

    Returns:
        Shape (n, cells).
    """
    misfits = xlogy(share, share).sum(axis=1, keepdims=True) - share @ log_prob.T
    return np.sqrt(np.maximum(misfits, 0.0)) - centre


def _other_excess(
    bins: NDArray[np.intp],
    cell: NDArray[np.intp],
    occupation: NDArray[np.floating],
    model: "HistogramModel",
    centre: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The smallest excess of taps over classes that are not theirs, infinite where there is none; shape (n,)."""
    log_prob = np.log(smoothed(occupation, model.pseudocount)).reshape(len(occupation), -1)
    untrained = ~occupation.any(axis=(1, 2))
    least = [np.empty(0)]
    for part in tap_counts(bins, occupation.shape[2]):
        start = sum(map(len, least))
        value = excess(part / bins.shape[1], log_prob, centre)
        value[:, untrained] = np.inf
        value[np.arange(len(part)), cell[start : start + len(part)]] = np.inf
        least.append(value.min(axis=1))
    return np.concatenate(least)


def _session_counts(bins: NDArray[np.intp], group: NDArray[np.intp], groups: int, B: int) -> NDArray[np.float64]:
    """Bin counts of the taps of each class and session, shape (groups, K B)."""
    counts = np.zeros((groups, bins.shape[2] * B))
    start = 0
    for part in tap_counts(bins, B):
        np.add.at(counts, group[start : start + len(part)], part)
        start += len(part)
    return counts
