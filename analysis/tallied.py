"""What counted trials say: errors, reaction times and fractions at each threshold."""

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..inference.tally import Tally
from ..models.classes import ClassGrid
from .sweep_quantities import QUANTITIES

UNCERTAIN = ("what_error", "where_error", "taps")


def tally_means(tally: Tally, grid: ClassGrid) -> dict[str, NDArray[np.float64]]:
    """Means over trials by name, each of shape (H,).

    Args:
        tally: At least one trial at H thresholds.
        grid: The classes.

    Returns:
        `UNCERTAIN` quantities with their standard errors over trials as `<name>_se` (NaN for a single trial), and
        `what_wrong`, `stopped_fraction`, `clamped_fraction`, `substituted_fraction`, `no_class_left_fraction` and
        `belief`.
    """
    n = tally.trials
    what, where = np.arange(grid.M), np.arange(grid.L)
    values = {
        "what_error": (tally.what, grid.what_error(what, what[:, np.newaxis])),
        "where_error": (tally.where, grid.where_error(where, where[:, np.newaxis])),
        "taps": (tally.taps, np.arange(tally.taps.shape[1], dtype=np.float64)),
    }
    means: dict[str, NDArray[np.float64]] = {}
    for name, (counts, value) in values.items():
        flat = counts.reshape(len(counts), -1)
        mean = flat @ value.ravel() / n
        variance = np.maximum(flat @ value.ravel() ** 2 / n - mean**2, 0.0)
        means[name] = mean
        means[f"{name}_se"] = np.sqrt(variance / (n - 1)) if n > 1 else np.full_like(mean, np.nan)
    means["what_wrong"] = 1 - np.trace(tally.what, axis1=1, axis2=2) / n
    for name in ("stopped", "clamped", "substituted", "no_class_left"):
        means[f"{name}_fraction"] = getattr(tally, name) / n
    means["belief"] = tally.belief / n
    return means


def tally_dataset(tally: Tally, grid: ClassGrid, thresholds: ArrayLike) -> xr.Dataset:
    """The counts and the means with labels.

    Returns:
        The means (theta); ``confusion`` (theta, what, decided_what), ``place`` (theta, where, decided_where) and
        ``reaction_time`` (theta, tap) as counts; attributes ``trials``, ``what_unit``, ``where_unit``.
    """
    what_name = np.asarray(grid.what_name, dtype=np.str_)
    where = {"where": grid.where_value, "decided_where": grid.where_value}
    return xr.Dataset(
        {name: ("theta", values, {"long_name": QUANTITIES[name]}) for name, values in tally_means(tally, grid).items()}
        | {
            "confusion": (("theta", "what", "decided_what"), tally.what),
            "place": (("theta", "where", "decided_where"), tally.where),
            "reaction_time": (("theta", "tap"), tally.taps),
        },
        {
            "theta": np.asarray(thresholds, dtype=np.float64),
            "what": what_name,
            "decided_what": what_name,
            "tap": np.arange(tally.taps.shape[1]),
            **where,
        },
        {"trials": tally.trials, "what_unit": grid.what_error_unit, "where_unit": grid.where_unit},
    )
