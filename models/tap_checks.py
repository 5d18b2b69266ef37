"""Checks of the arrays of a tap set."""

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from .errors import InputError
from .preprocessing import Preprocessing

_DIMS = {
    "taps": ("tap", "sample", "taxel"),
    "what": ("tap",),
    "where": ("tap",),
    "session": ("tap",),
    "trial": ("tap",),
    "what_name": ("what_class",),
    "what_value": ("what_class",),
    "where_value": ("where_class",),
    "where_edges": ("where_edge",),
    "where_place": ("where_class", "plane"),
    "taxel_position": ("taxel", "axis"),
}
RESERVED = {"time", *_DIMS, *(dim for dims in _DIMS.values() for dim in dims)}
"""Names of the arrays and axes of a tap set, which no further array may have."""
_OPTIONAL = ("what_value", "where_edges", "where_place", "taxel_position")


def check_shapes(dataset: xr.Dataset) -> None:
    """Checks that all arrays are there, with their dims, and samples of at least one tap.

    Raises:
        InputError: One is missing, has other dims or holds no numbers.
    """
    _check_dims(dataset)
    sizes, kind = dataset.sizes, dataset.variables["taps"].dtype
    if min(sizes["tap"], sizes["sample"], sizes["taxel"]) < 1:
        raise InputError(f"taps must not be empty, got shape {dataset['taps'].shape}.")
    if kind.kind not in "fiub":
        raise InputError(f"taps must hold numbers, got {kind}.")


def check_values(dataset: xr.Dataset, extremes: NDArray[Any]) -> None:
    """Checks labels, tables and samples.

    Args:
        dataset: Of the right shapes.
        extremes: Lowest and highest sample of each tap, shape (N, 2), or of each tap and taxel, shape (N, 2, K).

    Raises:
        InputError: A value is not finite, points outside its table or contradicts another.
    """
    sizes, may_miss = dataset.sizes, dataset.attrs.get("missing") == "drop"
    wrong = (np.isinf(extremes) if may_miss else ~np.isfinite(extremes)).reshape(sizes["tap"], -1).any(axis=1)
    if wrong.any():
        tap = int(wrong.argmax())
        _check_finite("taps", dataset.variables["taps"][tap : tap + 1].values, may_miss, tap)
    for name in ("where", "what_value", "where_value", "where_edges", "where_place", "taxel_position"):
        if name in dataset.variables:
            _check_finite(name, dataset[name].values)
    for name, values in dataset.data_vars.items():
        if values.dtype.kind == "f" and name != "taps":
            _check_finite(str(name), values.values)
    for name in ("what", "session", "trial"):
        if dataset[name].dtype.kind not in "iu":
            raise InputError(f"{name} must hold integers, got {dataset[name].dtype}.")
    _check_labels("what", dataset["what"].values, sizes["what_class"])
    names = [str(name) for name in dataset["what_name"].values]
    if len(set(names)) != len(names):
        raise InputError(f"what_name has a repeated name: {names}.")
    if not np.all(np.diff(dataset["where_value"].values) > 0):
        raise InputError("where_value must increase.")
    if "where_edges" in dataset and sizes["where_edge"] != sizes["where_class"] + 1:
        raise InputError(f"where_edges must have {sizes['where_class'] + 1} values, got {sizes['where_edge']}.")
    if "where_place" in dataset and ("where_edges" in dataset or sizes["plane"] not in (2, 3)):
        raise InputError("where_place must be x and y, or x, y and an angle, of positions without edges.")
    record = Preprocessing.from_json(dataset.attrs.get("preprocessing", ""))
    if record.samples != sizes["sample"]:
        raise InputError(f"preprocessing has {record.samples} samples, but taps have {sizes['sample']}.")


def _check_dims(dataset: xr.Dataset) -> None:
    for name, dims in _DIMS.items():
        if name in dataset.variables:
            if dataset[name].dims != dims:
                raise InputError(f"{name} must have dims {dims}, got {dataset[name].dims}.")
        elif name not in _OPTIONAL:
            raise InputError(f"Missing array {name}.")


def _check_finite(name: str, values: NDArray[Any], may_miss: bool = False, first: int = 0) -> None:
    """Checks values, of which the first has this index."""
    if values.dtype.kind not in "fiub":
        raise InputError(f"{name} must hold numbers, got {values.dtype}.")
    bad = np.argwhere(np.isinf(values) if may_miss else ~np.isfinite(values))
    if len(bad):
        place = ", ".join(str(int(i)) for i in bad[0] + first * (np.arange(bad.shape[1]) == 0))
        value = values[tuple(bad[0])]
        raise InputError(f"{name}[{place}] is {value}; {not_finite(value, sample=name == 'taps')}")


def not_finite(value: Any, sample: bool) -> str:
    """Says that a value is refused, and how samples that are NaN can be left out."""
    told = "NaN and infinite values are not accepted"
    if not sample or not np.isnan(value):
        return f"{told}."
    return (
        f"{told}. convert, inspect, fit, compare, crosscheck, reproduce, trials, tune and perceive accept samples that "
        'are NaN with --missing drop (missing="drop").'
    )


def _check_labels(name: str, values: NDArray[Any], size: int) -> None:
    bad = np.flatnonzero((values < 0) | (values >= size))
    if len(bad):
        raise InputError(f"{name}[{bad[0]}] is {values[bad[0]]}, outside its table of {size} entries.")
