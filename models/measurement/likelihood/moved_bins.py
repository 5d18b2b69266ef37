"""Tables of samples that are multiplied by a gain and shifted by an offset."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...compiled import compiled
from ...elementary import LEAST, exponential, logarithm

SMALL = 1e-290
"""A sum above it has all its digits, as what adds to it is above exp(LEAST)."""


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
                logs[b] = logarithm(max(total[b], SMALL))
            less = np.log(whole)
            for b in range(B):
                if total[b] < SMALL:
                    last = first[b + 1] if b + 1 < B else len(source)
                    logs[b] = log_sum(row, source[first[b] : last], width[first[b] : last], top)
                moved[l, h, k, b] = logs[b] - less


@compiled
def log_sum(row, source, width, top):
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
