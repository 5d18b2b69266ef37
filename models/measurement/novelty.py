"""Misfit of taps to classes, and misfits of held-out training taps as a reference for novelty.

The likelihood does not detect novel taps: samples without contact are likely under every class. The misfit compares it
with the best that any histograms could reach: it is the divergence of the tap's own histograms from those of the class,
summed over the taxels.

The training taps are split. Half of each class is the reference, whose histograms measure misfit; the others
calibrate. The reference and its bin edges know nothing of the calibration taps, so the misfits of a class are
independent draws of what new taps of that class will have. Scores of taps left out in turn are not: they depend on
each other and on fits to one tap less.
"""

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import rel_entr, xlogy

from ..blocks import over_blocks
from .likelihood.bins import bin_edges, class_counts, find_bins, tap_counts

if TYPE_CHECKING:
    from ..grid import ClassGrid
    from ..taps import TapSet

FEWEST = 5
"""Minimum number of scores of a class; with fewer, the mean of all classes is used."""
_PSEUDOCOUNT = 0.01  # stands in for none, under which most misfits would be infinite


class NoveltyScores(NamedTuple):
    """Misfits of calibration taps to their own class.

    Attributes:
        reference: Occupation numbers of the reference taps, shape (L, M, K, B).
        edges: Bin edges of these, shape (B + 1,) or (K, B + 1).
        misfit: Misfit of calibration taps to the reference of their own class in nats, shape (n,).
        cell: Their class as l M + m, shape (n,).
    """

    reference: NDArray[np.int64]
    edges: NDArray[np.float64]
    misfit: NDArray[np.float64]
    cell: NDArray[np.intp]


def smoothed(occupation: NDArray[np.floating | np.integer], pseudocount: float) -> NDArray[np.float64]:
    """Eq. 2 for misfits, bins on the last axis; a small pseudocount replaces a missing one."""
    raised = occupation + (pseudocount or _PSEUDOCOUNT)
    return raised / raised.sum(axis=-1, keepdims=True)


def misfit(
    counts: NDArray[np.floating], occupation: NDArray[np.floating | np.integer], pseudocount: float
) -> NDArray[np.float64]:
    """Divergence of tap histograms from class histograms, sum over k of KL(h_k / J || P_k), in nats.

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


def misfits(share: NDArray[np.floating], log_prob: NDArray[np.floating]) -> NDArray[np.float64]:
    """Misfit of each tap to each class.

    Args:
        share: Samples of a tap in each bin as a fraction of J, shape (n, K B).
        log_prob: Logarithm of `smoothed`, shape (cells, K B).

    Returns:
        Shape (n, cells).
    """
    return np.maximum(xlogy(share, share).sum(axis=1, keepdims=True) - share @ log_prob.T, 0.0)


def novelty_scores(
    taps: "TapSet", grid: "ClassGrid", bins: int, value_range: Literal["global", "taxel"], pseudocount: float
) -> NoveltyScores:
    """Reference and scores of the calibration taps.

    Args:
        taps: The training taps; those outside the grid are left out.
        grid: The classes.
        bins: Number of bins.
        value_range: Whether they span the range of all taxels together or of each.
        pseudocount: As in Eq. 2.
    """
    L, M, K, B = *grid.shape, taps.dataset.sizes["taxel"], bins
    where, what = taps.indices(grid)
    inside = np.flatnonzero((where >= 0) & (what >= 0))
    cell = (where * M + what)[inside]
    calibrates = calibrating(cell, taps.session[inside])
    rest, own = taps.select(inside[~calibrates]), cell[calibrates]
    edges = bin_edges(rest.extremes, B, value_range)
    reference = class_counts(rest.samples, edges, cell[~calibrates], (L, M, K, B))
    by_cell = reference.reshape(L * M, K, B)

    def scored(block: NDArray[np.floating], which: slice) -> NDArray[np.float64]:
        cells, parts = own[which], []
        for part in tap_counts(find_bins(block, edges), B):
            known = by_cell[cells[sum(map(len, parts)) :][: len(part)]]
            parts.append(misfit(part.reshape(-1, K, B), known, pseudocount))
        return np.concatenate(parts)

    held_out = taps.samples[inside[calibrates]]
    return NoveltyScores(reference, edges, np.concatenate([np.empty(0), *over_blocks(held_out, scored)]), own)


def calibrating(cell: NDArray[np.intp], session: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Mask of calibration taps: in each class every second session, or every second tap of a single session.

    Whole sessions are held out where a class has several, so that misfits include what changes between sessions.

    Args:
        cell: Class of each tap, shape (n,).
        session: Session of each tap, shape (n,).

    Returns:
        Shape (n,); every class has a tap that does not calibrate.
    """
    chosen = np.zeros(len(cell), dtype=bool)
    order = np.argsort(cell, kind="stable")
    for own in np.split(order, np.flatnonzero(np.diff(cell[order])) + 1):
        _, number = np.unique(session[own], return_inverse=True)
        chosen[own] = number % 2 == 0 if number.any() else np.arange(len(own)) % 2 == 1
    return chosen


def centres(misfits: NDArray[np.float64], cell: NDArray[np.intp], cells: int) -> NDArray[np.float64]:
    """Mean root misfit of each class, or of all classes if it has few scores; shape (cells,)."""
    root = np.sqrt(misfits)
    n = np.bincount(cell, minlength=cells)
    mean = np.bincount(cell, root, cells) / np.maximum(n, 1)
    return np.where(n < FEWEST, root.mean() if len(root) else 0.0, mean)


def own_excess(misfits: NDArray[np.float64], cell: NDArray[np.intp]) -> NDArray[np.float64]:
    """Root misfit of each tap minus the mean of the others of its class, comparable with that of a new tap."""
    root = np.sqrt(misfits)
    n = np.bincount(cell)[cell]
    others = (np.bincount(cell, root)[cell] - root) / np.maximum(n - 1, 1)
    return root - np.where(n < FEWEST, root.mean() if len(root) else 0.0, others)
