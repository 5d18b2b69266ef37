"""Tables of samples that are multiplied by a gain and shifted by an offset."""

from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...compiled import compiled
from ...elementary import LEAST, exponential, logarithm
from ..states import States
from .bins import SparseCounts, count_bins

_SMALL = 1e-290  # a sum above it has all its digits, as what adds to it is above exp(LEAST)


def pieces(
    edges: NDArray[np.float64], gain: float, offset: float
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.intp]]:
    """Pieces that the moved bins of a taxel consist of, kept, as all draws of a model are moved alike.

    Args:
        edges: Shape (B + 1,).
        gain: What samples are multiplied by.
        offset: What is added then.

    Returns:
        The bin that each piece is part of before, its width in this bin's, and the first piece of each bin after.
    """
    return _pieces(edges.astype(np.float64).tobytes(), gain, offset)


@lru_cache(maxsize=4096)
def _pieces(
    content: bytes, gain: float, offset: float
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.intp]]:
    edges = np.frombuffer(content)
    B = len(edges) - 1
    place = _in_bins((edges - offset) / gain, edges)
    cuts = np.union1d(np.arange(B + 1.0), np.append(place, [min(place[0], 0.0), max(place[-1], B)]))
    source = np.clip(np.floor(0.5 * (cuts[:-1] + cuts[1:])), 0, B - 1).astype(np.intp)
    return source, np.diff(cuts), np.append(0, np.searchsorted(cuts, place[1:-1]))


def _in_bins(values: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (...) in units of bins from the lowest edge; end bins set the scale beyond the edges."""
    width = np.diff(edges)
    inside = np.interp(values, edges, np.arange(len(edges)))
    return inside + np.minimum(values - edges[0], 0.0) / width[0] + np.maximum(values - edges[-1], 0.0) / width[-1]


@compiled
def move(log_prob, k, source, width, first, moved):
    """Writes the log probabilities of the moved bins of taxel k, which sum to one.

    Args:
        log_prob: Those before, shape (L, H, K, B).
        k: The taxel.
        source: See `pieces`.
        width: See `pieces`.
        first: See `pieces`.
        moved: Receives the result, shape (L, H, K, B).
    """
    L, H, _, B = log_prob.shape
    plain, total, logs = np.empty(B), np.empty(B), np.empty(B)
    for l in range(L):
        for h in range(H):
            row = log_prob[l, h, k]
            top = row[0]
            for b in range(B):
                top = max(top, row[b])
            for b in range(B):
                plain[b] = exponential(max(row[b] - top, LEAST))
            whole = 0.0
            for b in range(B):
                last = first[b + 1] if b + 1 < B else len(source)
                sum_ = 0.0
                for i in range(first[b], last):
                    sum_ += plain[source[i]] * width[i]
                total[b] = sum_
                whole += sum_
            for b in range(B):
                logs[b] = logarithm(max(total[b], _SMALL))
            less = np.log(whole)
            for b in range(B):
                if total[b] < _SMALL:
                    last = first[b + 1] if b + 1 < B else len(source)
                    logs[b] = _log_sum(row, source[first[b] : last], width[first[b] : last], top)
                moved[l, h, k, b] = logs[b] - less


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
        logs[n] = logarithm(max(total, _SMALL)) if total >= _SMALL else np.nan
    for n in range(len(some)):
        if np.isnan(logs[n]):
            own = slice(first[some[n]], first[some[n] + 1])
            logs[n] = _log_sum(row, source[own], width[own], top)


@compiled
def _log_sum(row, source, width, top):
    """Log of the sum of widths times probabilities over exp(top), also where these leave the range of numbers."""
    most = -np.inf
    for i in range(len(source)):
        most = max(most, row[source[i]])
    if most == -np.inf:
        return most
    sum_ = 0.0
    for i in range(len(source)):
        sum_ += np.exp(row[source[i]] - most) * width[i]
    return most - top + np.log(sum_)
