"""Named arrays, as in `.npz` and `.mat` files, to a `Recording`.

=====================  =====================  ==================================================================
name                   shape                  meaning
=====================  =====================  ==================================================================
``taps``               (N, J, K)              cut taps; or ``stream``
``stream``             (S, K)                 frames of continuous streams; the labels below then have S rows
``what``               (N,)                   index into ``what_names``, counted from 0
``what_names``         (M,)                   names of the objects
``where``              (N,)                   index into ``where_values``; without that table the position itself
``where_values``       (L,)                   nominal positions
``where_edges``        (L + 1,)               edges of the position classes, if they are intervals
``where_unit``         text                   unit of the positions
``what_values``        (M,)                   size of each object; its unit in ``what_unit``
``session``            (N,)                   number of the recording session
``trial``              (N,)                   number of the tap within its session or class
``taxel_position``     (K, 2) or (K, 3)       millimetres
``units``              text                   unit of the samples
``meta``               JSON text              keys sensor, rate_hz, licence, source, repo, path, note
=====================  =====================  ==================================================================

``taps`` (or ``stream``), ``what`` and ``what_names`` are required. Every further array of shape (N,) or (N, K) is kept
under its own name.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..settings import Missing
from .layouts.formats.contents import Contents, TextTable, Variable
from .layouts.formats.registry import open_contents
from .recording import Labels, Recording, as_samples, check_real, naming

KNOWN = {
    *("taps", "stream", "what", "where", "session", "trial", "taxel_position", "what_names", "what_values"),
    *("where_values", "where_edges", "where_unit", "what_unit", "units", "meta"),
}
_MOST_RATE = 1e12
Arrays = Mapping[str, NDArray[Any]]


def read_arrays(path: Path, missing: Missing = "refuse") -> Recording:
    """Recording from a `.npz` or `.mat` file, of which only what a tap set holds is read.

    Raises:
        InputError: The file is damaged, or as `recording_from_arrays`; the message names it.
    """
    contents = open_contents(path, TextTable())
    with naming(path):
        declared = _declared(contents)
        samples = declared[_check_layout(declared)]
        used = [name for name, each in declared.items() if _is_used(name, each, samples)]
        values = contents.read(used)[0].items()
        arrays = {name: np.reshape(of, [n or 0 for n in declared[name].shape]) for name, of in values}
        recording = recording_from_arrays(arrays, missing)
    unused = {name: f"not one row per tap, {each.shape}" for name, each in declared.items() if name not in used}
    told = sorted({**unused, **contents.unreadable}.items())
    return replace(recording, left_out=tuple(f"Array {name} is left out: {why}." for name, why in told))


def _declared(contents: Contents) -> dict[str, Variable]:
    """What a file says of its arrays.

    Raises:
        InputError: One that is needed cannot be read.
    """
    found = dict(contents.variables)
    for name in sorted(KNOWN if found else contents.unreadable):
        if name in contents.unreadable:
            raise InputError(f"array {name} cannot be read: {contents.unreadable[name]}.")
        if name in found and None in found[name].shape:
            raise InputError(
                f"array {name}: its elements differ in shape; taps of different lengths need a map (--map)."
            )
    return _with_dropped_axes(found) if contents.path.suffix.lower() == ".mat" else found


def _with_dropped_axes(found: dict[str, Variable]) -> dict[str, Variable]:
    """Arrays of MATLAB, which has no trailing axes of length one, with those of this layout."""
    one_tap = "what" in found and found["what"].shape == (1,)
    for name, axes in {"taps": 3, "stream": 2, "taxel_position": 2}.items():
        if name in found:
            shape = found[name].shape
            if len(shape) == 1 and (name == "taxel_position" or (name == "taps" and one_tap)):
                shape = (1, *shape)
            found[name] = replace(found[name], shape=(*shape, *[1] * (axes - len(shape))))
    return found


def recording_from_arrays(arrays: Arrays, missing: Missing = "refuse") -> Recording:
    """Recording from the arrays listed at the head of this file.

    Raises:
        InputError: An array is missing or has the wrong shape or content, or labels point outside their table; the
            message names the array and the place.
    """
    name = _check_layout(arrays)
    samples = as_samples(name, arrays[name], missing)
    meta = _meta(arrays)
    what, names = _whole(arrays, "what", len(samples)), _names(arrays)
    _check_range("what", what, len(names), "what_names")
    labels = Labels(
        what=what,
        where=_positions(arrays, len(samples)),
        session=_whole(arrays, "session", len(samples), 0),
        trial=_whole(arrays, "trial", len(samples)) if "trial" in arrays else None,
        what_name=names,
        extra={name: arrays[name] for name in sorted(set(arrays) - KNOWN) if _is_used(name, arrays[name], samples)},
        tables=_tables(arrays) | _attributes(meta),
    )
    file = np.zeros(len(samples), dtype=np.int64) if name == "stream" else None
    return Recording(samples, labels, _rate(meta), file)


def _check_layout(arrays: Mapping[str, Any]) -> str:
    """Checks the names, types and shapes of arrays, or of what a file declares of them.

    Returns:
        Name of the array of samples, `"taps"` or `"stream"`.

    Raises:
        InputError: An array is missing or has the wrong type or shape.
    """
    name = "stream" if "stream" in arrays and "taps" not in arrays else "taps"
    samples, what, names = (_required(arrays, each) for each in (name, "what", "what_names"))
    axes = {"taps": "(N, J, K)", "stream": "(S, K)"}[name]
    check_real(name, samples)
    if len(samples.shape) != len(axes.split(",")) or 0 in samples.shape:
        raise InputError(f"array {name} must have shape {axes} without empty axes, got {samples.shape}.")
    check_real("what", what)
    if names.dtype.kind not in "US" or len(names.shape) != 1:
        raise InputError(f"array what_names must be a list of text, got {names.dtype} of shape {names.shape}.")
    if not names.shape[0]:
        raise InputError("array what_names is empty.")
    return name


def _is_used(name: str, values: Any, samples: Any) -> bool:
    """Whether a tap set holds an array, by its name or because it has one row, of one or K numbers, per tap."""
    n, k = samples.shape[0], samples.shape[-1]
    return name in KNOWN or (values.shape in ((n,), (n, k)) and values.dtype.kind in "fiubU")


def _required(arrays: Mapping[str, Any], name: str) -> Any:
    if name not in arrays:
        there = ", ".join(sorted(arrays)) or "none"
        raise InputError(
            f"missing array {name}; the file holds: {there}. Of another layout, solidtouch convert --look shows more."
        )
    return arrays[name]


def _vector(arrays: Arrays, name: str, length: int | None = None) -> NDArray[np.float64]:
    """A finite numeric vector as float64."""
    values = _required(arrays, name)
    if values.ndim != 1 or (length is not None and len(values) != length):
        expected = "one axis" if length is None else f"shape ({length},)"
        raise InputError(f"array {name} must have {expected}, got shape {values.shape}.")
    return as_samples(name, values, None).astype(np.float64)


def _whole(arrays: Arrays, name: str, length: int, default: int | None = None) -> NDArray[np.int64]:
    """A vector of integers; MATLAB stores them as doubles."""
    if default is not None and name not in arrays:
        return np.full(length, default, dtype=np.int64)
    values = _vector(arrays, name, length)
    bad = np.flatnonzero(values != np.round(values))
    if len(bad):
        raise InputError(f"{name}[{bad[0]}] is {values[bad[0]]:g}, not an integer.")
    return values.astype(np.int64)


def _check_range(name: str, index: NDArray[np.int64], size: int, table: str) -> None:
    bad = np.flatnonzero((index < 0) | (index >= size))
    if len(bad):
        hint = "; indices count from 0" if index.min() == 1 and index.max() == size else ""
        raise InputError(f"{name}[{bad[0]}] is {index[bad[0]]}, outside the {size} entries of {table}{hint}.")


def _names(arrays: Arrays) -> tuple[str, ...]:
    return tuple(_decoded(name) for name in arrays["what_names"])


def _decoded(text: Any) -> str:
    return text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)


def _text(arrays: Arrays, name: str) -> str:
    if name not in arrays:
        return ""
    value = arrays[name]
    if value.dtype.kind not in "US" or value.size > 1:
        raise InputError(f"array {name} must be one text, got {value.dtype} of shape {value.shape}.")
    return _decoded(value.reshape(-1)[0]) if value.size else ""


def _positions(arrays: Arrays, n: int) -> NDArray[np.float64]:
    """Position of each row, from `where_values` if present."""
    if "where_values" not in arrays:
        return _vector(arrays, "where", n) if "where" in arrays else np.zeros(n)
    table = _vector(arrays, "where_values")
    index = _whole(arrays, "where", n, 0 if len(table) == 1 else None)
    _check_range("where", index, len(table), "where_values")
    return table[index]


def _tables(arrays: Arrays) -> dict[str, Any]:
    tables: dict[str, Any] = {"where_unit": _text(arrays, "where_unit"), "units": _text(arrays, "units")}
    if "where_values" in arrays:
        values = np.sort(_vector(arrays, "where_values"))
        twice = np.flatnonzero(np.diff(values) == 0)
        if len(twice):
            raise InputError(f"array where_values contains {values[twice[0]]:g} twice.")
        tables["where_value"] = values
        if "where_edges" in arrays:
            tables["where_edges"] = _vector(arrays, "where_edges", len(values) + 1)
    if tables["where_unit"] == "none" and len(tables.get("where_value", [0.0])) == 1:
        tables["where_unit"] = ""
    if "what_values" in arrays:
        tables["what_value"] = _vector(arrays, "what_values", len(_names(arrays)))
        tables["what_unit"] = _text(arrays, "what_unit")
    if "taxel_position" in arrays:
        tables["taxel_position"] = as_samples("taxel_position", arrays["taxel_position"], None)
    return tables


def _meta(arrays: Arrays) -> dict[str, Any]:
    text = _text(arrays, "meta")
    try:
        meta = json.loads(text) if text else {}
    except (ValueError, RecursionError) as error:
        raise InputError(f"array meta is not JSON: {error}.") from error
    if not isinstance(meta, dict):
        raise InputError(f"array meta must be a JSON object, got {text[:40]!r}.")
    return meta


def _rate(meta: Mapping[str, Any]) -> float | None:
    rate = meta.get("rate_hz")
    if rate is None:
        return None
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0 < rate <= _MOST_RATE:
        raise InputError(f"array meta: rate_hz must be a positive number up to {_MOST_RATE:g}, got {rate!r:.40}.")
    return float(rate)


def _attributes(meta: Mapping[str, Any]) -> dict[str, str]:
    place = " ".join(str(meta[key]) for key in ("source", "repo", "path") if meta.get(key))
    return {
        "sensor": str(meta.get("sensor", "")),
        "licence": str(meta.get("licence", meta.get("license", ""))),
        "source": "; ".join(part for part in (place, str(meta.get("note", ""))) if part),
    }
