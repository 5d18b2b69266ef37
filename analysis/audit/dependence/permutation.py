"""Shared parts of the tests of dependence within a class: strata, ranks, residuals, permutations, intervals.

A stratum is a group of taps that come in no particular order under the null: those of one class and session. Whole taps
are permuted within strata, so that the course of a tap, the same for all taps of a class, is conditioned away. Columns
of values, taxels or samples, are permuted independently of each other; every statistic here is a sum over strata, and
one set of permutations gives the null of all of them together.

Observed and permuted values are exchangeable under the null, and are treated alike: the observed one is the first of
1 + P, means and standard deviations are those of all, and p = (1 + number of permuted at least as large) / (1 + P)
(Phipson and Smyth, "Permutation P-values should never be zero", 2010). So levels hold at any size.
"""

import math
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....models import seeds
from ....models.compiled import compiled
from ....models.errors import InputError
from ....models.threads import cores, in_order
from ...stats.metrics import CONFIDENCE
from ...stats.pairing import RESAMPLES

type Floats = NDArray[np.float64]
type Strata = list[NDArray[np.intp]]
type Statistic = Callable[[NDArray[np.int32]], Floats]
"""Gives sums of G groups, shape (G, P), for permutations of shape (columns, P, taps of the stratum)."""

FEWEST_STRATA = 5
"""From fewer strata there are no intervals: resamples of so few hardly differ."""
_BLOCK = 1 << 22  # indices of permutations at a time, 16 MiB
_WAITING = 1 << 28  # bytes of statistics of strata that a thread may hold, three strata or so each
_EQUAL = 1e-9  # share of a taxel's range below which values are the same but for rounding
_DEFINED = 0.95  # of the resamples: an interval from fewer would be that of the lucky ones
_TIE = 1e-9  # of standardised statistics
_GRAM = 8  # products of whole taps are worth a table of them up to so many taps per value of a tap


class Permuted(NamedTuple):
    """A statistic of G groups over S strata, as observed and permuted.

    Attributes:
        total: Sums over strata, the first one observed, shape (G, 1 + P).
        observed: Of each stratum, shape (S, G).
        expected: Mean over permutations of each stratum, shape (S, G).
    """

    total: Floats
    observed: Floats
    expected: Floats


class Tested(NamedTuple):
    """A permutation test of G groups and of all of them together.

    Attributes:
        z: Standardised statistic, 0 where it is the same in all permutations, shape (G,).
        p: Shape (G,).
        family_z: Largest of the statistics, in absolute value where the test is two-sided.
        family_p: Probability of so large a largest one.
    """

    z: Floats
    p: Floats
    family_z: float
    family_p: float


def checked(taps: ArrayLike, stratum: ArrayLike, permutations: int) -> tuple[Floats, Strata]:
    """Taps and their strata of two taps or more, in the order of the labels.

    Args:
        taps: Shape (N, J, K).
        stratum: Label of each tap, shape (N,).
        permutations: At least one.

    Returns:
        The taps, shape (N, J, K), values that differ by rounding only made equal; indices of the taps of each stratum.

    Raises:
        InputError: Sizes do not fit together, a value is not finite, or nothing is permuted.
    """
    taps, stratum = np.asarray(taps, dtype=np.float64), np.asarray(stratum)
    if taps.ndim != 3 or stratum.shape != taps.shape[:1]:
        raise InputError(
            f"Taps of shape (N, J, K) need a stratum each, got shapes {taps.shape} and {stratum.shape} of strata."
        )
    if not np.isfinite(taps).all():
        raise InputError("A sample of the taps is NaN or infinite.")
    if permutations < 1:
        raise InputError(f"A permutation test needs at least one permutation, got {permutations}.")
    if taps.size:
        span = np.ptp(taps, axis=(0, 1))
        taps = np.round(taps / np.where(span > 0, _EQUAL * span, 1.0))
    _, label = np.unique(stratum, return_inverse=True)
    order = np.argsort(label, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(label[order])) + 1) if len(order) else []
    return taps, [group for group in groups if len(group) > 1]


def checked_level(alpha: float) -> float:
    """The level of a test.

    Raises:
        InputError: It is no probability between 0 and 1.
    """
    if not 0 < alpha < 1:
        raise InputError(f"The level of a test lies between 0 and 1, got {alpha}.")
    return alpha


def unit_residuals(values: Floats) -> Floats:
    """Values of one stratum less their mean over taps, of unit length over taps, 0 where constant; shape (n, ...)."""
    centred = values - values.mean(axis=0)
    length = np.sqrt((centred**2).sum(axis=0))
    varies = values.max(axis=0) > values.min(axis=0)
    return np.where(varies, centred / np.where(varies, length, 1.0), 0.0)


def mean_ranks(values: Floats) -> Floats:
    """Ranks along the first axis from 1 on, equal values sharing their mean rank; SciPy's take long to import.

    Products of their `unit_residuals` sum to Spearman's rho.
    """
    ranks = np.ones(values.shape)
    _add_ranks(np.ascontiguousarray(values).reshape(len(values), -1), ranks.reshape(len(values), -1))
    return ranks


@compiled
def _add_ranks(values: Floats, ranks: Floats) -> None:
    """Adds to each rank the number of smaller values and half of the other equal ones, all columns at once, (n, C).

    Every pair of rows is compared, which vector instructions do faster than they sort the few taps of a stratum.
    """
    n, C = values.shape
    for i in range(n):
        for j in range(i):
            for c in range(C):
                above = 1.0 if values[i, c] > values[j, c] else 0.5 if values[i, c] == values[j, c] else 0.0
                ranks[i, c] += above
                ranks[j, c] += 1.0 - above


def spread_samples(J: int, samples: int) -> NDArray[np.intp]:
    """At most `samples` sample numbers, the middles of equal parts of a tap."""
    n = min(J, samples)
    return ((np.arange(n) + 0.5) * (J / max(n, 1))).astype(np.intp)


def product_sums(
    units: Floats, first: NDArray[np.intp], second: NDArray[np.intp], group: NDArray[np.intp]
) -> Statistic:
    """Products of pairs of columns, summed over the taps of one stratum, and over the pairs of a group.

    Args:
        units: Values, shape (columns, n, values of a column and tap).
        first: First column of each pair.
        second: Second column.
        group: Group of each pair, 0 .. G - 1.
    """
    units = np.ascontiguousarray(units)
    across = np.ascontiguousarray(units.swapaxes(1, 2))
    G = int(group.max()) + 1

    def statistic(permutation: NDArray[np.int32]) -> Floats:
        total = np.zeros((G, permutation.shape[1]))
        _add_products(units, across, permutation, first, second, group, total)
        return total

    return statistic


@partial(compiled, in_order=True)  # sums in another order would be by vectors, and gathering these takes longer
def _add_products(
    units: Floats,
    across: Floats,
    permutation: NDArray[np.int32],
    first: NDArray[np.intp],
    second: NDArray[np.intp],
    group: NDArray[np.intp],
    total: Floats,
) -> None:
    """Adds the products of `product_sums`; `across` is `units` with the last two axes swapped."""
    _, n, F = units.shape
    P, size = permutation.shape[1], np.uint32(n)  # unsigned indices save the check whether they count from the end
    tabled = n <= _GRAM * F
    gram = np.empty((n, n) if tabled else (1, 1))
    products = gram.reshape(gram.size)
    for pair in range(len(first)):
        c, d, g = first[pair], second[pair], group[pair]
        if tabled:
            for a in range(n):
                for b in range(n):
                    gram[a, b] = 0.0
                for f in range(F):
                    for b in range(n):
                        gram[a, b] += units[c, a, f] * across[d, f, b]
            for p in range(P):
                product = 0.0
                for i in range(n):
                    product += products[np.uint32(permutation[c, p, i]) * size + np.uint32(permutation[d, p, i])]
                total[g, p] += product
        else:
            for p in range(P):
                product = 0.0
                for i in range(n):
                    a, b = np.uint32(permutation[c, p, i]), np.uint32(permutation[d, p, i])
                    for f in range(F):
                        product += units[c, a, f] * units[d, b, f]
                total[g, p] += product


def _words(generator: np.random.Generator, shape: tuple[int, int, int]) -> NDArray[np.uint32]:
    """What `generator.integers` gives for all 32 bits, in half the time where the numbers of 64 bits are used whole."""
    size, bits = math.prod(shape), generator.bit_generator
    if size % 2 or bits.state["has_uint32"] or sys.byteorder != "little":
        return generator.integers(1 << 32, size=shape, dtype=np.uint32)
    return bits.random_raw(size // 2).view(np.uint32).reshape(shape)


@compiled
def _shuffle(word: NDArray[np.uint32], permutation: NDArray[np.int32]) -> None:
    """Permutations along the last axis from 32 random bits each (Fisher and Yates; Durstenfeld 1964)."""
    C, P, n = word.shape
    for c in range(C):
        for p in range(P):
            for i in range(n):
                permutation[c, p, i] = i
            for i in range(n - 1, 0, -1):
                other = np.int64((np.uint64(word[c, p, i]) * np.uint64(i + 1)) >> np.uint64(32))
                kept = permutation[c, p, i]
                permutation[c, p, i] = permutation[c, p, other]
                permutation[c, p, other] = kept


def permuted(
    strata: Strata,
    columns: int,
    prepare: Callable[[int, NDArray[np.intp]], Sequence[Statistic | None]],
    groups: Sequence[int],
    permutations: Sequence[int],
    seed: int,
    progress: Callable[[int], None] | None = None,
    together: ArrayLike | None = None,
) -> list[Permuted]:
    """Statistics of permuted taps, the columns of every stratum permuted independently of each other.

    Args:
        strata: Taps of each stratum.
        columns: How many columns there are.
        prepare: Gives the statistics of a stratum from its number and taps, None for one that the stratum says nothing
            about; strata are prepared on several threads.
        groups: G of each statistic.
        permutations: P of each statistic; one with fewer takes the first of the others'.
        seed: Of the permutations.
        progress: Called after every stratum.
        together: A label of each stratum, shape (S,): those of one label and as many taps are permuted alike; by
            default each by itself.
    """
    stream, purpose = np.arange(len(strata)), seeds.Purpose.PERMUTATIONS
    if together is not None:
        stream, purpose = np.asarray(together), seeds.Purpose.ALIKE
    most = max(permutations)

    def of_stratum(s: int) -> list[Permuted | None]:
        own, generator = strata[s], seeds.generator(seed, purpose, int(stream[s]))
        statistics = prepare(s, own)
        found = [
            None if statistic is None else Permuted(np.empty((G, 1 + P)), np.empty(G), np.zeros(G))
            for statistic, G, P in zip(statistics, groups, permutations, strict=True)
        ]
        block = max(1, _BLOCK // max(1, columns * len(own)))
        for start in range(0, 1 + most, block):
            stop = min(start + block, 1 + most)
            word = _words(generator, (columns, stop - start, len(own)))
            permutation = np.empty(word.shape, dtype=np.int32)
            _shuffle(word, permutation)
            if start == 0:
                permutation[:, 0] = np.arange(len(own))
            for one, statistic, P in zip(found, statistics, permutations, strict=True):
                if one is None or statistic is None or start > P:
                    continue
                values = statistic(np.ascontiguousarray(permutation[:, : 1 + P - start]))
                one.total[:, start : start + values.shape[1]] = values
                one.expected[:] += values[:, int(start == 0) :].sum(axis=1) / P
                if start == 0:
                    one.observed[:] = values[:, 0]
        return found

    sums = [
        Permuted(np.zeros((G, 1 + P)), np.zeros((len(strata), G)), np.zeros((len(strata), G)))
        for G, P in zip(groups, permutations, strict=True)
    ]
    size = sum(one.total.nbytes for one in sums)
    tasks = (partial(of_stratum, s) for s in range(len(strata)))
    for s, found in enumerate(in_order(tasks, min(cores(None), max(1, _WAITING // size)))):
        for whole, one in zip(sums, found, strict=True):
            if one is not None:
                whole.total[:] += one.total
                whole.observed[s], whole.expected[s] = one.observed, one.expected
        if progress is not None:
            progress(1)
    return sums


def permutation_test(total: Floats, *, two_sided: bool) -> Tested:
    """p-values of groups and of their largest statistic.

    Args:
        total: Statistics, the first one observed, shape (G, 1 + P), G at least 1.
        two_sided: Whether small values count as much as large ones.
    """
    centred = total - total.mean(axis=1, keepdims=True)
    sd = centred.std(axis=1, keepdims=True)
    varies = sd > _TIE * np.abs(total).max(axis=1, keepdims=True)
    z = np.where(varies, centred / np.where(varies, sd, 1.0), 0.0)
    size = np.abs(z) if two_sided else z
    largest = size.max(axis=0)
    return Tested(
        z[:, 0],
        (size >= size[:, :1] - _TIE).mean(axis=1),
        float(largest[0]),
        float((largest >= largest[0] - _TIE).mean()),
    )


def false_discovery(p: Floats) -> Floats:
    """q-values of Benjamini and Hochberg (1995), NaN where p is; same shape."""
    q = np.full(p.shape, np.nan)
    tested = np.isfinite(p)
    order = p[tested].argsort()
    of_rank = p[tested][order] * (len(order) / np.arange(1, len(order) + 1))
    least = np.minimum.accumulate(of_rank[::-1])[::-1]
    q[tested] = np.minimum(least[order.argsort()], 1.0)
    return q


def bootstrap_weights(strata: int, seed: int) -> Floats:
    """How often each stratum is in each resample of strata, shape (RESAMPLES, strata)."""
    generator = seeds.generator(seed, seeds.Purpose.STRATA, strata)
    return generator.multinomial(strata, np.full(strata, 1 / strata), size=RESAMPLES).astype(np.float64)


def ratio(value: Floats, weight: Floats, resample: Floats | None = None) -> Floats:
    """Sum of values over sum of weights, NaN where that is 0.

    Args:
        value: Shape (S, G).
        weight: Shape (S, G).
        resample: How often each stratum counts, shape (R, S); once if None.

    Returns:
        Shape (G,) or (R, G).
    """
    up, down = (a.sum(axis=0) if resample is None else resample @ a for a in (value, weight))
    return np.where(down > 0, up / np.where(down > 0, down, 1.0), np.nan)


def percentiles(values: Floats, strata: int) -> tuple[Floats, Floats]:
    """Percentile interval over resamples, the first of two axes.

    NaN resamples are left out; where they are more than one in twenty, or strata fewer than `FEWEST_STRATA`, it is NaN.
    """
    tail = (1 - CONFIDENCE) / 2
    enough = np.isfinite(values).mean(axis=0) >= (_DEFINED if strata >= FEWEST_STRATA else np.inf)
    low, high = np.full((2, values.shape[1]), np.nan)
    whole = np.isfinite(values).all(axis=0)
    for some, quantile in ((enough & whole, np.quantile), (enough & ~whole, np.nanquantile)):  # the latter is slow
        if some.any():
            low[some], high[some] = quantile(values[:, some], [tail, 1 - tail], axis=0)
    return low, high
