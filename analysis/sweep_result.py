"""Results of a sweep, finished or not, for analysis."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import t

from ..inference.resampling import Spread
from ..models.errors import InputError
from .metrics import CONFIDENCE
from .resampled_units import units_of

AVERAGED = ("what_error", "where_error", "taps", "what_wrong", "belief", "stopped_fraction")

_SIDES = (("low", -1), ("high", 1))


def open_sweep(path: str | Path) -> xr.Dataset:
    """The quantities of a sweep by name, read when they are used.

    Args:
        path: The store.

    Returns:
        Dims are the axes of the study and `theta`; `status` and `traceback` lack theta. Pending and failed cells hold
        NaN. Where all data sets have the same unit of an error, it stands in the attribute `units`.
    """
    stored = xr.open_zarr(path, consolidated=False)
    dataset = stored["result"].to_dataset("quantity", promote_attrs=False).drop_vars("meaning", errors="ignore")
    meanings = dict(zip(stored["quantity"].values, stored["meaning"].values, strict=True))
    for name in dataset.data_vars:
        dataset[name].attrs = {"long_name": str(meanings[name]), **_unit(str(name), stored)}
    return dataset.assign(status=stored["status"], traceback=stored["traceback"]).assign_attrs(stored.attrs)


def _unit(name: str, stored: xr.Dataset) -> dict[str, str]:
    if name == "seconds":
        return {"units": "s"}
    if not name.startswith(("what_error", "where_error")):
        return {"units": "1"}
    units = set(stored[name.partition("_")[0] + "_unit"].values)
    return {"units": str(units.pop())} if len(units) == 1 else {}


def over_data(result: xr.Dataset, names: Sequence[str] = AVERAGED) -> xr.Dataset:
    """Means over data sets, or of one data set, and their 95 % t-intervals.

    Several data sets are the units: each has taps of its own, while cells of other seeds draw the same taps again. So
    seeds are averaged first. The units of one data set are the resamples of its test taps, if the study has some.

    Args:
        result: From `open_sweep`, or a selection of it, with the dim `data` or `resample`.
        names: Quantities; also differences that were added, such as of two policies, which pair.

    Returns:
        Each quantity with `<name>_low` and `<name>_high`, without the dims `data`, `resample` and `seed`; and `units`,
        how many the first quantity has. Cells that are pending or failed are left out with their data set; where fewer
        than two are left, the interval is NaN. All resamples have to be there.

    Raises:
        InputError: There is one data set without resamples, which no interval can come from.
    """
    chosen = result[list(names)]
    if "seed" in chosen.dims:
        chosen = chosen.mean("seed", skipna=False)
    if result.sizes.get("resample", 1) > 1:
        chosen, unit = _resampled(chosen, result.attrs), "resample"
    elif result.sizes.get("data", 1) > 1:
        unit = "data"
    else:
        raise InputError(
            "There is one data set, and trials on its taps say nothing of other taps: intervals need several data sets "
            "in the study, such as seeds of a preset or the sessions of a recording, or resamples = 40 of the taps of "
            "one."
        )
    chosen = chosen.squeeze([dim for dim in chosen.dims if dim in {"data", "resample"} - {unit}], drop=True)
    count = chosen.count(unit)
    error = chosen.std(unit, ddof=1) / np.sqrt(count)
    half = error * xr.apply_ufunc(lambda n: t.ppf(0.5 + CONFIDENCE / 2, np.maximum(n - 1, 1)), count)
    mean = chosen.mean(unit)
    ends = {f"{name}_{side}": mean[name] + sign * half[name] for name in names for side, sign in _SIDES}
    return mean.assign(ends | {"units": count[names[0]]})


def _resampled(chosen: xr.Dataset, about: Mapping[str, Any]) -> xr.Dataset:
    """Units with the mean of the test taps as they are, from resamples of them, see `units_of`."""
    sessions = int(about["resample_sessions"])
    how = Spread(float(about["resample_factor"]), freedom=sessions - 1.0 if sessions > 1 else np.inf)
    return xr.apply_ufunc(
        lambda values: np.moveaxis(units_of(np.moveaxis(values, -1, 0), how), 0, -1),
        chosen,
        input_core_dims=[["resample"]],
        output_core_dims=[["resample"]],
        exclude_dims={"resample"},
    )
