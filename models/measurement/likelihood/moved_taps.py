"""Log probability of taps under tables that are moved to several states, of which only the bins of the taps are."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...compiled import compiled
from ...elementary import LEAST, exponential, logarithm
from ..states import States
from .bins import SparseCounts, count_bins
from .moved_bins import SMALL, log_sum, pieces


class MovedTaps(NamedTuple):
    """Taps of known hypotheses, prepared for tables that are moved to S states.

    Attributes:
        used: The R hypotheses that have a tap, as l H + h, shape (R,).
        taps: First tap of each of them in the next, and N, shape (R + 1,).
        order: Numbers of taps, those of a hypothesis together, shape (N,).
        counts: Histograms of the taps.
        bins: First bin of each taxel of each hypothesis in the next, and how many, shape (R K + 1,).
        bin: Bins that taps of the hypothesis occupy, ascending.
        source: Bin that each piece is part of before, for all states and taxels, see `pieces`.
        width: Likewise.
        first: Likewise, and behind it the end, shape (S, K, B + 1).
        share: Width of all pieces of each bin before, shape (S, K, B).
    """

    used: NDArray[np.intp]
    taps: NDArray[np.intp]
    order: NDArray[np.intp]
    counts: SparseCounts
    bins: NDArray[np.intp]
    bin: NDArray[np.intp]
    source: NDArray[np.intp]
    width: NDArray[np.float64]
    first: NDArray[np.intp]
    share: NDArray[np.float64]

    @classmethod
    def of(cls, bins: NDArray[np.intp], own: NDArray[np.intp], edges: NDArray[np.float64], states: States) -> Self:
        """From bins (N, J, K), -1 for those that do not count, and hypotheses (N,)."""
        K, B = bins.shape[2], edges.shape[-1] - 1
        parts = [
            (first.copy(), cell[: first[-1]].copy(), times[: first[-1]].copy())
            for _, (first, cell, times) in count_bins(bins, B)
        ]
        used, row, size = np.unique(own, return_inverse=True, return_counts=True)
        number = np.concatenate([np.diff(first) for first, *_ in parts])
        cell = np.concatenate([part[1] for part in parts])
        counts = SparseCounts(np.append(0, number.cumsum()), cell, np.concatenate([part[2] for part in parts]))
        occupied = np.unique(np.repeat(row, number) * (K * B) + cell)
        each = [
            pieces(edges_of, *state)
            for state in zip(*(v.tolist() for v in states[:2]), strict=True)
            for edges_of in np.broadcast_to(edges, (K, B + 1))
        ]
        ends = np.cumsum([len(source) for source, *_ in each])
        first = np.array(
            [np.append(at, len(source)) + end - len(source) for (source, _, at), end in zip(each, ends, strict=True)]
        )
        share = np.array([np.bincount(source, width, minlength=B) for source, width, _ in each])
        return cls(
            used,
            np.append(0, size.cumsum()),
            np.argsort(row, kind="stable"),
            counts,
            np.searchsorted(occupied, np.arange(len(used) * K + 1) * B),
            occupied % B,
            np.concatenate([source for source, *_ in each]),
            np.concatenate([width for _, width, _ in each]),
            first.reshape(-1, K, B + 1),
            share.reshape(-1, K, B),
        )

    def log_probability(self, log_prob: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log probability of the bins of each tap in each state, shape (S, N), from tables (L, H, K, B)."""
        out = np.empty((len(self.first), len(self.order)))
        rows = np.ascontiguousarray(log_prob.reshape(-1, *log_prob.shape[2:])[self.used])
        _add_moved(rows, self.taps, self.order, *self.counts, *self[4:], out)
        return out


@compiled
def _add_moved(log_prob, taps, order, begin, cell, times, bins, bin_, source, width, first, share, out):
    """Writes log probabilities of taps; see `MovedTaps`. Only bins that taps occupy are moved."""
    (R, K, B), S = log_prob.shape, len(first)
    plain, top, logs, value = np.empty((K, B)), np.empty(K), np.empty(B), np.empty(K * B)
    for r in range(R):
        for k in range(K):
            top[k] = _exponentials(log_prob[r, k], plain[k])
        for s in range(S):
            for k in range(K):
                some = bin_[bins[r * K + k] : bins[r * K + k + 1]]
                less = np.log(_sum_product(plain[k], share[s, k]))
                _move_some(log_prob[r, k], plain[k], top[k], some, source, width, first[s, k], logs)
                for n in range(len(some)):
                    value[k * B + some[n]] = logs[n] - less
            for i in range(taps[r], taps[r + 1]):
                total = 0.0
                for e in range(begin[order[i]], begin[order[i] + 1]):
                    total += times[e] * value[cell[e]]
                out[s, order[i]] = total


@compiled
def _exponentials(row, plain):
    """Writes exponentials of a row relative to its largest value, which is returned."""
    top = row[0]
    for b in range(len(row)):
        top = max(top, row[b])
    for b in range(len(row)):
        plain[b] = exponential(max(row[b] - top, LEAST))
    return top


@compiled
def _sum_product(one, other):
    total = 0.0
    for b in range(len(one)):
        total += one[b] * other[b]
    return total


@compiled
def _move_some(row, plain, top, some, source, width, first, logs):
    """Writes the logs of some moved bins, whose probabilities `plain` are relative to the exponential of `top`."""
    for n in range(len(some)):
        total = 0.0
        for i in range(first[some[n]], first[some[n] + 1]):
            total += plain[source[i]] * width[i]
        logs[n] = total
    for n in range(len(some)):
        total = logs[n]
        logs[n] = logarithm(max(total, SMALL)) if total >= SMALL else np.nan
    for n in range(len(some)):
        if np.isnan(logs[n]):
            own = slice(first[some[n]], first[some[n] + 1])
            logs[n] = log_sum(row, source[own], width[own], top)
