"""Errors, reaction times and their intervals.

Outcomes are xarray datasets with the dims ``place`` (sensing position of passive, fixation point of active trials)
and ``theta``; several data sets add the dim ``data_set`` in front. Position errors are those between classes, at the
place where the sensor stood when it decided, in the unit of the positions.
"""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm, t

from ..inference.montecarlo import Trials
from ..inference.trial_plan import TrialPlan
from ..models.classes import ClassGrid

QUANTITIES = ("what_error", "where_error", "taps")
FRACTIONS = ("stopped_fraction", "clamped_fraction", "substituted_fraction", "what_wrong", "no_class_left_fraction")
CONFIDENCE = 0.95


def outcomes(trials: Trials, plan: TrialPlan, place: ArrayLike, grid: ClassGrid, thresholds: ArrayLike) -> xr.Dataset:
    """Mean outcome at each place and threshold.

    Args:
        trials: n decided trials at H thresholds.
        plan: The same trials as planned.
        place: Where class that each trial belongs to, shape (n,).
        grid: The classes.
        thresholds: theta_W, shape (H,).

    Returns:
        Dims (place, theta): the means of `QUANTITIES` and `FRACTIONS`, the variance of a single trial as
        ``<quantity>_variance``, and the number of ``trials`` (place). Places without a trial hold NaN.
    """
    place = np.asarray(place)
    what = plan.what[:, np.newaxis]
    values = {
        "what_error": grid.what_error(trials.what, what),
        "where_error": grid.where_error(trials.where, trials.true_where),
        "taps": trials.taps.astype(np.float64),
        "stopped_fraction": trials.stopped.astype(np.float64),
        "clamped_fraction": (trials.clamped > 0).astype(np.float64),
        "substituted_fraction": (trials.substituted > 0).astype(np.float64),
        "what_wrong": (trials.what != what).astype(np.float64),
        "no_class_left_fraction": trials.no_class_left.astype(np.float64),
    }
    count = np.bincount(place, minlength=grid.L).astype(np.float64)
    dataset = xr.Dataset(
        {"trials": ("place", count)},
        {
            "place": ("place", grid.where_value, {"units": grid.where_unit}),
            "theta": ("theta", np.asarray(thresholds, dtype=np.float64)),
        },
        {"what_unit": grid.what_error_unit, "where_unit": grid.where_unit},
    )
    for name, value in values.items():
        mean = _mean_by(value, place, count)
        dataset[name] = (("place", "theta"), mean)
        if name in QUANTITIES:
            dataset[f"{name}_variance"] = (("place", "theta"), _mean_by((value - mean[place]) ** 2, place, count))
    return dataset


def by_place(data_sets: xr.Dataset) -> xr.Dataset:
    """Mean and interval at each place and threshold, over the data sets; dims (place, theta)."""
    return _with_intervals(data_sets, data_sets["trials"])


def over_places(data_sets: xr.Dataset) -> xr.Dataset:
    """Mean and interval at each threshold of the mean over all places, over the data sets; dim theta."""
    mean = data_sets.mean("place", skipna=True, keep_attrs=True)
    share = (data_sets["trials"] > 0).sum("place")
    for name in QUANTITIES:
        # Places are averaged with equal weight, so their sampling variances add up to this one.
        variance = (data_sets[f"{name}_variance"] / data_sets["trials"]).sum("place") / share**2
        mean[f"{name}_variance"] = variance
    return _with_intervals(mean, xr.ones_like(share, dtype=float))


def at_place(data_sets: xr.Dataset, index: int) -> xr.Dataset:
    """Mean and interval at each threshold for one place; dim theta."""
    return by_place(data_sets).isel(place=index)


def confusion(true: ArrayLike, decided: ArrayLike, M: int) -> NDArray[np.int64]:
    """How often each object (row) was taken for each (column), shape (M, M).

    Args:
        true: What class of every trial, shape (n,).
        decided: Decided what class, shape (n,).
        M: Number of what classes.
    """
    return np.bincount(np.asarray(true) * M + np.asarray(decided), minlength=M * M).reshape(M, M)


def join(parts: Sequence[xr.Dataset], names: Sequence[str]) -> xr.Dataset:
    """Outcomes of several data sets along the dim ``data_set``."""
    return xr.concat(parts, dim=xr.DataArray(list(names), dims="data_set", name="data_set"))


def interval_sentence(data_sets: int, kind: str) -> str:
    """What the intervals mean, in a sentence.

    Args:
        data_sets: How many data sets were averaged.
        kind: What one of them is called, such as "simulated data sets".
    """
    if data_sets > 1:
        return (
            f"Intervals are {CONFIDENCE:.0%} t-intervals of the mean over {data_sets} {kind}; they hold the spread "
            "between data sets as well as that between trials."
        )
    return (
        f"Intervals are {CONFIDENCE:.0%} normal intervals over the Monte Carlo trials of this one data set; they hold "
        "the sampling of trials only, not how another recording would differ."
    )


def _with_intervals(data_sets: xr.Dataset, trials: xr.DataArray) -> xr.Dataset:
    n = data_sets.sizes["data_set"]
    result = data_sets[[*QUANTITIES, *FRACTIONS]].mean("data_set", keep_attrs=True)
    for name in QUANTITIES:
        if n > 1:
            seen = data_sets[name].count("data_set")  # a place may lack trials in some of the data sets
            spread = data_sets[name].std("data_set", ddof=1) / np.sqrt(seen)
            half = t.ppf(0.5 + CONFIDENCE / 2, seen - 1) * spread
        else:
            half = norm.ppf(0.5 + CONFIDENCE / 2) * np.sqrt((data_sets[f"{name}_variance"] / trials).mean("data_set"))
        least = 1.0 if name == "taps" else 0.0
        most = 1.0 if name == "what_error" and data_sets.attrs.get("what_unit") == "P(wrong)" else np.inf
        result[f"{name}_low"] = np.maximum(result[name] - half, least)
        result[f"{name}_high"] = np.minimum(result[name] + half, most)
    return result


def _mean_by(values: NDArray[np.float64], place: NDArray[np.intp], count: NDArray[np.float64]) -> NDArray[np.float64]:
    total = np.zeros((len(count), values.shape[1]))
    np.add.at(total, place, values)
    with np.errstate(invalid="ignore"):
        return total / count[:, np.newaxis]
