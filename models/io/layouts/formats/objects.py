"""Rows that are objects, as in JSON and in messages: names of their fields, and values as arrays."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import InputError
from .columns import Part, stacked
from .contents import Values, Variable

type Path = tuple[str, ...]
REST = "the rest of the file"
"""Name of what is not read where only the begin of a file is."""
_NUMBER, _TEXT = np.dtype(np.float64), np.dtype(np.str_)
_SHOWN = 40


def value_at(row: Any, path: Path) -> Any:
    """Value of a field, `None` where it is missing; of objects in a list, a list."""
    for depth, key in enumerate(path):
        if isinstance(row, list):
            return [value_at(each, path[depth:]) for each in row]
        row = row.get(key) if isinstance(row, dict) else None
    return row


def _paths(row: object, before: Path = ()) -> Iterator[Path]:
    """All fields, those of nested objects and of objects in lists as well."""
    while isinstance(row, list) and row and isinstance(row[0], dict | list):
        row = row[0]
    if isinstance(row, dict):
        for key, value in row.items():
            yield from _paths(value, (*before, key))
    elif before:
        yield before


def fields(rows: Iterable[object], length: int | None = None) -> tuple[dict[str, Variable], dict[str, Path]]:
    """Variables of the fields of the first rows, whose names are joined by `.`, and the path of each.

    Args:
        rows: These rows.
        length: Number of all rows; `None` if it is unknown.
    """
    found: dict[str, Variable] = {}
    paths: dict[str, Path] = {}
    for row in rows:
        for path in _paths(row):
            name, value = ".".join(path), value_at(row, path)
            if paths.setdefault(name, path) == path and value is not None:
                found[name] = _wider(found.get(name), value, length)
    inner = {path[:depth] for path in paths.values() for depth in range(1, len(path))}
    kept = {name: path for name, path in paths.items() if path not in inner}
    return {name: found.get(name, Variable((length,), _NUMBER)) for name in kept}, kept


def _wider(known: Variable | None, value: object, length: int | None) -> Variable:
    """Variable that also holds this value."""
    shape, item = _shape(value)
    dtype = _TEXT if isinstance(item, str) else _NUMBER
    if known is None:
        return Variable((length, *shape), dtype)
    rest = known.shape[1:]
    if len(rest) == len(shape):
        rest = tuple(a if a == b else None for a, b in zip(rest, shape, strict=True))
    elif len(shape) > len(rest):
        rest = (None,) * len(shape)
    return Variable((length, *rest), _TEXT if _TEXT in (dtype, known.dtype) else _NUMBER)


def _shape(value: object) -> tuple[tuple[int, ...], object]:
    """Shape of nested lists by their first items, and the first of these that is none."""
    shape = ()
    while isinstance(value, list | bytes):
        shape += (len(value),)
        value = next((each for each in value if each is not None), None)
    return shape, value


def part(
    rows: Sequence[object],
    names: Sequence[tuple[Path, Variable]],
    columns: Sequence[Path],
    place: Callable[[int], str],
) -> Part:
    """Fields of rows as arrays.

    Args:
        rows: The rows.
        names: Paths of the fields that are read as they are, and what they hold.
        columns: Paths of numbers that are read side by side.
        place: Where a row stands, for messages.

    Raises:
        InputError: A value is not what the first rows hold, or a text or list is missing.
    """
    numbers = np.empty((len(rows), len(columns)))
    for j, path in enumerate(columns):
        numbers[:, j] = _column(rows, path, _number, place, _NUMBER)
    return Part([_values(rows, path, each, place) for path, each in names], numbers)


def _values(rows: Sequence[object], path: Path, variable: Variable, place: Callable[[int], str]) -> Values:
    if len(variable.shape) > 1:
        return stacked(_each(rows, path, _element, place))
    return _column(rows, path, _text if variable.dtype == _TEXT else _number, place, variable.dtype)


def _column(
    rows: Sequence[object], path: Path, convert: Callable[[Any], Any], place: Callable[[int], str], dtype: np.dtype[Any]
) -> NDArray[Any]:
    key = path[0]
    values = [row.get(key) if isinstance(row, dict) else None for row in rows] if len(path) == 1 else None
    if dtype == _NUMBER and values and set(map(type, values)) <= {int, float, bool}:
        return np.array(values, _NUMBER)
    return np.array(_each(rows, path, convert, place), dtype)


def _each(rows: Sequence[object], path: Path, convert: Callable[[Any], Any], place: Callable[[int], str]) -> list[Any]:
    found = []
    for i, row in enumerate(rows):
        try:
            found.append(convert(value_at(row, path)))
        except (InputError, OverflowError) as error:
            raise InputError(f"{place(i)}, {'.'.join(filter(None, path))}: {error}") from error
    return found


def _number(value: object) -> float:
    if value is None:
        return np.nan
    if not isinstance(value, int | float):
        raise InputError(f"{_shown(value)} is not a number.")
    return float(value)


def _text(value: object) -> str:
    if value is None:
        raise InputError("missing.")
    if not isinstance(value, str):
        raise InputError(f"{_shown(value)} is not a text, as others are.")
    return value


def _element(value: object) -> NDArray[Any]:
    """Array of a list of numbers or texts, which may be nested; missing numbers are NaN."""
    if value is None:
        raise InputError("missing.")
    if isinstance(value, bytes):
        return np.frombuffer(value, np.uint8).astype(np.float64)
    if not isinstance(value, list):
        raise InputError(f"{_shown(value)} is not a list, as others are.")
    try:
        found = np.array(value)
    except ValueError as error:
        raise InputError("its inner lists differ in length.") from error
    if found.dtype.kind in "iufb":
        return found.astype(np.float64)
    flat = np.array(value, object)
    if all(isinstance(each, str) for each in flat.flat):
        return found
    return np.array([_number(each) for each in flat.flat]).reshape(flat.shape)


def _shown(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]}..."
