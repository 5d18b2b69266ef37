"""Labelled data sets from rows of numbers, as in the JSON files.

All reports name alike: `taps_low` and `taps_high` are the 95% interval of `taps`, `taps_least` and `taps_most` the
interval that holds together with all others, `taps_difference` is the change from a reference.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

NUMBERS_FORMAT = 1
"""Version of the layout of `results.nc` and `compare.nc`, their attribute `format`."""

_FILL: dict[type, Any] = {bool: False, str: ""}


def labelled(
    rows: Iterable[Mapping[str, Any]], dims: Sequence[str], units: Mapping[str, str] | None = None
) -> xr.Dataset:
    """Data set of rows, with the columns that name a row as dimensions.

    >>> rows = [{"policy": "passive", "theta": 0.5, "taps": 3.2}, {"policy": "active", "theta": 0.5, "taps": None}]
    >>> labelled(rows, ["policy", "theta"], {"taps": "taps"})["taps"].values.tolist()
    [[3.2], [nan]]

    Args:
        rows: Names and values; nested values are left out.
        dims: Columns that become dimensions, their labels in order of appearance.
        units: See `with_units`.

    Returns:
        A variable for each other column; where there is no row or no number it is NaN, False or empty.

    Raises:
        ValueError: Two rows have the same labels.
    """
    rows = [*rows]
    labels = {dim: list(dict.fromkeys(row[dim] for row in rows)) for dim in dims}
    at = tuple(np.array([labels[dim].index(row[dim]) for row in rows], dtype=np.intp) for dim in dims)
    if len(set(zip(*at, strict=True))) < len(rows):
        raise ValueError(f"Two rows have the same {', '.join(dims)}.")
    shape = tuple(map(len, labels.values()))
    whole = len(rows) == np.prod(shape)
    data = xr.Dataset(coords=labels)
    for name in dict.fromkeys(key for row in rows for key in row if key not in dims):
        found = [row.get(name) for row in rows]
        column = [value.item() if isinstance(value, np.generic) else value for value in found]
        kinds = {type(value) for value in column} - {type(None)}
        if kinds <= {bool, str, int, float}:
            fill = next((_FILL[kind] for kind in kinds if kind in _FILL), np.nan)
            known = np.array([fill if value is None else value for value in column])
            values = np.full(shape, fill, dtype=np.result_type(known, np.min_scalar_type(fill)))
            values[at] = known
            data[name] = tuple(dims), values.astype(known.dtype) if whole else values
    return with_units(data, units or {})


def rows(data: xr.Dataset, *dims: str) -> list[dict[str, Any]]:
    """The inverse: a row of plain numbers and texts for each combination of labels, the last dimension fastest.

    Coordinates that are no dimensions are left out.

    >>> rows(xr.Dataset({"taps": ("policy", [3.2, 2.5])}, {"policy": ["passive", "active"]}), "policy")
    [{'policy': 'passive', 'taps': 3.2}, {'policy': 'active', 'taps': 2.5}]
    """
    frame = data.reset_coords(drop=True).to_dataframe(dim_order=dims).reset_index()
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


def with_units(data: xr.Dataset, units: Mapping[str, str]) -> xr.Dataset:
    """A copy with units as attributes.

    Args:
        data: Variables and coordinates.
        units: Units by quantity, also for what begins with its name, such as `taps_low` and `taps_difference`.
    """
    data = data.copy()
    for name, variable in data.variables.items():
        known = [quantity for quantity in units if f"{name}_".startswith(f"{quantity}_")]
        if known:
            variable.attrs["units"] = units[max(known, key=len)]
    return data


def interval_columns(name: str, triple: Sequence[float | None] | None) -> dict[str, float | None]:
    """A value with the ends of its interval, as columns of a row; none where there is no value."""
    return dict(zip((name, f"{name}_low", f"{name}_high"), triple or (None, None, None), strict=True))


def distinct(names: Iterable[str]) -> list[str]:
    """The same names, numbered from the second of equal ones on.

    >>> distinct(["taps", "other", "taps"])
    ['taps', 'other', 'taps (2)']
    """
    seen: Counter[str] = Counter()
    found = []
    for name in names:
        seen[name] += 1
        found.append(f"{name} ({seen[name]})" if seen[name] > 1 else name)
    return found


def source_units(sources: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    """Units of errors, ways and taps; errors have none where sources of data do not share it."""
    shared = {"taps": "taps"}
    sources = [*sources]
    for quantity, key in (("what_error", "what_unit"), ("where_error", "where_unit"), ("way", "where_unit")):
        units = {str(source[key]) for source in sources}
        if len(units) == 1:
            shared[quantity] = units.pop()
    return shared
