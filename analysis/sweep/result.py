"""Results of a sweep, finished or not, for analysis."""

import json
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.special import stdtrit

from ...models.errors import InputError
from ...models.io.untrusted import read_first
from ..stats.jackknife import shared_training
from ..stats.metrics import CONFIDENCE

AVERAGED = ("what_error", "where_error", "taps", "what_wrong", "belief", "stopped_fraction")

_SIDES = (("low", -1), ("high", 1))
_NO_WIDTH = 1e-12  # equal values differ by rounding
_RESAMPLED = ("resample_factor", "resample_sessions")
_FOLD = " fold "


def open_sweep(path: str | Path) -> xr.Dataset:
    """The quantities of a sweep by name, read when they are used.

    Returns:
        Dims are the axes of the study and `theta`; `status` and `traceback` lack theta. Pending and failed cells hold
        NaN. Where all data sets have the same unit of an error, it stands in the attribute `units`.

    Raises:
        InputError: The store is damaged.
    """
    try:
        if not read_first("zarr_store", Path(path), "result", "status", "traceback"):
            raise OSError
        return _opened(path)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except Exception as error:  # on damaged bytes Zarr raises almost any exception
        raise InputError(f"{path}: not a sweep, or damaged.") from error


def _opened(path: str | Path) -> xr.Dataset:
    stored = xr.open_zarr(path, consolidated=False)
    dataset = stored["result"].to_dataset("quantity", promote_attrs=False).drop_vars("meaning", errors="ignore")
    meanings = dict(zip(stored["quantity"].values, stored["meaning"].values, strict=True))
    for name in dataset.data_vars:
        dataset[name].attrs = {"long_name": str(meanings[name]), **_unit(str(name), stored)}
    dataset = dataset.assign(status=stored["status"], traceback=stored["traceback"]).assign_attrs(stored.attrs)
    # As coordinates they stay with differences of quantities.
    known = json.loads(stored.attrs.get("data_keys", "{}"))
    recording = [known.get(str(name), "").rpartition(_FOLD)[0] for name in stored["data"].values]
    if len(set(recording) - {""}) < len(recording) - recording.count(""):
        dataset = dataset.assign_coords(recording=("data", recording))
    return dataset.assign_coords({name: stored.attrs[name] for name in _RESAMPLED if name in stored.attrs})


def _unit(name: str, stored: xr.Dataset) -> dict[str, str]:
    if name == "seconds":
        return {"units": "s"}
    if not name.startswith(("what_error", "where_error")):
        return {"units": "1"}
    units = set(stored[name.partition("_")[0] + "_unit"].values)
    return {"units": str(units.pop())} if len(units) == 1 else {}


def over_data(result: xr.Dataset, names: Sequence[str] = AVERAGED) -> xr.Dataset:
    """Means over data sets, or of one data set, and their 95% t-intervals.

    Several data sets are the units: each has taps of its own, while cells of other seeds draw the same taps again. So
    seeds are averaged first. Sessions of a recording that are left out in turn share training taps, see
    `jackknife.shared_training`. The units of one data set are the resamples of its test taps, if the study has some.

    Args:
        result: From `open_sweep`, or a selection of it, with the dim `data` or `resample`.
        names: Quantities; also differences that were added, such as of two policies, which pair.

    Returns:
        Each quantity with `<name>_low` and `<name>_high`, without the dims `data`, `resample` and `seed`; and `units`,
        how many the first quantity has. Cells that are pending or failed are left out with their unit. The ends are NaN
        where fewer than two are left, where the test taps are too few to be resampled, and where all units are equal,
        such as errors that none has: they do not show how much others would vary.

    Raises:
        InputError: There is one data set without resamples, from which no interval can come, or its taps as they are
            have been selected away.
    """
    chosen = result[list(names)].load()
    if "seed" in chosen.dims:
        chosen = chosen.mean("seed", skipna=False)
    chosen = chosen.squeeze([dim for dim in chosen.dims if dim in ("data", "resample") and chosen.sizes[dim] == 1])
    if "data" in chosen.dims:
        own = chosen if "resample" not in chosen.dims else chosen.sel(resample=0)
        mean, count = own.mean("data"), own.count("data")
        error = own.std("data", ddof=1) / np.sqrt(count)
        recording = own["recording"].values[own["recording"].values != ""] if "recording" in own.coords else []
        if len(set(recording)) < len(recording):
            error = error * xr.apply_ufunc(shared_training, count.where(count > 1), vectorize=True)
    elif "resample" in chosen.dims:
        mean, error, count = _resampled(chosen)
    else:
        raise InputError(
            "There is one data set, and trials on its taps say nothing of other taps: intervals need several data sets "
            "in the study, such as seeds of a preset or the sessions of a recording, or resamples = 40 of the taps of "
            "one."
        )
    half = error * xr.apply_ufunc(lambda n: stdtrit(np.maximum(n - 1, 1), 0.5 + CONFIDENCE / 2), count)
    half = half.where(half > _NO_WIDTH)
    ends = {f"{name}_{side}": mean[name] + sign * half[name] for name in names for side, sign in _SIDES}
    found = mean.assign(ends | {"units": count[names[0]]})
    return found.drop_vars([name for name in ("data", "seed", "resample", *_RESAMPLED) if name in found.coords])


def _resampled(chosen: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset, xr.Dataset]:
    """Values on the test taps as they are, with standard errors from resamples, and how many of these there are.

    They are those of `resampled_units.units_of`; several resamples without the same session are one.
    """
    number, sessions = chosen["resample"], int(chosen["resample_sessions"])
    if 0 not in number:
        raise InputError("The test taps as they are, resample 0, must be in the selection.")
    drawn = chosen.sel(resample=number[number > 0])
    if sessions > 1:
        drawn = drawn.groupby((drawn["resample"] - 1) % sessions).mean()
    count = drawn.count("resample")
    # Of S sessions that are left out in turn: jackknife.
    shrunk = ((sessions - 1) / sessions) ** 0.5 if sessions > 1 else 1.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # some versions of xarray warn of single values, which give NaN
        spread = drawn.std("resample", ddof=1)
    return chosen.sel(resample=0), float(chosen["resample_factor"]) * shrunk * spread, count
