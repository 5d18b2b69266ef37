"""Compiled loops for bins, histograms and log-likelihoods of many taps; Eq. 1 and 2.

A tap occupies few of all bins, so its histogram is kept as a list of occupied cells k B + b with their counts, and
the product of histograms with a table takes these cells only. An impossible cell at -inf then needs no care, as it is
never multiplied by zero.
"""

import numpy as np

from ...compiled import compiled

_COLUMNS = 128  # of a table at a time, so that they stay in cache


@compiled
def search(value, lower, first, last):
    """Cell of a value by bisection from `first` to `last`; -1 for NaN."""
    if np.isnan(value):
        return -1
    while last > first:
        middle = (first + last + 1) // 2
        if lower[middle] <= value:
            first = middle
        else:
            last = middle - 1
    return first


@compiled
def find(samples, low, scale, lower, upper, cells):
    """Writes the cell k B + b of each sample: guessed for equal bins, corrected by bisection.

    Args:
        samples: Shape (n, J K), the taxel running faster.
        low: Lowest edge of each taxel, shape (K,).
        scale: Bins per unit of each taxel, shape (K,).
        lower: Lower edge of each cell, the least finite number for the first of a taxel, shape (K B,).
        upper: Upper edge of each cell, inf for the last of a taxel, shape (K B,).
        cells: Receives the cells, the shape of `samples`.

    Returns:
        0 if all samples are finite, else the sum of 1 if one is NaN, whose cell is -1, and 2 if one is infinite, whose
        cell is that of an end bin.
    """
    n, size = samples.shape
    K = len(low)
    B = len(lower) // K
    top = float(B - 1)
    lows, scales, firsts = np.empty(size), np.empty(size), np.empty(size, dtype=np.int64)
    for s in range(size):
        lows[s], scales[s], firsts[s] = low[s % K], scale[s % K], (s % K) * B
    found = 0
    for i in range(n):
        wrong = 0
        for s in range(size):
            value = float(samples[i, s])
            guess = (value - lows[s]) * scales[s]
            guess = guess if guess > 0 else 0.0
            cell = np.int64(guess if guess < top else top) + firsts[s]
            cells[i, s] = cell
            wrong += 0 if (lower[cell] <= value) & (value < upper[cell]) else 1
        if wrong:
            for s in range(size):
                value = float(samples[i, s])
                if not (lower[cells[i, s]] <= value < upper[cells[i, s]]):
                    cells[i, s] = search(value, lower, firsts[s], firsts[s] + B - 1)
                    if not np.isfinite(value):
                        found |= 1 if np.isnan(value) else 2
    return found


@compiled
def count(cells, held, first, cell, times):
    """Lists the occupied cells of taps and the number of samples in each.

    Args:
        cells: Cell of each sample of n taps, shape (n, J K); -1 for one that does not count.
        held: Room for the counts of all cells, zero before and after.
        first: Receives where the list of each tap begins, shape (n + 1,) or more.
        cell: Receives the cells, shape (n J K,) or more.
        times: Receives the counts, shape (n J K,) or more.
    """
    end = 0
    first[0] = 0
    for i in range(len(cells)):
        begin = end
        for s in range(cells.shape[1]):
            c = cells[i, s]
            if c < 0:
                continue
            cell[end] = c  # stays only if the cell is a new one
            end += held[c] == 0
            held[c] += 1
        for e in range(begin, end):
            times[e], held[cell[e]] = held[cell[e]], 0
        first[i + 1] = end


@compiled
def multiply(first, cell, times, table, factor, out):
    """Writes `factor` times the product of histograms and a table to `out`.

    Args:
        first: Lists of n taps, with `cell` and `times` as `count` writes them.
        cell: Occupied cells.
        times: Their counts.
        table: Shape (cells, C).
        factor: A number.
        out: Shape (n, C).
    """
    n, C = out.shape
    for left in range(0, C, _COLUMNS):
        right = min(left + _COLUMNS, C)
        for i in range(n):
            row = out[i, left:right]
            row[:] = 0.0
            e, end = first[i], first[i + 1]
            while e + 4 <= end:  # four rows of the table at a time save three of four passes over `row`
                t0, t1, t2, t3 = times[e], times[e + 1], times[e + 2], times[e + 3]
                r0, r1 = table[cell[e], left:right], table[cell[e + 1], left:right]
                r2, r3 = table[cell[e + 2], left:right], table[cell[e + 3], left:right]
                for c in range(len(row)):
                    row[c] += t0 * r0[c] + t1 * r1[c] + t2 * r2[c] + t3 * r3[c]
                e += 4
            while e < end:
                t0, r0 = times[e], table[cell[e], left:right]
                for c in range(len(row)):
                    row[c] += t0 * r0[c]
                e += 1
            for c in range(len(row)):
                row[c] *= factor


@compiled
def add(first, cell, times, group, counts):
    """Adds the histograms of n taps to those of their groups.

    Args:
        first: Lists of the taps, with `cell` and `times` as `count` writes them.
        cell: Occupied cells.
        times: Their counts.
        group: Row of each tap in `counts`, shape (n,).
        counts: Changed in place, shape (groups, cells).
    """
    for i in range(len(group)):
        for e in range(first[i], first[i + 1]):
            counts[group[i], cell[e]] += np.int64(times[e])


@compiled
def add_rows(rows, group, total):
    """Adds rows to those of their groups, one after another.

    Args:
        rows: Shape (n, size).
        group: Row of each in `total`, shape (n,).
        total: Changed in place, shape (groups, size).
    """
    for i in range(len(group)):
        for s in range(rows.shape[1]):
            total[group[i], s] += rows[i, s]


@compiled
def add_bins(table, row, bins, total):
    """Writes the sum of a table's values at the bins of each tap.

    Args:
        table: Shape (C, K, B).
        row: Of each tap in the table, shape (n,).
        bins: Shape (n, J, K); one of -1 does not count.
        total: Receives the sums, shape (n,).
    """
    n, J, K = bins.shape
    for i in range(n):
        own, sum_ = table[row[i]], 0.0
        for j in range(J):
            for k in range(K):
                b = np.int64(bins[i, j, k])
                sum_ += own[k, b] if b >= 0 else 0.0
        total[i] = sum_
