"""Rows of numbers, as JSON files hold them, as labelled data sets."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

_FILL: dict[type, Any] = {bool: False, str: ""}


def labelled(
    rows: Iterable[Mapping[str, Any]], dims: Sequence[str], units: Mapping[str, str] | None = None, **attributes: Any
) -> xr.Dataset:
    """Data set of rows, with the columns that name a row as dimensions.

    >>> rows = [{"policy": "passive", "theta": 0.5, "taps": 3.2}, {"policy": "active", "theta": 0.5, "taps": None}]
    >>> labelled(rows, ["policy", "theta"], {"taps": "taps"})["taps"].values.tolist()
    [[3.2], [nan]]

    Args:
        rows: Names and values; nested values are left out.
        dims: Columns that become dimensions, their labels in order of appearance.
        units: Units by quantity, also for its bounds and differences such as `taps_low` and `taps_difference`.
        attributes: Attributes of the data set.

    Returns:
        A variable for each other column; where there is no row or no number it is NaN, False or empty.
    """
    rows = [row for row in rows if all(dim in row for dim in dims)]
    labels = {dim: list(dict.fromkeys(row[dim] for row in rows)) for dim in dims}
    at = tuple(np.array([labels[dim].index(row[dim]) for row in rows], dtype=np.intp) for dim in dims)
    shape = tuple(map(len, labels.values()))
    data = xr.Dataset(coords=labels, attrs=attributes)
    for name in dict.fromkeys(key for row in rows for key in row if key not in dims):
        found = [row.get(name) for row in rows]
        column = [value.item() if isinstance(value, np.generic) else value for value in found]
        kinds = {type(value) for value in column} - {type(None)}
        if kinds <= {bool, str, int, float}:
            fill = next((_FILL[kind] for kind in kinds if kind in _FILL), np.nan)
            known = np.array([fill if value is None else value for value in column])
            values = np.full(shape, fill, dtype=known.dtype)
            values[at] = known
            data[name] = tuple(dims), values, _unit(name, units or {})
    return data


def _unit(name: str, units: Mapping[str, str]) -> dict[str, str]:
    """The attributes of a variable: the unit of the quantity that its name begins with."""
    known = [quantity for quantity in units if name == quantity or name.startswith(f"{quantity}_")]
    return {"units": units[max(known, key=len)]} if known else {}
