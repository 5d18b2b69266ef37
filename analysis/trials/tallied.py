"""Counted trials as a labelled data set."""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ...inference.trials.tally import Tally
from ...models.grid import ClassGrid
from ..stats.tallied import QUANTITIES, tally_means

if TYPE_CHECKING:
    from .spread import TapSpread


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
        The means (theta), with `spread` also the ends of their 95% intervals over test taps as ``<name>_low`` and
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
                words = f"{'lower' if side == 'low' else 'upper'} end of the 95% interval over test taps"
                variables[f"{prefix}{name}_{side}"] = "theta", end, {"long_name": words}
    return variables
