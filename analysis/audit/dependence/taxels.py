"""Dependence between taxels within a class at a fixed sample: three permutation tests of every pair.

``rank``      Spearman's rho at fixed sample, mean over strata and samples; sees what moves two taxels monotonically.
``distance``  bias-corrected distance correlation (Szekely and Rizzo, "The distance correlation t-test of
              independence in high dimension", 2013); sees any dependence, also a common change of spread.
``table``     G of a table of quantile bins; its effect is mutual information in nats per sample, less what permuted
              taps have.

All three are means over strata, weighted by taps. Every taxel's taps are permuted independently of the other taxels',
all samples of a tap together, so that dependence in time does not count.
"""

from collections.abc import Callable
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ....models.compiled import compiled, ones
from ....models.errors import InputError
from ....models.vectors import copy
from .permutation import (
    Floats,
    Permuted,
    Statistic,
    Strata,
    bootstrap_weights,
    checked,
    checked_level,
    false_discovery,
    mean_ranks,
    percentiles,
    permutation_test,
    permuted,
    product_sums,
    ratio,
    spread_samples,
    unit_residuals,
)

TESTS = ("rank", "distance", "table")
EFFECTS = ("rank correlation", "distance correlation, bias-corrected", "mutual information (nats per sample)")
BINS = 4
"""Quantile bins of the table; fewer, n // 2, in strata of fewer than 8 taps."""
LEAST_TAPS = (2, 4, 4)  # of a stratum, below which a test says nothing
_MOST_TAPS = 300  # of a stratum whose distances are taken: their number grows with the square
_DISTANCE_WORK = 2.5e10  # products of distances in all permutations, some seconds
_PAIRS_AT_ONCE = 4096  # of taxels, whose effects are resampled together
_FEWEST_PERMUTATIONS = 199
_NO_DISTANCE = 1e-9
_WORD = 32  # taps of a mask that lie in one number
_SIDE_BY_SIDE = 64  # permutations whose masks fill vector registers together
_SUMS = 1 << 16  # sums of terms worth a table, which the cache holds


class _Prepared(NamedTuple):
    """A test in one stratum of n taps: its statistic, and of each taxel and sample whether it says anything."""

    statistic: Statistic
    varies: NDArray[np.bool_]


def taxel_dependence(
    taps: ArrayLike,
    stratum: ArrayLike,
    *,
    permutations: int = 999,
    samples: int = 10,
    alpha: float = 0.05,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
    together: ArrayLike | None = None,
) -> xr.Dataset:
    """Tests of dependence of all pairs of taxels, with effect sizes.

    Args:
        taps: Shape (N, J, K).
        stratum: Class and session of each tap as one number, shape (N,); taps alone in their stratum drop out.
        permutations: P; the distance test takes fewer where there are many taps, at least 199, as the result says.
        samples: At most how many samples the distance and table tests look at, spread over the tap; the rank test looks
            at all.
        alpha: Level; false discovery rate of the map.
        seed: Of permutations and resamples.
        progress: Called after every stratum.
        together: A label of each tap, the same throughout a stratum, shape (N,): strata of one label and as many taps
            are permuted alike, as what disturbs one of them may disturb the others; by default each by itself.

    Returns:
        Dims test (`TESTS`), taxel, other (K each). Of every pair, NaN where a taxel is dead or the two never vary
        in the same stratum: ``effect`` with its 95% interval ``effect_low`` and ``effect_high`` over resampled strata,
        standardised statistic ``z``, ``p``, ``q`` (Benjamini and Hochberg), ``rejected`` (q at most alpha).
        Of every test: ``family_z`` and ``family_p`` of the largest statistic of all pairs, ``pairs`` tested,
        ``rejected_fraction`` of them, ``mean_absolute`` effect with its interval and ``mean_absolute_null``, what
        permuted taps have, ``permutations``, ``strata``, ``taps`` and ``samples`` used, and ``reason``, empty or why
        there is no result. Of every taxel: ``dead``, and ``taxel_effect``, the mean absolute effect of its pairs.

    Raises:
        InputError: Sizes do not fit together, a value is not finite, or an option lies outside its range.
    """
    values, strata = checked(taps, stratum, permutations)
    alpha = checked_level(alpha)
    K = values.shape[2]
    live = _live(values, strata)
    if samples < 1:
        raise InputError(f"Tests of taxels look at at least one sample of a tap, got {samples}.")
    chosen = spread_samples(values.shape[1], samples)
    first, second = (live[side] for side in np.triu_indices(len(live), 1))
    result = _empty(K, live, alpha, seed)
    if not len(first) or not values.shape[1]:
        result["reason"].values[:] = _reason(values, strata, live)
        return result
    used = permutations, _distance_permutations(permutations, strata, len(live), len(chosen)), permutations
    alike = None if together is None else np.unique(together, return_inverse=True)[1][[own[0] for own in strata]]
    counts, found = _permuted(values[:, :, live], strata, chosen, used, seed, progress, alike)
    for t in range(len(TESTS)):
        _fill(result, t, found[t], counts[t], (first, second))
        result["permutations"].values[t] = used[t]
        takes = [len(own) for own, weight in zip(strata, counts[t], strict=True) if weight.any()]
        result["strata"].values[t], result["taps"].values[t] = len(takes), sum(takes)
        result["samples"].values[t] = values.shape[1] if t == 0 else len(chosen)
    return result


def _live(values: Floats, strata: Strata) -> NDArray[np.intp]:
    varies = np.zeros(values.shape[2], dtype=bool)
    for own in strata:
        varies |= (np.ptp(values[own], axis=0) > 0).any(axis=0)
    return np.flatnonzero(varies)


def _reason(values: Floats, strata: Strata, live: NDArray[np.intp]) -> str:
    if not strata:
        return "no stratum has two taps"
    if not values.shape[1]:
        return "taps have no samples"
    if values.shape[2] < 2:
        return "there is one taxel only"
    return f"{len(live)} of {values.shape[2]} taxels vary within a stratum"


def _distance_permutations(permutations: int, strata: Strata, K: int, samples: int) -> int:
    """So many that the test takes seconds."""
    distances = sum(min(len(own), _MOST_TAPS) ** 2 / 2 for own in strata) * samples
    one = distances * (8 * K + K * (K - 1) / 2)
    return int(np.clip(_DISTANCE_WORK / max(one, 1.0), min(permutations, _FEWEST_PERMUTATIONS), permutations))


def _permuted(
    values: Floats,
    strata: Strata,
    chosen: NDArray[np.intp],
    used: tuple[int, int, int],
    seed: int,
    progress: Callable[[int], None] | None,
    together: NDArray[np.intp] | None,
) -> tuple[list[Floats], list[Permuted]]:
    """Weights of every stratum and pair of live taxels (S, G) and permuted statistics, for each test."""
    first, second = np.triu_indices(values.shape[2], 1)
    counts = [np.zeros((len(strata), len(first))) for _ in TESTS]

    def prepare(s: int, own: NDArray[np.intp]) -> list[Statistic | None]:
        statistics = []
        ranks = mean_ranks(values[own])
        for t, part in enumerate((_ranks(ranks), _distances(values[own][:, chosen]), _tables(ranks[:, chosen]))):
            if part is not None:
                both = part.varies.astype(np.float64)
                counts[t][s] = len(own) * (both.T @ both)[first, second]
            statistics.append(None if part is None else part.statistic)
        return statistics

    found = permuted(strata, values.shape[2], prepare, [len(first)] * len(TESTS), used, seed, progress, together)
    return counts, found


def _ranks(ranks: Floats) -> _Prepared:
    """Of ranks of values, shape (n, J, K)."""
    units = unit_residuals(ranks)
    first, second = np.triu_indices(ranks.shape[2], 1)
    columns = np.sqrt(len(ranks)) * units.transpose(2, 0, 1)
    return _Prepared(product_sums(columns, first, second, np.arange(len(first))), (units != 0).any(axis=0))


def _distances(values: Floats) -> _Prepared | None:
    """Of values (n, samples, K)."""
    if len(values) < LEAST_TAPS[1]:
        return None
    weight = float(len(values))
    kept = spread_samples(len(values), _MOST_TAPS)
    matrices = unit_distances(values[kept].transpose(2, 1, 0))
    varies = (matrices != 0).any(axis=(2, 3)).T
    (K, S, n, _) = matrices.shape
    packed = np.zeros((K, n, n, S + S % 2), dtype=np.float32)  # samples side by side, to be copied two at a time
    packed[..., :S] = matrices.transpose(0, 2, 3, 1)

    def statistic(permutation: NDArray[np.int32]) -> Floats:
        if len(kept) < len(values):  # the order of what stands at the kept places permutes as many
            permutation = permutation[:, :, kept].argsort(axis=2).astype(np.int32)
        total = np.empty((K * (K - 1) // 2, permutation.shape[1]))
        _distance_sums(packed.view(np.float64), permutation, total)
        return weight * total

    return _Prepared(statistic, varies)


def unit_distances(values: Floats) -> Floats:
    """U-centred distances between values on the last axis, whose products over i < j sum to a correlation.

    Args:
        values: Shape (..., n), n at least 3.

    Returns:
        Shape (..., n, n); 0 where there is nothing but the centre.
    """
    n = values.shape[-1]
    distance = np.abs(values[..., :, np.newaxis] - values[..., np.newaxis, :])
    row = distance.sum(axis=-1)
    largest = distance.max(axis=(-2, -1), initial=0.0)
    centre = row.sum(axis=-1)[..., np.newaxis, np.newaxis] / ((n - 1) * (n - 2))
    distance += centre - (row[..., :, np.newaxis] + row[..., np.newaxis, :]) / (n - 2)
    distance[..., np.arange(n), np.arange(n)] = 0.0
    length = np.sqrt((distance**2).sum(axis=(-2, -1)) / 2)
    varies = length > _NO_DISTANCE * largest
    return np.where(varies[..., None, None], distance / np.where(varies, length, 1.0)[..., None, None], 0.0)


@compiled
def _distance_sums(pairs: Floats, permutation: NDArray[np.int32], total: Floats) -> None:
    """Sums of products of distances, from those of single precision, (K, n, n, S), two of which are one number here."""
    K, n, _, size = pairs.shape
    rows = np.empty((K, n * (n - 1) // 2 * size))
    row = rows.view(np.float32)
    for p in range(permutation.shape[1]):
        to = 0
        for k in range(K):
            for i in range(1, n):
                first = (k * n + np.int64(np.uint32(permutation[k, p, i]))) * n
                for j in range(i):
                    copy(rows, to, pairs, (first + np.int64(np.uint32(permutation[k, p, j]))) * size, size)
                    to += size
        g = 0
        for k in range(K):
            for m in range(k + 1, K):
                product = np.float32(0.0)
                for f in range(row.shape[1]):
                    product += row[k, f] * row[m, f]
                total[g, p] = product
                g += 1


def quantile_bins(ranks: Floats, bins: int) -> NDArray[np.uint8]:
    """The bin of each rank of (n, ...) among those of the first axis; equal ones share a bin."""
    return np.minimum(((ranks - 0.5) * (bins / len(ranks))).astype(np.intp), bins - 1).astype(np.uint8)


def _tables(ranks: Floats) -> _Prepared | None:
    """Of ranks (n, samples, K)."""
    n = len(ranks)
    if n < LEAST_TAPS[2]:
        return None
    bins = min(BINS, n // 2)
    binned = quantile_bins(ranks, bins)
    varies = binned.max(axis=0) > binned.min(axis=0)
    columns = np.ascontiguousarray(binned.transpose(2, 0, 1))
    number = np.arange(n + 1.0)
    terms = number * np.log(np.maximum(number, 1.0))
    held = (columns[..., np.newaxis] == np.arange(bins)).sum(axis=1)
    margin = terms[held].sum(axis=2)
    alive = np.ascontiguousarray(varies.T)
    first, second = np.triu_indices(ranks.shape[2], 1)
    constant = ((alive[first] & alive[second]) * (terms[n] - margin[first] - margin[second])).sum(axis=1)
    base = int(held[alive].max(initial=0)) + 1
    cells = next(cells for cells in (bins, 2, 1) if cells == 1 or base**cells <= _SUMS)
    sums = reduce(np.add.outer, [terms[:base]] * cells).ravel()

    def statistic(permutation: NDArray[np.int32]) -> Floats:
        total = np.empty((len(first), permutation.shape[1]))
        _table_sums(columns, alive, permutation, bins, base, cells, sums, total)
        return total + constant[:, np.newaxis]

    return _Prepared(statistic, varies)


@compiled
def _put_masks(
    columns: NDArray[np.uint8], permutation: NDArray[np.int32], placed: NDArray[np.uint32], mask: NDArray[np.uint32]
) -> None:
    """Writes which permuted taps (K, P, n) are in each bin: bit i % 32 of word i // 32 of (K, S, bins, words, P).

    The same of single taps, (n, words, P), is written to `placed` on the way.
    """
    K, n, S = columns.shape
    mask[:] = 0
    for k in range(K):
        placed[:] = 0
        for p in range(permutation.shape[1]):
            for i in range(n):
                placed[np.uint32(permutation[k, p, i]), i // _WORD, p] = np.uint32(1) << np.uint32(i % _WORD)
        for s in range(S):
            for a in range(n):
                one = mask[k, s, columns[k, a, s]]
                for w in range(placed.shape[1]):
                    for p in range(_SIDE_BY_SIDE):
                        one[w, p] |= placed[a, w, p]


@compiled
def _table_sums(
    columns: NDArray[np.uint8],
    alive: NDArray[np.bool_],
    permutation: NDArray[np.int32],
    bins: int,
    base: int,
    cells: int,
    sums: Floats,
    total: Floats,
) -> None:
    """Sums of terms of the counts in every cell of the tables of all pairs.

    A bin is a mask of the taps in it, a count the bits that two masks share.

    Args:
        columns: Bins, shape (K, n, S).
        alive: Shape (K, S); other samples count nothing.
        permutation: Shape (K, P, n).
        bins: How many there are.
        base: No count is as large.
        cells: How many counts, a divisor of `bins`, are looked up together.
        sums: Sum of the terms of so many counts, the digits of a number to that base, shape (base ** cells,).
        total: Written to, shape (K (K - 1) / 2, P).
    """
    K, n, S = columns.shape
    P = permutation.shape[1]
    words = (n + _WORD - 1) // _WORD
    # Room for an odd number of words, as masks a power of two apart would push each other out of the cache.
    mask = np.empty((K, S, bins, words | 1, _SIDE_BY_SIDE), dtype=np.uint32)
    placed = np.empty((n, words, _SIDE_BY_SIDE), dtype=np.uint32)
    index = np.zeros(_SIDE_BY_SIDE, dtype=np.uint32)
    found = np.empty(_SIDE_BY_SIDE)
    for start in range(0, P, _SIDE_BY_SIDE):
        here = min(_SIDE_BY_SIDE, P - start)
        _put_masks(columns, permutation[:, start : start + here], placed, mask)
        g = 0
        for k in range(K):
            for m in range(k + 1, K):
                found[:] = 0.0
                for s in range(S):
                    if alive[k, s] and alive[m, s]:
                        for c in range(bins * bins):
                            place = np.uint32(base ** (c % cells))
                            for w in range(words):
                                one, other = mask[k, s, c // bins, w], mask[m, s, c % bins, w]
                                for p in range(_SIDE_BY_SIDE):
                                    index[p] += place * ones(one[p] & other[p])
                            if c % cells == cells - 1:
                                for p in range(_SIDE_BY_SIDE):
                                    found[p] += sums[index[p]]
                                index[:] = 0
                for p in range(here):
                    total[g, start + p] = found[p]
                g += 1


def _empty(K: int, live: NDArray[np.intp], alpha: float, seed: int) -> xr.Dataset:
    """A result without any test."""
    pair, one = ("test", "taxel", "other"), ("test",)
    nothing, of_tests = np.full((len(TESTS), K, K), np.nan), np.full(len(TESTS), np.nan)
    variables: dict[str, Any] = {
        name: (pair, nothing.copy()) for name in ("effect", "effect_low", "effect_high", "z", "p", "q")
    }
    variables["rejected"] = (pair, np.zeros(nothing.shape, dtype=bool))
    variables["taxel_effect"] = (("test", "taxel"), nothing[:, 0].copy())
    variables["dead"] = (("taxel",), ~np.isin(np.arange(K), live))
    averages = ("mean_absolute", "mean_absolute_low", "mean_absolute_high", "mean_absolute_null")
    variables |= {name: (one, of_tests.copy()) for name in ("family_z", "family_p", "rejected_fraction", *averages)}
    whole = ("pairs", "permutations", "strata", "taps", "samples")
    variables |= {name: (one, np.zeros(len(TESTS), dtype=np.int64)) for name in whole}
    variables["reason"] = (one, np.full(len(TESTS), "", dtype=object))
    coords = {"test": list(TESTS), "effect_unit": ("test", list(EFFECTS)), "taxel": np.arange(K), "other": np.arange(K)}
    return xr.Dataset(variables, coords, {"alpha": alpha, "seed": seed})


def _resampled(observed: Floats, weight: Floats, seed: int) -> tuple[Floats, Floats, Floats]:
    """Intervals of the effects over resampled strata, shapes (G,), and mean absolute effects of each resample, (R,)."""
    resample, pairs = bootstrap_weights(len(weight), seed), weight.shape[1]
    low, high = np.empty((2, pairs))
    total, number = np.zeros((2, len(resample)))
    for start in range(0, pairs, _PAIRS_AT_ONCE):
        some = slice(start, start + _PAIRS_AT_ONCE)
        effect = ratio(observed[:, some], weight[:, some], resample)
        low[some], high[some] = percentiles(effect, len(weight))
        total += np.nansum(np.abs(effect), axis=1)
        number += np.isfinite(effect).sum(axis=1)
    return low, high, total / np.where(number > 0, number, np.nan)


def _fill(
    result: xr.Dataset,
    t: int,
    found: Permuted,
    weight: Floats,
    pairs: tuple[NDArray[np.intp], NDArray[np.intp]],
) -> None:
    """Writes what one test found into the result."""
    tested, used = weight.any(axis=0), weight.any(axis=1)
    if not tested.any():
        result["reason"].values[t] = f"no stratum has {LEAST_TAPS[t]} taps in which two taxels vary"
        return
    side, other = (index[tested] for index in pairs)
    weight, total = weight[np.ix_(used, tested)], found.total[tested]
    observed, expected = (values[np.ix_(used, tested)] for values in (found.observed, found.expected))
    if TESTS[t] == "table":
        observed = observed - expected
    test = permutation_test(total, two_sided=TESTS[t] == "rank")
    effect = ratio(observed, weight)
    low, high, spread = _resampled(observed, weight, int(result.attrs["seed"]))
    q = false_discovery(test.p)
    rejected = q <= result.attrs["alpha"]
    named = {"effect": effect, "effect_low": low, "effect_high": high, "z": test.z, "p": test.p, "q": q}
    for name, value in (named | {"rejected": rejected}).items():
        result[name].values[t, side, other] = result[name].values[t, other, side] = value
    absolute = np.abs(result["effect"].values[t])
    counted = np.isfinite(absolute).sum(axis=1)
    result["taxel_effect"].values[t] = np.where(counted > 0, np.nansum(absolute, axis=1), np.nan) / np.maximum(
        counted, 1
    )
    null = (total[:, 1:] - total[:, 1:].mean(axis=1, keepdims=True)) / weight.sum(axis=0)[:, np.newaxis]
    mean = np.abs(effect).mean()
    below, above = (float(end[0]) for end in percentiles(spread[:, np.newaxis], len(weight)))
    one = {
        "family_z": test.family_z,
        "family_p": test.family_p,
        "rejected_fraction": rejected.mean(),
        "mean_absolute": mean,
        "mean_absolute_low": max(0.0, min(below, 2 * mean - above)),
        "mean_absolute_high": max(above, 2 * mean - below),
        "mean_absolute_null": np.abs(null).mean(),
        "pairs": len(side),
    }
    for name, value in one.items():
        result[name].values[t] = value
