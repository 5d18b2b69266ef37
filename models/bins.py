"""Equal-width bins and how often the samples of a tap fall into each; text around Eq. 2 of the paper."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .errors import InputError

_CHUNK = 1 << 24  # counts held at a time, 128 MiB


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
        raise InputError(f"The range must be global or taxel, got {value_range!r}.")
    axes = None if value_range == "global" else (0, 1)
    low = np.asarray(samples.min(axis=axes), dtype=np.float64)
    high = np.asarray(samples.max(axis=axes), dtype=np.float64)
    # A range of a few rounding steps cannot hold distinct edges and counts as constant too.
    constant = high - low <= 4 * bins * np.spacing(np.maximum(np.abs(low), np.abs(high)))
    margin = np.maximum(0.5, 8 * bins * np.spacing(np.maximum(np.abs(low), np.abs(high))))
    low, high = np.where(constant, low - margin, low), np.where(constant, high + margin, high)
    return np.linspace(low, high, bins + 1, axis=-1)


def find_bins(samples: NDArray[np.floating], edges: NDArray[np.float64]) -> NDArray[np.intp]:
    """The bin of every sample (..., K): half-open, the last closed, outside clipped to the end bins."""
    last = edges.shape[-1] - 2
    samples = samples.astype(np.float64, copy=False)
    if edges.ndim == 1:
        return np.clip(np.searchsorted(edges, samples, side="right") - 1, 0, last)
    columns = [np.searchsorted(edges[k], samples[..., k], side="right") - 1 for k in range(len(edges))]
    return np.clip(np.stack(columns, axis=-1), 0, last)


def tap_counts(bins: NDArray[np.intp], B: int) -> Iterator[NDArray[np.float64]]:
    """Occupation counts of each tap, shape (n, K B), in chunks of taps."""
    N, _, K = bins.shape
    step = max(1, _CHUNK // (K * B))
    for start in range(0, N, step):
        part = bins[start : start + step]
        cells = (np.arange(len(part))[:, None, None] * K + np.arange(K)) * B + part
        yield (np.bincount(cells.ravel(), minlength=len(part) * K * B).reshape(len(part), K * B).astype(np.float64))
