"""Bins of sample values, histograms of taps, and their likelihood from tables; Eq. 1 and the text around Eq. 2."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from threading import Lock
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...blocks import over_blocks
from ...compiled import compiled
from ...errors import InputError

NOT_FINITE = "Samples must not be NaN or infinite."
_CHUNK = 1 << 24  # counts held at a time, 128 MiB
_PARTS = 256  # of the range of random numbers that draw bins
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
        samples: Shape (N, J, K); those that are NaN do not count.
        bins: Number of bins.
        value_range: `"global"` for one range over all taxels, `"taxel"` for one each.

    Returns:
        Shape (bins + 1,) or (K, bins + 1). A constant range is widened by half a unit to both sides; without any
        sample it is that around 0.

    Raises:
        InputError: The range is named otherwise.
    """
    if value_range not in ("global", "taxel"):
        raise InputError(f"value_range must be global or taxel, got {value_range!r}.")
    # Those that ignore NaN take more time.
    least, most = (np.fmin.reduce, np.fmax.reduce) if np.isnan(samples.sum()) else (np.min, np.max)
    low, high = least(least(samples, axis=0), axis=0), most(most(samples, axis=0), axis=0)  # axis by axis is faster
    if value_range == "global":
        low, high = least(low), most(high)
    low, high = np.nan_to_num(low), np.nan_to_num(high)
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
    found = find(rows, *layout, cells)
    bins = cells - np.arange(K) * (len(layout.lower) // K)
    return (np.where(cells < 0, -1, bins) if found else bins).reshape(samples.shape)


def known_bins(samples: NDArray[np.floating], edges: NDArray[np.float64], may_miss: bool = False) -> NDArray[np.intp]:
    """As `find_bins`.

    Raises:
        InputError: A sample is infinite or, unless it may be missing, NaN.
    """
    if (np.isinf(samples) if may_miss else ~np.isfinite(samples)).any():
        raise InputError(NOT_FINITE)
    return find_bins(samples, edges)


def count_taps(samples: NDArray[np.floating], edges: NDArray[np.float64]) -> Iterator[tuple[slice, SparseCounts]]:
    """Histograms of taps, in chunks of limited memory.

    Args:
        samples: Shape (N, J, K); those that are NaN do not count.
        edges: Shape (B + 1,) or (K, B + 1).

    Yields:
        Which taps these are, and their counts, which are overwritten by the next ones.

    Raises:
        InputError: A sample is infinite.
    """
    from .counting import find

    _, J, K = samples.shape
    layout = _layout(edges, K)

    def cells_of(part: NDArray[np.floating]) -> NDArray[np.int64]:
        cells = np.empty((len(part), J * K), dtype=np.int64)
        if find(_plain(part.reshape(len(part), J * K)), *layout, cells) > 1:
            raise InputError(NOT_FINITE)
        return cells

    yield from _counted(samples, cells_of, len(layout.lower))


def count_bins(bins: NDArray[np.integer], B: int) -> Iterator[tuple[slice, SparseCounts]]:
    """As `count_taps` from bins (N, J, K) of B for each taxel; a bin of -1 does not count."""
    _, J, K = bins.shape
    first = np.tile(np.arange(K) * B, J)

    def cells_of(part: NDArray[np.integer]) -> NDArray[np.int64]:
        part = part.reshape(len(part), J * K)
        cells = np.add(part, first, dtype=np.int64)
        return cells if part.dtype.kind == "u" else np.where(part < 0, -1, cells)

    yield from _counted(bins, cells_of, K * B)


def _counted(
    taps: NDArray[Any], cells_of: Callable[[NDArray[Any]], NDArray[np.int64]], most: int
) -> Iterator[tuple[slice, SparseCounts]]:
    """Counts of taps in chunks, from the cells of their samples, fewer than `most`."""
    from .counting import count

    N, J, K = taps.shape
    step = max(1, min(N, _SAMPLES // max(1, J * K)))
    held = np.zeros(most, dtype=np.int64)
    counts = SparseCounts(np.empty(step + 1, np.int64), np.empty(step * J * K, np.int64), np.empty(step * J * K))
    for start in range(0, N, step):
        cells = cells_of(taps[start : start + step])
        count(cells, held, *counts)
        yield slice(start, start + len(cells)), counts._replace(first=counts.first[: len(cells) + 1])


def class_counts(
    samples: Any, edges: NDArray[np.float64], own: NDArray[np.intp], shape: tuple[int, int, int, int]
) -> NDArray[np.int64]:
    """Samples of each class in each bin, of the given shape (L, M, K, B).

    Args:
        samples: Shape (N, J, K), in memory or on disk.
        edges: Bin edges, shape (B + 1,) or (K, B + 1).
        own: Class of each tap as l M + m, shape (N,).
        shape: (L, M, K, B).

    Raises:
        InputError: A sample is infinite.
    """
    from .counting import add

    L, M, K, B = shape
    counts, one_at_a_time = np.zeros((L * M, K * B), dtype=np.int64), Lock()

    def counted(block: NDArray[np.floating], taps: slice) -> None:
        for which, part in count_taps(block, edges):
            with one_at_a_time:
                add(*part, own[taps][which], counts)

    deque(over_blocks(samples, counted), maxlen=0)
    return counts.reshape(shape)


def tap_counts(bins: NDArray[np.intp], B: int) -> Iterator[NDArray[np.float64]]:
    """Occupation counts of each tap, shape (n, K B), in chunks of taps; a bin of -1 does not count."""
    N, _, K = bins.shape
    step = max(1, _CHUNK // (K * B))
    for start in range(0, N, step):
        part = bins[start : start + step]
        cells = ((np.arange(len(part))[:, None, None] * K + np.arange(K)) * B + part)[part >= 0]
        yield np.bincount(cells, minlength=len(part) * K * B).reshape(len(part), K * B).astype(np.float64)


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


class TableForm(NamedTuple):
    """Independent samples with one distribution over the bins per taxel; the product of Eq. 1 at power 1.

    Attributes:
        log_prob: log P_k(b | hypothesis), shape (L, H, K, B).
    """

    log_prob: NDArray[np.float64]

    @property
    def shape(self) -> tuple[int, int]:
        """(L, H)."""
        return self.log_prob.shape[0], self.log_prob.shape[1]

    exchangeable = True
    """Whether a tap may have any number of samples."""
    independent = True
    """Whether samples are independent under a hypothesis, so that some can be left out."""

    def in_state(self, gain: float, offset: float, edges: NDArray[np.float64]) -> Self:
        """Form of `gain` times a sample plus `offset`.

        Within a bin samples are taken for uniform. Where the range moves inwards, the bins left empty at its ends get
        the density of the end bin, so that no sample becomes impossible by the state alone.
        """
        from .moved_bins import move, pieces

        (K, B), moved = self.log_prob.shape[2:], np.empty_like(self.log_prob)
        for k, own in enumerate(np.broadcast_to(edges, (K, B + 1))):
            move(self.log_prob, k, *pieces(own, gain, offset), moved)
        return type(self)(moved)

    def prepare(self, impossible: NDArray[np.bool_]) -> "PreparedTable":
        """Precomputed form; hypotheses in the mask `impossible`, shape (L, H), have likelihood 0."""
        L, H, K, B = self.log_prob.shape
        table = self.log_prob.reshape(L * H, K * B).T.copy()
        table[:, impossible.ravel()] = -np.inf
        return PreparedTable(table, impossible.shape)

    def own(
        self, taps: NDArray[np.floating], edges: NDArray[np.float64], where: NDArray[np.intp], what: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Log probability of the bins of taps (N, J, K) under their own hypotheses, shape (N,)."""
        bins = known_bins(taps, edges, may_miss=True)
        return self.of_bins(bins, where, what)

    def of_bins(self, bins: NDArray[np.intp], where: NDArray[np.intp], what: NDArray[np.intp]) -> NDArray[np.float64]:
        """Log probability of bins (N, J, K) under hypotheses (N,), shape (N,); a bin of -1 does not count."""
        from .counting import add_bins

        total, rows = np.empty(len(bins)), self.log_prob.reshape(-1, *self.log_prob.shape[2:])
        add_bins(np.ascontiguousarray(rows), where * self.shape[1] + what, bins, total)
        return total

    def sample(
        self,
        where: NDArray[np.intp],
        what: NDArray[np.intp],
        edges: NDArray[np.float64],
        J: int,
        generator: np.random.Generator,
    ) -> NDArray[np.float64]:
        """Taps of `J` samples under hypotheses (N,), at the centres of their bins, shape (N, J, K).

        Raises:
            InputError: A hypothesis has no distribution.
        """
        K, B = self.log_prob.shape[2:]
        edges = np.broadcast_to(edges, (K, B + 1))
        centre = 0.5 * (edges[:, :-1] + edges[:, 1:])
        return centre.ravel()[self.sample_bins(where, what, J, generator) + np.arange(K) * B]

    def sample_bins(
        self, where: NDArray[np.intp], what: NDArray[np.intp], J: int, generator: np.random.Generator
    ) -> NDArray[np.uint32]:
        """Bins of taps as in `sample`, shape (N, J, K); raises as `sample`."""
        K, H = self.log_prob.shape[2], self.log_prob.shape[1]
        used, row = np.unique(where * H + what, return_inverse=True)
        cumulative = np.exp(self.log_prob[used // H, used % H]).cumsum(axis=-1)
        if not (cumulative[..., -1] > 0).all():
            raise InputError("A tap cannot be drawn from a class without a distribution.")
        begin = np.empty((*cumulative.shape[:2], _PARTS), dtype=np.uint32)
        _begin(cumulative, begin)
        bins = np.empty((len(where), J, K), dtype=np.uint32)
        step = max(1, _SAMPLES // max(1, J * K))
        for i in range(0, len(where), step):  # random numbers stay in the cache
            own = row[i : i + step]
            _draw(cumulative, begin, own, generator.random((len(own), K, J)), bins[i : i + step])
        return bins

    @staticmethod
    def joined(parts: Sequence["TableForm"]) -> "TableForm":
        """Form over the hypotheses of several forms, one after another."""
        return TableForm(np.concatenate([part.log_prob for part in parts], axis=1))


class PreparedTable(NamedTuple):
    """Precomputed `TableForm`.

    Attributes:
        table: Log probabilities from cells to hypotheses, shape (K B, L H).
        shape: (L, H).
    """

    table: NDArray[np.float64]
    shape: tuple[int, ...]

    def log_likelihood(
        self, taps: NDArray[np.floating], edges: NDArray[np.float64], exponent: float, out: NDArray[np.float64]
    ) -> None:
        """Writes `exponent` times the log probability of the bins of taps (N, J, K) to `out`, shape (N, L, H).

        Taps are counted and multiplied in chunks, so that nothing but the result has to fit into memory, and with
        `out` on disk not even that.
        """
        self._write(count_taps(taps, edges), exponent, out)

    def of_bins(self, bins: NDArray[np.integer], exponent: float) -> NDArray[np.float64]:
        """`exponent` times the log probability of bins (N, J, K), shape (N, L, H); a bin of -1 does not count."""
        out = np.empty((len(bins), *self.shape))
        self._write(count_bins(bins, len(self.table) // bins.shape[2]), exponent, out)
        return out

    def _write(self, counted: Iterator[tuple[slice, SparseCounts]], exponent: float, out: NDArray[np.float64]) -> None:
        from .counting import multiply

        for which, counts in counted:
            part = np.empty((len(counts.first) - 1, self.table.shape[1]))
            multiply(*counts, self.table, exponent, part)
            if (empty := np.diff(counts.first) == 0).any():
                part[empty] = np.where(np.isneginf(self.table).all(axis=0), -np.inf, 0.0)
            out[which] = part.reshape(-1, *self.shape)


@compiled
def _begin(cumulative: NDArray[np.float64], begin: NDArray[np.uint32]) -> None:
    """Writes from which bin on random numbers in each of `_PARTS` equal parts of the whole are searched, (C, K, parts).

    That is the one in which the part begins, or one before where rounding may matter; of so many parts few hold the end
    of a bin.
    """
    C, K, B = cumulative.shape
    for c in range(C):
        for k in range(K):
            b = 0
            for part in range(_PARTS):
                while b < B - 1 and cumulative[c, k, b] * _PARTS <= part * (1 - 1e-12) * cumulative[c, k, B - 1]:
                    b += 1
                begin[c, k, part] = b


@compiled
def _draw(
    cumulative: NDArray[np.float64],
    begin: NDArray[np.uint32],
    row: NDArray[np.intp],
    uniform: NDArray[np.float64],
    bins: NDArray[np.uint32],
) -> None:
    """Writes bins (N, J, K) for random numbers (N, K, J) under cumulative distributions (C, K, B)."""
    _, K, B = cumulative.shape
    N, _, J = uniform.shape
    for i in range(N):
        for k in range(K):
            upto = cumulative[row[i], k]
            for j in range(J):
                value = uniform[i, k, j] * upto[B - 1]
                b = begin[row[i], k, np.uint32(uniform[i, k, j] * _PARTS)]
                while b < B - 1 and upto[b] <= value:
                    b += 1
                bins[i, j, k] = b
