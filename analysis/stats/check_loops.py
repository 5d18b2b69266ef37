"""Compiled loops of `checks` over taps in bins.

Taps stand class by class, each as a row of F samples: sample j of taxel k at place j K + k. Bin b of taxel k is cell
k B + b.
"""

import numpy as np
from numpy.typing import NDArray

from ...models.compiled import compiled

type Floats = NDArray[np.float64]
type Cells = NDArray[np.uint32]
type Places = NDArray[np.intp]


@compiled
def leave_means(cells: Cells, centre: Floats, classes: Places, mean: Floats, residual: Floats, square: Floats) -> None:
    """Writes the mean tap of each class and what is left of its taps.

    Args:
        cells: Of the samples, shape (N, F).
        centre: Of the cells.
        classes: First tap of each class, and N, shape (C + 1,).
        mean: Receives the mean taps, shape (C, F).
        residual: Receives what is left, shape (N, F).
        square: Receives sums of the squares of that, shape (C, F).
    """
    F = cells.shape[1]
    mean[:] = 0.0
    square[:] = 0.0
    for c in range(len(mean)):
        for i in range(classes[c], classes[c + 1]):
            for f in range(F):
                value = centre[cells[i, f]]
                residual[i, f] = value
                mean[c, f] += value
        for f in range(F):
            mean[c, f] /= classes[c + 1] - classes[c]
        for i in range(classes[c], classes[c + 1]):
            for f in range(F):
                left = residual[i, f] - mean[c, f]
                residual[i, f] = left
                square[c, f] += left * left


@compiled
def neighbours(residual: Floats, K: int) -> tuple[float, float, float]:
    """Sums over samples K places apart: their products, squares of the former and of the latter."""
    N, F = residual.shape
    product = former = latter = 0.0
    for i in range(N):
        for f in range(F - K):
            one, other = residual[i, f], residual[i, f + K]
            product += one * other
            former += one * one
            latter += other * other
    return product, former, latter


@compiled
def count_beyond(residual: Floats, classes: Places, limit: Floats) -> int:
    """How many samples are farther from 0 than the limit of their class and place, shape (C, F)."""
    beyond = 0
    for c in range(len(limit)):
        for i in range(classes[c], classes[c + 1]):
            for f in range(residual.shape[1]):
                beyond += 1 if abs(residual[i, f]) > limit[c, f] else 0
    return beyond


@compiled
def between(residual: Floats, first: Places) -> float:
    """Sum over places and groups of the squared sum of taps over their number; first taps and N, shape (S + 1,)."""
    total, found = np.empty(residual.shape[1]), 0.0
    for s in range(len(first) - 1):
        total[:] = 0.0
        for i in range(first[s], first[s + 1]):
            for f in range(len(total)):
                total[f] += residual[i, f]
        part = 0.0
        for f in range(len(total)):
            part += total[f] * total[f]
        found += part / (first[s + 1] - first[s])
    return found


@compiled
def ranks(cells: Cells, places: Places, first: Places, held: NDArray[np.int64], units: Floats, varies: Floats) -> None:
    """Writes ranks of the n taps of each group less their mean, of length sqrt(n); equal values share one.

    Args:
        cells: Shape (N, F).
        places: Which are ranked, shape (T,).
        first: First tap of each group, and N, shape (S + 1,).
        held: One 0 for each cell.
        units: Receives the ranks, 0 where all are equal, shape (N, T).
        varies: Receives 1 where not all are equal, else 0, shape (S, T).
    """
    for s in range(len(first) - 1):
        n = first[s + 1] - first[s]
        for t in range(len(places)):
            low = high = np.int64(cells[first[s], places[t]])
            for i in range(first[s], first[s + 1]):
                cell = np.int64(cells[i, places[t]])
                held[cell] += 1
                low, high = min(low, cell), max(high, cell)
            below, square = 0, 0.0
            for cell in range(low, high + 1):
                count = held[cell]
                held[cell] = 2 * below + count - n  # twice the rank
                square += count * float(held[cell]) ** 2
                below += count
            varies[s, t] = 1.0 if square > 0 else 0.0
            scale = np.sqrt(n / square) if square > 0 else 0.0
            for i in range(first[s], first[s + 1]):
                units[i, t] = scale * held[cells[i, places[t]]]
            for cell in range(low, high + 1):
                held[cell] = 0


@compiled
def count_halves(cells: Cells, classes: Places, half: Places, counts: NDArray[np.int64]) -> None:
    """Adds the samples of each class to the counts of its halves, shape (2, C, cells)."""
    for c in range(len(classes) - 1):
        for i in range(classes[c], classes[c + 1]):
            for f in range(cells.shape[1]):
                counts[half[i], c, cells[i, f]] += 1


@compiled
def spread_of_sums(cells: Cells, table: Floats, half: Places, parts: Places) -> tuple[float, float]:
    """Sums of the squares of values less the mean of their part: of whole taps, and of single samples.

    Args:
        cells: Of all taps, shape (N, F).
        table: Value of each cell in each half, shape (2, cells).
        half: Of all taps, shape (N,).
        parts: First tap of each part, and behind the last one, shape (P + 1,).
    """
    F = cells.shape[1]
    mean, whole, single = np.empty(F), 0.0, 0.0
    for p in range(len(parts) - 1):
        mean[:] = 0.0
        for i in range(parts[p], parts[p + 1]):
            for f in range(F):
                mean[f] += table[half[i], cells[i, f]]
        for f in range(F):
            mean[f] /= parts[p + 1] - parts[p]
        for i in range(parts[p], parts[p + 1]):
            total = 0.0
            for f in range(F):
                left = table[half[i], cells[i, f]] - mean[f]
                total += left
                single += left * left
            whole += total * total
    return whole, single
