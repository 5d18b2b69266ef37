"""Dependence between the samples of a tap within a class, and their effective number.

Residuals are samples less the mean of their stratum at the same taxel and sample, over their standard deviation there,
so that the course of a tap is conditioned away. As means are taken over taps and not along a tap, correlations are not
biased by its length, and sums over all lags need no cut. That strata have few taps is corrected for.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.special import hyp2f1

from ....models.compiled import compiled
from ....models.errors import InputError
from .permutation import (
    Floats,
    Statistic,
    Strata,
    bootstrap_weights,
    checked,
    checked_level,
    percentiles,
    permutation_test,
    permuted,
    product_sums,
    ratio,
    unit_residuals,
)

LAGS = 20
"""Lags that are tested by default, or as many as a tap has."""
_CAP = 2.0  # effective samples are at most so many times the samples: with opposite noise they exceed them

_GRID = 1025  # correlations from 0 to 1 at which estimates are computed
_TINY = 1e-6  # stands for 0, where some of them diverge


def time_dependence(
    taps: ArrayLike,
    stratum: ArrayLike,
    *,
    lags: int | None = None,
    permutations: int = 999,
    alpha: float = 0.05,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
) -> xr.Dataset:
    """Correlation of the samples of a tap, tests of it, and effective numbers.

    Under the null all taxels of a sample belong together and samples do not: at every sample the taps of a stratum are
    permuted independently of the other samples. Dependence of taxels at the same time does not count.

    Args:
        taps: Shape (N, J, K).
        stratum: Class and session of each tap as one number, shape (N,); taps alone in their stratum drop out.
        lags: Up to which lag is tested; default `LAGS`, or J - 1.
        permutations: P.
        alpha: Level.
        seed: Of permutations and resamples.
        progress: Called after every stratum.

    Returns:
        Dim lag, 0 to J - 1: ``autocorrelation`` of residuals, mean over strata (weighted by taps), taxels and samples,
        with its 95% interval ``autocorrelation_low`` and ``autocorrelation_high`` over resampled strata;
        ``partial`` autocorrelation of it (Durbin and Levinson). Dim taxel: ``lag1``, the first autocorrelation of each,
        and ``dead``. Dim test, lag1 and any: ``p``, ``z`` and ``rejected`` of the first lag and of the largest
        standardised one of ``lags``, in absolute value.

        ``effective_samples`` of a tap with interval, J / (1 + 2 sum over h of (1 - h/J) rho_h), between 1 and 2 J: how
        many independent samples have a mean as variable. ``effective_values`` of a tap with interval, between 1 and
        ``values``, J times the live taxels: (sum of eigenvalues)^2 / sum of their squares of the correlation of all
        values of a tap (Bretherton et al., "The effective number of spatial degrees of freedom of a time-varying
        field", 1999), which the signs of correlations do not change, from strata of three taps and more. ``strata``,
        ``taps``, and ``reason``, empty or why nothing is tested.

    Raises:
        InputError: Sizes do not fit together, a value is not finite, or an option lies outside its range.
    """
    values, strata = checked(taps, stratum, permutations)
    alpha = checked_level(alpha)
    _, J, K = values.shape
    if lags is not None and lags < 1:
        raise InputError(f"At least one lag is tested, got {lags}.")
    tested = min(LAGS if lags is None else lags, J - 1)
    products, weight, sizes = _observed(values, strata)
    live = weight[:, 0].sum(axis=0) > 0 if J else np.zeros(K, dtype=bool)
    attributes = {"alpha": alpha, "seed": seed, "permutations": permutations, "lags": max(tested, 0)}
    result = _empty(J, K, live, attributes)
    result["strata"], result["taps"] = len(strata), sum(len(own) for own in strata)
    resample = bootstrap_weights(len(strata), seed) if strata else np.ones((1, 0))
    if live.any():
        _effective_values(result, sizes, J * int(live.sum()), resample)
    reason = _reason(J, strata, live)
    if reason:
        result["reason"] = reason
        return result
    _correlations(result, products, weight, resample)
    _test(result, values[:, :, live], strata, tested, progress)
    return result


def _reason(J: int, strata: Strata, live: NDArray[np.bool_]) -> str:
    if not strata:
        return "no stratum has two taps"
    if J < 2:
        return f"taps have {J} sample{'s' * (J != 1)}"
    return "" if live.any() else "no taxel varies within a stratum"


def _empty(J: int, K: int, live: NDArray[np.bool_], attributes: dict[str, float]) -> xr.Dataset:
    ends = ("", "_low", "_high")
    variables = {f"autocorrelation{end}": (("lag",), np.full(J, np.nan)) for end in ends}
    variables |= {"partial": (("lag",), np.full(J, np.nan)), "lag1": (("taxel",), np.full(K, np.nan))}
    variables |= {"dead": (("taxel",), ~live), "rejected": (("test",), np.zeros(2, dtype=bool))}
    variables |= {name: (("test",), np.full(2, np.nan)) for name in ("z", "p")}
    numbers = {f"effective_{what}{end}": np.nan for what in ("samples", "values") for end in ends}
    numbers |= {"values": J * int(live.sum()), "strata": 0, "taps": 0, "reason": ""}
    coords = {"lag": np.arange(J), "taxel": np.arange(K), "test": ["lag1", "any"]}
    return xr.Dataset(variables | {name: ((), value) for name, value in numbers.items()}, coords, attributes)


def _observed(values: Floats, strata: Strata) -> tuple[Floats, Floats, Floats]:
    """Of every stratum: products of residuals and their weights by lag and taxel, and sums of correlations.

    Returns:
        Sums over samples of taps times correlation, shape (S, J, K); sums over samples of taps, the same shape; and of
        strata of three taps and more, else 0: taps times (the square of the number of values, the sum of all squared
        correlations), shape (S, 2).
    """
    _, J, K = values.shape
    products, weight = np.zeros((len(strata), J, K)), np.zeros((len(strata), J, K))
    sizes = np.zeros((len(strata), 2))
    for s, own in enumerate(strata):
        units, n = unit_residuals(values[own]), len(own)
        varies = (units != 0).any(axis=0)
        _add_by_lag(
            np.ascontiguousarray(units.transpose(2, 1, 0)), varies, unbiased_correlation(n), n, products[s], weight[s]
        )
        if n > 2:
            D = varies.sum()
            sizes[s] = n * D**2, n * (D + squared_correlations(units.reshape(n, -1)))
    return products, weight, sizes


@compiled
def _add_by_lag(
    units: Floats, varies: NDArray[np.bool_], estimate: Floats, weight: float, products: Floats, weights: Floats
) -> None:
    """Adds the unbiased correlations of a stratum, times its weight, and the weights of those there are, by lag.

    Args:
        units: Residuals, shape (K, J, n).
        varies: Which there are, shape (J, K).
        estimate: From `unbiased_correlation`.
        weight: Of the stratum.
        products: Added to, shape (J, K).
        weights: Added to, shape (J, K).
    """
    K, J, n = units.shape
    for k in range(K):
        for i in range(J):
            for j in range(i + 1):
                if varies[i, k] and varies[j, k]:
                    r = 0.0
                    for tap in range(n):
                        r += units[k, i, tap] * units[k, j, tap]
                    products[i - j, k] += weight * np.sign(r) * _read(estimate, abs(r))
                    weights[i - j, k] += weight


@cache
def unbiased_correlation(n: int) -> Floats:
    """The unbiased estimates of correlations of normal variables where those of n taps are 0 to 1, evenly spaced.

    Olkin and Pratt, "Unbiased estimation of certain correlation coefficients", 1958; r itself where n is 2.
    """
    grid = np.linspace(0.0, 1.0, _GRID)
    if n < 4:
        return np.ones(_GRID) if n == 3 else grid
    return grid * hyp2f1(0.5, 0.5, (n - 2) / 2, 1 - np.maximum(grid, _TINY) ** 2)


@compiled
def _read(estimate: Floats, size: float) -> float:
    """Value of a function between those on a grid from 0 to 1; beyond, as at 1."""
    last = len(estimate) - 1
    place = min(size, 1.0) * last
    cell = min(int(place), last - 1)
    return estimate[cell] + (place - cell) * (estimate[cell + 1] - estimate[cell])


def squared_correlations(units: Floats) -> float:
    """Sum of the squared correlations of all ordered pairs of normal columns, without the bias of few taps.

    Olkin and Pratt's estimate; of three taps, for which there is none, as adjusted R^2, too small by up to a third.

    Args:
        units: Centred and of unit length or zero, shape (n, columns), n at least 3.
    """
    n = len(units)
    units = units[:, (units != 0).any(axis=0)]
    D = units.shape[1]
    if n == 3:
        squares = ((units @ units.T) ** 2).sum() - D
        return float(2 * squares - D * (D - 1))
    return 2 * _sum_of_pairs(np.ascontiguousarray(units.T), _unbiased_square(n))


@cache
def _unbiased_square(n: int) -> Floats:
    left = 1 - np.linspace(_TINY, 1.0, _GRID) ** 2
    return 1 - (n - 3) / (n - 2) * left * hyp2f1(1.0, 1.0, n / 2, left)


@compiled
def _sum_of_pairs(columns: Floats, estimate: Floats) -> float:
    """Of a function of the absolute product of two columns, between values on a grid from 0 to 1."""
    D, n = columns.shape
    total = 0.0
    for d in range(D):
        for e in range(d):
            product = 0.0
            for i in range(n):
                product += columns[d, i] * columns[e, i]
            total += _read(estimate, abs(product))
    return total


def _correlations(result: xr.Dataset, products: Floats, weight: Floats, resample: Floats) -> None:
    """Autocorrelation, partial autocorrelation and effective samples, with intervals."""
    S = len(products)
    up, down = products.sum(axis=2), weight.sum(axis=2)
    rho, resamples = ratio(up, down), ratio(up, down, resample)
    low, high = percentiles(resamples, S)
    result["autocorrelation"].values[:] = rho
    result["autocorrelation_low"].values[:], result["autocorrelation_high"].values[:] = low, high
    result["partial"].values[:] = partial_autocorrelation(rho)
    result["lag1"].values[:] = ratio(products[:, 1], weight[:, 1])
    spread = effective_samples(resamples)
    ends = percentiles(spread[:, np.newaxis], S)
    for end, value in (("", effective_samples(rho)), ("_low", ends[0][0]), ("_high", ends[1][0])):
        result[f"effective_samples{end}"] = float(value)


def effective_samples(rho: Floats) -> Floats:
    """Of J samples with autocorrelations (..., J), lag 0 first; other lags without any count as 0; shape (...)."""
    J = rho.shape[-1]
    factor = 1 + 2 * np.nansum((1 - np.arange(1, J) / J) * rho[..., 1:], axis=-1)
    return np.where(np.isfinite(rho[..., 0]), J / np.clip(factor, 1 / _CAP, J), np.nan)


def partial_autocorrelation(rho: Floats) -> Floats:
    """Of autocorrelations (J,), lag 0 first, by Durbin and Levinson; NaN from where they are those of no process."""
    J = len(rho)
    partial = np.full(J, np.nan)
    partial[0], phi, left = 1.0, np.zeros(0), 1.0
    for h in range(1, J):
        last = (rho[h] - phi @ rho[h - 1 : 0 : -1]) / left
        if not abs(last) < 1:
            break
        phi = np.append(phi - last * phi[::-1], last)
        partial[h], left = last, left * (1 - last**2)
    return partial


def _effective_values(result: xr.Dataset, sizes: Floats, most: int, resample: Floats) -> None:
    """Effective values of a tap, with an interval."""
    if not sizes[:, 0].any():
        return
    used = sizes[sizes[:, 0] > 0]
    resample = bootstrap_weights(len(used), int(result.attrs["seed"])) if len(used) < len(sizes) else resample

    sums = np.vstack([used.sum(axis=0), resample @ used])
    size = sums[:, 0]
    number = size / np.clip(sums[:, 1], size / most, size)
    low, high = percentiles(number[1:, np.newaxis], len(used))
    for end, value in (("", number[0]), ("_low", low[0]), ("_high", high[0])):
        result[f"effective_values{end}"] = float(value)


def _test(
    result: xr.Dataset, values: Floats, strata: Strata, lags: int, progress: Callable[[int], None] | None
) -> None:
    """p-values of the first and of any lag."""
    J = values.shape[1]
    lag = np.arange(J) - np.arange(J)[:, np.newaxis]
    first, second = np.nonzero((lag > 0) & (lag <= lags))
    group = second - first - 1

    def prepare(_: int, own: NDArray[np.intp]) -> list[Statistic | None]:
        units = np.sqrt(len(own)) * unit_residuals(values[own])
        return [product_sums(units.transpose(1, 0, 2), first, second, group)]

    permutations, seed = int(result.attrs["permutations"]), int(result.attrs["seed"])
    (found,) = permuted(strata, J, prepare, [lags], [permutations], seed, progress)
    test = permutation_test(found.total, two_sided=True)
    result["p"].values[:] = test.p[0], test.family_p
    result["z"].values[:] = test.z[0], test.family_z
    result["rejected"].values[:] = result["p"].values <= result.attrs["alpha"]
