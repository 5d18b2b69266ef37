"""Reader for exported models, see `io.export`: counts give a histogram model, probabilities a table model."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, check_format
from ..grid import ClassGrid
from ..measurement.histogram import HistogramModel
from ..measurement.model import TapModel
from ..measurement.table import TableModel
from ..preprocessing import Preprocessing
from ..settings import check_saturation, likelihood_exponent
from ..storage import read_object
from .export import FORMAT, prior

_ROUNDING = 1e-9
_MOST_NAMED, _MOST_SHOWN = 5, 200
_SIZES = ("L", "M", "K", "J", "B")


def load_exported(path: str | Path) -> TapModel:
    """Model from an exported file, without its parameters for decisions and moves.

    Raises:
        InputError: The file is missing, damaged or not an exported model; the message names file and key.
    """
    values = read_object(path, "model")
    if "kind" in values:
        check_format(values.get("format"), f"{path}: an exported model", FORMAT)
    if values.get("format") != FORMAT or "kind" not in values:
        raise InputError(
            f"{path}: not a model but {_other(values)}; a model is a .nc file from `fit` or a .json "
            "file from `export-model`."
        )
    try:
        return _model(values)
    except KeyError as error:
        raise InputError(f"{path}: not an exported model: missing key {error.args[0]}.") from error
    except InputError as error:
        raise InputError(f"{path}: damaged: {error}") from error


def _other(values: dict[str, Any]) -> str:
    """What a JSON object is that is no model."""
    if values.get("format") == "solidtouch episodes":
        return "recorded episodes, for `view`"
    if {"model", "threshold", "power"} <= values.keys():
        return "a setting, for --setting"
    keys = ", ".join(list(values)[:_MOST_NAMED]) or "none"
    return f"a JSON object with the keys {keys}"[:_MOST_SHOWN]


def _model(values: dict[str, Any]) -> TapModel:
    L, M, K, J, B = (_size(values, key) for key in _SIZES)
    grid = _named("grid", ClassGrid.from_dict, values["grid"])
    if (grid.L, grid.M) != (L, M):
        raise InputError(f"grid has {grid.L} x {grid.M} classes, but L and M are {L} and {M}.")
    common: dict[str, Any] = {
        "grid": grid,
        "edges": _edges(values, K, B),
        "power": values["power"],
        "preprocessing": _named("preprocessing", _preprocessing, values["preprocessing"]),
        "trained_on": _text(values, "trained_on"),
        "version": _text(values, "version"),
        "saturation": _saturation(values["saturation"]),
    }
    if common["preprocessing"].samples != J:
        raise InputError(f"preprocessing has {common['preprocessing'].samples} samples, but J is {J}.")
    if not isinstance(values["power"], str) and not _is_number(values["power"]):
        raise InputError(f"power must be J, JK, none or a positive number, got {values['power']!r}.")
    _named("power", likelihood_exponent, values["power"], J, K)
    if ("counts" in values) == ("probabilities" in values):
        raise InputError("it must have either key counts or key probabilities.")
    make = _histogram if "counts" in values else _table
    model = make(values, (L, M, K, B), common)
    _check_names(values, model)
    return model


def _histogram(values: dict[str, Any], shape: tuple[int, ...], common: dict[str, Any]) -> HistogramModel:
    counts, pseudocount = _array(values, "counts", shape), values["pseudocount"]
    if (counts < 0).any() or counts.dtype.kind != "i":
        raise InputError("counts must be integers of at least 0.")
    if not _is_number(pseudocount) or pseudocount < 0:
        raise InputError(f"pseudocount must be at least 0, got {pseudocount!r}.")
    samples = counts.sum(axis=-1)
    if pseudocount == 0 and (samples == 0).any():
        raise InputError("counts has an empty histogram; this needs a pseudocount.")
    trained = samples.any(axis=-1)
    if not trained.any():
        raise InputError("counts are all 0.")
    return HistogramModel(
        counts=counts.astype(np.int64),
        pseudocount=float(pseudocount),
        left_out=common["grid"].untouched(trained),
        **common,
    )


def _table(values: dict[str, Any], shape: tuple[int, ...], common: dict[str, Any]) -> TableModel:
    probabilities = _array(values, "probabilities", shape).astype(np.float64)
    possible = probabilities.any(axis=(2, 3))
    if not possible.any():
        raise InputError("probabilities has no possible class.")
    left_out = common["grid"].untouched(possible)
    return _named("probabilities", lambda: TableModel(probabilities=probabilities, left_out=left_out, **common))


def _check_names(values: dict[str, Any], model: TapModel) -> None:
    """Checks that redundant keys agree, as other programs read them instead of the grid."""
    if values["where_unit"] != model.grid.where_unit or values["what_name"] != list(model.grid.what_name):
        raise InputError("where_unit or what_name differs from that of its grid.")
    if not _close(values, "where_value", model.grid.where_value):
        raise InputError("where_value differs from that of its grid.")
    if not _close(values, "prior", prior(model)):
        raise InputError("prior is not uniform over the possible classes; other priors are not supported.")


def _close(values: dict[str, Any], key: str, expected: NDArray[np.float64]) -> bool:
    return np.allclose(_array(values, key, expected.shape), expected, rtol=_ROUNDING, atol=0.0)


def _edges(values: dict[str, Any], K: int, B: int) -> NDArray[np.float64]:
    nested = isinstance(values["edges"], list) and values["edges"] and isinstance(values["edges"][0], list)
    edges = _array(values, "edges", (K, B + 1) if nested else (B + 1,)).astype(np.float64)
    if not (np.diff(edges) > 0).all():
        raise InputError("edges do not increase.")
    return edges


def _array(values: dict[str, Any], key: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """An array of finite numbers."""
    try:
        array = np.asarray(values[key])
    except ValueError:
        raise InputError(f"{key} holds lists of different lengths.") from None
    if array.dtype.kind not in "if" or not np.isfinite(array).all():
        raise InputError(f"{key} must hold finite numbers.")
    if array.shape != shape:
        raise InputError(f"{key} must have shape {shape}, got {array.shape}.")
    return array


def _size(values: dict[str, Any], key: str) -> int:
    size = values[key]
    if not isinstance(size, int) or isinstance(size, bool) or size < 1:
        raise InputError(f"{key} must be an integer of at least 1, got {size!r}.")
    return size


def _text(values: dict[str, Any], key: str) -> str:
    if not isinstance(values[key], str):
        raise InputError(f"{key} must be text, got {values[key]!r}.")
    return values[key]


def _saturation(value: Any) -> float:
    if value is None:
        return np.inf
    if not _is_number(value):
        raise InputError(f"saturation must be a number of taps or null, got {value!r}.")
    _named("saturation", check_saturation, value)
    return float(value)


def _preprocessing(fields: Any) -> Preprocessing:
    try:
        return Preprocessing(**fields)
    except TypeError as error:
        raise InputError("not a preprocessing record.") from error


def _named(key: str, make: Any, *arguments: Any) -> Any:
    """Result of a function of a value; puts the key in front of its error messages."""
    try:
        return make(*arguments)
    except (InputError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{key}: {error}") from error


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
