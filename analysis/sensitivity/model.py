"""The paper's histograms under any reading of Eq. 1 and 2: root, bins, and probability of an empty bin."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...models.grid import ClassGrid
from ...models.measurement.histogram import HistogramModel, fit
from ...models.measurement.likelihood.bins import bin_edges
from ...models.measurement.model import TapModel
from ...models.measurement.table import TableModel
from ...models.taps import TapSet
from .choices import Reading

_BEYOND = 1e6  # times the width of the range, where bins for samples beyond it end; those farther out fall in them too


def histograms(reading: Reading, train: TapSet, grid: ClassGrid) -> HistogramModel:
    """Histograms of training taps in the bins of a reading, which readings share that differ in other respects.

    Args:
        reading: Its number of bins and their range count here.
        train: Training taps.
        grid: The classes.

    Raises:
        InputError: As `fit`.
    """
    return fit(train, grid, edges=_edges(reading, train))


def with_reading(reading: Reading, histogram: HistogramModel) -> TapModel:
    """The measurement model of a reading from histograms in its bins."""
    histogram = replace(histogram, power=reading.power, pseudocount=reading.pseudocount)
    if (reading.added, reading.outside) == ("all", "end bin"):
        return histogram
    tables, empty = smoothed(histogram, reading.added)
    edges = histogram.edges
    if reading.outside != "end bin":
        beyond = empty if reading.outside == "empty bin" else np.ones_like(empty)
        beyond = np.where(histogram.trained[..., np.newaxis, np.newaxis], beyond, 0.0)
        tables, edges = np.concatenate([beyond, tables, beyond], axis=-1), _with_outer_bins(edges)
    return TableModel(
        grid=histogram.grid,
        edges=edges,
        probabilities=tables,
        power=reading.power,
        preprocessing=histogram.preprocessing,
        left_out=histogram.left_out,
    )


def smoothed(model: HistogramModel, added: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The tables of Eq. 2 and what they give to an empty bin.

    Args:
        model: Counts and pseudocount.
        added: As in `Reading`.

    Returns:
        Shapes (L, M, K, B) and (L, M, K, 1), zero for untrained classes.
    """
    counts = model.counts.astype(np.float64)
    own = counts.sum(axis=-1, keepdims=True)
    raised = counts + model.pseudocount if added == "all" else np.where(counts > 0, counts, model.pseudocount)
    total = own if added == "empty, not normalised" else raised.sum(axis=-1, keepdims=True)
    total = np.where(own > 0, total, np.inf)
    return raised / total, model.pseudocount / total


def impossible_share(model: TapModel, taps: TapSet) -> float:
    """The share of taps that are impossible under their own class."""
    where, what = taps.indices(model.grid)
    own = model.log_likelihood(taps.taps)[np.arange(len(taps)), where, what]
    return float(np.isneginf(own).mean())


def _edges(reading: Reading, train: TapSet) -> NDArray[np.float64]:
    if reading.value_range != "standardised":
        return bin_edges(train.taps, reading.bins, reading.value_range)
    samples = train.taps.astype(np.float64)
    mean, scale = samples.mean(axis=(0, 1)), samples.std(axis=(0, 1))
    scale = np.where(scale > 0, scale, 1.0)
    return mean[:, np.newaxis] + scale[:, np.newaxis] * bin_edges((samples - mean) / scale, reading.bins, "global")


def _with_outer_bins(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """One more bin at each end; the largest training sample stays in the last bin of the range."""
    width = _BEYOND * (edges[..., -1:] - edges[..., :1])
    inner = edges.copy()
    inner[..., -1] = np.nextafter(inner[..., -1], np.inf)
    return np.concatenate([edges[..., :1] - width, inner, inner[..., -1:] + width], axis=-1)
