"""Fitted tables as a C header, for compiled robot programs; see docs/how-to/exported-models.md.

It is C99 and C++11, includes only `math.h`, and is self-contained: sizes are macros, tables static constants.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..measurement.model import TapModel
from ..preprocessing import Preprocessing
from ..storage import complete_file
from .export import FORMAT, Decisions, log_tables


def save_c_header(
    model: TapModel, path: str | Path, decisions: Decisions, single: bool = False, force: bool = False
) -> None:
    """Writes a model as a C header, atomically.

    Args:
        model: Model to export.
        path: The file.
        decisions: Parameters for decisions and moves.
        single: Whether numbers are in single precision.
        force: Whether to overwrite an existing file.

    Raises:
        InputError: The model cannot be exported, or the file cannot be written.
    """
    text = c_header(model, decisions, single)
    with complete_file(path, force) as temporary:
        temporary.write_text(text, encoding="utf-8")


def c_header(model: TapModel, decisions: Decisions, single: bool = False) -> str:
    """Text of the header.

    Args:
        model: Model to export.
        decisions: Parameters for decisions and moves.
        single: Whether numbers are in single precision. Edges are then rounded up, so that a sample falls into the same
            bin as in double precision.

    Raises:
        InputError: The model has no tables, or its bins are too narrow for single precision.
    """
    log_prob = log_tables(model)
    edges = np.broadcast_to(model.edges, (model.K, model.edges.shape[-1]))
    names = ", ".join(map(_string, model.grid.what_name))
    lines = [
        *_head(model, single),
        "#ifndef SOLIDTOUCH_MODEL_H",
        "#define SOLIDTOUCH_MODEL_H",
        "",
        "#include <math.h>",
        "",
        *(f"#define SOLIDTOUCH_{name} {value}" for name, value in _macros(model, decisions, single).items()),
        "",
        *_array("edges[SOLIDTOUCH_K][SOLIDTOUCH_B + 1]", _single_edges(edges) if single else edges),
        *_array("log_prob[SOLIDTOUCH_L][SOLIDTOUCH_M][SOLIDTOUCH_K][SOLIDTOUCH_B]", _real(log_prob, single)),
        *_array("log_prior[SOLIDTOUCH_L][SOLIDTOUCH_M]", _real(model.log_prior, single)),
        *_array("where_value[SOLIDTOUCH_L]", _real(model.grid.where_value, single)),
        f"static const char *const solidtouch_what_name[SOLIDTOUCH_M] = {{{names}}};",
        "",
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def _head(model: TapModel, single: bool) -> list[str]:
    """Description of the model, as a comment."""
    grid = model.grid
    said = [
        f"A {model.name} model of touch, exported by solidtouch; fitted by version {model.version or 'unknown'}.",
        f"Data: {model.trained_on or 'not known'}",
        f"where: {grid.L} classes, {grid.where_label(0)} to {grid.where_label(grid.L - 1)}, unit {grid.where_unit!r}",
        f"what: {', '.join(grid.what_name)}",
        f"A tap is {model.preprocessing.samples} samples of {model.K} taxels in the unit of the training taps.",
        f"Preprocessing: {_said(model.preprocessing)}",
        f"Saturation: {_limit(model.saturation)}",
        f"Numbers are in {'single' if single else 'double'} precision, logs are natural, indices count from 0.",
    ]
    return ["/*", *(f" * {_comment(line)}" for line in said), " */"]


def _macros(model: TapModel, decisions: Decisions, single: bool) -> dict[str, object]:
    return {
        "FORMAT": FORMAT,
        "L": model.grid.L,
        "M": model.grid.M,
        "K": model.K,
        "J": model.preprocessing.samples,
        "B": model.edges.shape[-1] - 1,
        "EXPONENT": float(model.exponent),
        "SATURATION": 0.0 if np.isinf(model.saturation) else float(model.saturation),
        "BORDER": _string(decisions.border),
        "THETA_W": float(decisions.threshold),
        "THETA_X": float(decisions.theta_x),
        "FIXATION": decisions.fixation,
        "REAL": "float" if single else "double",
    }


def _said(record: Preprocessing) -> str:
    rate = "unknown rate" if record.rate_hz is None else f"{record.rate_hz!r} Hz"
    used = "" if record.taxels is None else f"taxels {', '.join(map(str, record.taxels))} of the sensor, "
    if record.sensor_hz is not None:
        used += f"resampled from {record.sensor_hz!r} Hz, "
    return (
        f"{used}{record.samples} samples at {rate}, tare {record.tare} over {record.tare_samples} samples, high-pass "
        f"{record.highpass_hz!r} Hz, trigger {record.trigger} at level {record.trigger_level!r}, "
        f"{record.pre_samples} samples before it."
    )


def _limit(saturation: float) -> str:
    if np.isinf(saturation):
        return "none."
    return f"after n taps decide by the belief to the power min(1, {saturation!r} / n), normalised."


def _array(declared: str, values: NDArray[np.floating]) -> Iterator[str]:
    """A definition, one line for each row of the last axis."""
    yield f"static const SOLIDTOUCH_REAL solidtouch_{declared} ="
    yield f"{_braces(values)};"
    yield ""


def _braces(values: NDArray[np.floating]) -> str:
    if values.ndim == 1:
        return f"{{{', '.join(map(_number, values))}}}"
    return "{\n" + ",\n".join(map(_braces, values)) + "\n}"


def _number(value: np.floating) -> str:
    """Shortest constant that represents the number."""
    if np.isneginf(value):
        return "-INFINITY"
    return f"{value!s}f" if value.dtype == np.float32 else str(value)


def _real(values: NDArray[np.float64], single: bool) -> NDArray[np.floating]:
    return values.astype(np.float32) if single else values


def _single_edges(edges: NDArray[np.float64]) -> NDArray[np.float32]:
    """Edges rounded up; `s >= edge` then means the same for every `s` in single precision."""
    rounded = edges.astype(np.float32)
    up = np.where(rounded < edges, np.nextafter(rounded, np.float32(np.inf)), rounded)
    if not (np.diff(up) > 0).all() or not np.isfinite(up).all():
        raise InputError("Single precision (--single) is too coarse for the bins of this model; use double precision.")
    return up


def _string(text: str) -> str:
    """String literal, with anything but plain ASCII as octal bytes of UTF-8 for portability."""
    plain = {*range(32, 127)} - set(b'\\"?')
    return '"' + "".join(chr(byte) if byte in plain else f"\\{byte:03o}" for byte in text.encode()) + '"'


def _comment(text: str) -> str:
    """Text that neither ends nor opens a comment, nor causes compiler warnings."""
    printable = "".join(letter if letter.isprintable() else " " for letter in text)
    for pair in ("*/", "/*", "??"):
        while pair in printable:
            printable = printable.replace(pair, f"{pair[0]} {pair[1]}")
    return printable
