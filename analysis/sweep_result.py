"""Results of a sweep, finished or not, for analysis."""

from pathlib import Path

import xarray as xr


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
