"""Bins of sample values and histograms of taps; text around Eq. 2 of the paper."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError

_CHUNK = 1 << 24  # counts held at a time, 128 MiB
_SAMPLES = 1 << 16  # counted at a time, so that their bins and counts stay in cache


class SparseCounts(NamedTuple):
    """Histograms of n taps as lists of the occupied cells k B + b.

    Attributes:
        first: Where the list of each tap begins in the two others, and where the last one ends, shape (n + 1,).
        cell: The occupied cells.
        times: How many samples each of them holds.
    """

    first: NDArray[np.int64]
    cell: NDArray[np.int64]
    times: NDArray[np.float64]


class _Layout(NamedTuple):
    """Edges as `counting.find` requires them: `low` and `scale` of each taxel, `lower` and `upper` of each cell."""

    low: NDArray[np.float64]
    scale: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]


def bin_edges(samples: NDArray[np.floating], bins: int, value_range: str) -> NDArray[np.float64]:
    """Edges of equal-width bins across the full range of the samples.

    Args:
        samples: Shape (N, J, K).
        bins: Number of bins.
        value_range: `"global"` for one range over all taxels, `"taxel"` for one each.

    Returns:
        Shape (bins + 1,) or (K, bins + 1). A constant range is widened by half a unit to both sides.

    Raises:
        InputError: The range is named otherwise.
    """
    if value_range not in ("global", "taxel"):
        raise InputError(f"value_range must be global or taxel, got {value_range!r}.")
    low, high = samples.min(axis=0).min(axis=0), samples.max(axis=0).max(axis=0)  # axis by axis is faster
    if value_range == "global":
        low, high = low.min(), high.max()
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    # A range of a few rounding steps cannot hold distinct edges and counts as constant too.
    constant = high - low <= 4 * bins * np.spacing(np.maximum(np.abs(low), np.abs(high)))
    margin = np.maximum(0.5, 8 * bins * np.spacing(np.maximum(np.abs(low), np.abs(high))))
    low, high = np.where(constant, low - margin, low), np.where(constant, high + margin, high)
    return np.linspace(low, high, bins + 1, axis=-1)


def find_bins(samples: NDArray[np.floating], edges: NDArray[np.float64]) -> NDArray[np.intp]:
    """Bin of each sample (..., K): half-open, the last closed; values outside in the end bins; -1 for NaN."""
    from .counting import find

    K = samples.shape[-1]
    rows = _plain(samples.reshape(-1, K))
    cells = np.empty(rows.shape, dtype=np.int64)
    layout = _layout(edges, K)
    finite = find(rows, *layout, cells)
    bins = cells - np.arange(K) * (len(layout.lower) // K)
    return (bins if finite else np.where(cells < 0, -1, bins)).reshape(samples.shape)


def count_taps(samples: NDArray[np.floating], edges: NDArray[np.float64]) -> Iterator[tuple[slice, SparseCounts]]:
    """Histograms of taps, in chunks of limited memory.

    Args:
        samples: Shape (N, J, K).
        edges: Shape (B + 1,) or (K, B + 1).

    Yields:
        Which taps these are, and their counts, which are overwritten by the next ones.

    Raises:
        InputError: A sample is NaN or infinite.
    """
    from .counting import count, find

    N, J, K = samples.shape
    layout = _layout(edges, K)
    step = max(1, min(N, _SAMPLES // max(1, J * K)))
    cells, held = np.empty((step, J * K), dtype=np.int64), np.zeros(len(layout.lower), dtype=np.int64)
    counts = SparseCounts(np.empty(step + 1, np.int64), np.empty(step * J * K, np.int64), np.empty(step * J * K))
    for start in range(0, N, step):
        part = samples[start : start + step]
        found = cells[: len(part)]
        if not find(_plain(part.reshape(len(part), J * K)), *layout, found):
            raise InputError("Samples must not be NaN or infinite.")
        count(found, held, *counts)
        yield slice(start, start + len(part)), counts._replace(first=counts.first[: len(part) + 1])


def tap_counts(bins: NDArray[np.intp], B: int) -> Iterator[NDArray[np.float64]]:
    """Occupation counts of each tap, shape (n, K B), in chunks of taps."""
    N, _, K = bins.shape
    step = max(1, _CHUNK // (K * B))
    for start in range(0, N, step):
        part = bins[start : start + step]
        cells = (np.arange(len(part))[:, None, None] * K + np.arange(K)) * B + part
        yield (np.bincount(cells.ravel(), minlength=len(part) * K * B).reshape(len(part), K * B).astype(np.float64))


def _plain(samples: NDArray[np.floating]) -> NDArray[np.floating]:
    """Samples in the layout of the compiled loops; single precision is kept."""
    return np.require(samples, np.float32 if samples.dtype == np.float32 else np.float64, ["C", "W"])


def _layout(edges: NDArray[np.float64], K: int) -> _Layout:
    edges = np.broadcast_to(edges, (K, edges.shape[-1]))
    lower, upper = edges[:, :-1].copy(), edges[:, 1:].copy()
    with np.errstate(over="ignore"):
        scale = lower.shape[1] / (edges[:, -1] - edges[:, 0])
    lower[:, 0], upper[:, -1] = np.finfo(np.float64).min, np.inf  # infinite samples lie outside, see `find`
    return _Layout(edges[:, 0].copy(), scale, lower.ravel(), upper.ravel())
