"""What counted trials say: errors, reaction times and fractions at each threshold."""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ...inference.tally import Tally
from ...models.classes import ClassGrid
from ..sweep.quantities import QUANTITIES

if TYPE_CHECKING:
    from .spread import TapSpread


def tally_means(tally: Tally, grid: ClassGrid) -> dict[str, NDArray[np.float64]]:
    """Means over trials by name, each of shape (H,).

    Args:
        tally: At least one trial at H thresholds.
        grid: The classes.

    Returns:
        Errors and taps with their standard errors over trials as `<name>_se` (NaN for a single trial), and
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


def tally_dataset(
    tally: Tally, grid: ClassGrid, thresholds: ArrayLike, spread: "TapSpread | None" = None
) -> xr.Dataset:
    """The counts and the means with labels.

    Args:
        tally: The counts.
        grid: The classes.
        thresholds: theta_W, shape (H,).
        spread: Trials on resampled and on fresh taps.

    Returns:
        The means (theta), with `spread` also the ends of their 95 % intervals over test taps as ``<name>_low`` and
        ``<name>_high``, and all of that on fresh taps as ``fresh_<name>``, with ``fresh_used_up``; ``confusion``
        (theta, what, decided_what), ``place`` (theta, where, decided_where) and ``reaction_time`` (theta, tap) as
        counts; attributes ``trials``, ``what_unit``, ``where_unit``.
    """
    what_name = np.asarray(grid.what_name, dtype=np.str_)
    where = {"where": grid.where_value, "decided_where": grid.where_value}
    means = tally_means(tally, grid)
    return xr.Dataset(
        {name: ("theta", values, {"long_name": QUANTITIES[name]}) for name, values in means.items()}
        | (_spread_variables(means, spread) if spread else {})
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


def _spread_variables(means: dict[str, NDArray[np.float64]], spread: "TapSpread") -> dict[str, tuple[Any, ...]]:
    variables: dict[str, tuple[Any, ...]] = {
        "fresh_used_up": ("theta", spread.used_up, {"long_name": "fraction of trials that used up the taps of a class"})
    }
    for name, samples in spread.fresh.items():
        variables[f"fresh_{name}"] = "theta", samples[:, 0], {"long_name": f"{QUANTITIES[name]}, on fresh taps"}
    for prefix, intervals in (("", spread.intervals(means)), ("fresh_", spread.fresh_intervals())):
        for name, ends in intervals.items():
            for side, end in zip(("low", "high"), ends, strict=True):
                words = f"{'lower' if side == 'low' else 'upper'} end of the 95 % interval over test taps"
                variables[f"{prefix}{name}_{side}"] = "theta", end, {"long_name": words}
    return variables
