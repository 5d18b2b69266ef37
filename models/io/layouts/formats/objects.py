"""Rows that are objects, as in JSON and in messages: names of their fields, and values as arrays."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import InputError
from .columns import Part, stacked
from .contents import Values, Variable

type Path = tuple[str, ...]
_SHOWN = 40


def fields(row: object, before: Path = ()) -> Iterator[tuple[Path, object]]:
    """Paths and values of all fields of a row, those of nested objects and of objects in lists as well."""
    found = row
    while isinstance(found, list) and found and isinstance(found[0], dict | list):
        found = found[0]
    if isinstance(found, dict):
        for key, value in found.items():
            yield from fields(value, (*before, key))
    elif before:
        yield before, row


def variables(rows: Sequence[object], length: int | None) -> tuple[dict[str, Variable], dict[str, Path]]:
    """Variables of the fields of some rows, and the path of each.

    Args:
        rows: The rows.
        length: Number of all rows; `None` if it is unknown.
    """
    found: dict[str, Variable] = {}
    paths: dict[str, Path] = {}
    lists: set[str] = set()
    for row in rows:
        for path, value in fields(row):
            name = ".".join(path)
            paths.setdefault(name, path)
            is_list = _is_list(row, path)
            kind = _kind(value)
            if name not in found or (kind == "U") > (found[name].dtype.kind == "U"):
                found[name] = Variable((length,), np.dtype(np.str_ if kind == "U" else np.float64))
            if is_list:
                lists.add(name)
    return {name: _with_elements(each) if name in lists else each for name, each in found.items()}, paths
