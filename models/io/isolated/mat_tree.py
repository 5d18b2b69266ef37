"""Unpacks a MATLAB file of version 5 to 7 into plain bytes and a description of them, as SciPy may crash.

In the description `a` is an array with type, size and place, `t` a column of texts, `c` a cell array, `s` a struct
array, and `x` the class of what is neither; elements are in MATLAB's order, by column.
"""

import json
import warnings
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque, matfile_version
from scipy.sparse import issparse

_DEEPEST = 48
_NAME, _CLASS = ("s0",), ("_Class", "s2")  # of an object, as SciPy from 1.18 on and before calls them


def _complex_places(content: Any, prefix: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where there are complex numbers, by the keys, fields and places that lead there."""
    for key, value in content:
        way = (*prefix, key)
        if isinstance(value, MatlabOpaque) or not isinstance(value, np.ndarray) or len(way) > _DEEPEST:
            continue
        if value.dtype.kind == "c":
            yield way
        for name in value.dtype.names or ():
            yield from _complex_places(enumerate(_by_column(value[name])), (*way, name))
        if value.dtype == object:
            yield from _complex_places(enumerate(_by_column(value)), way)


def _described(
    value: Any, file: BinaryIO, unreal: Collection[tuple[Any, ...]] = (), way: tuple[Any, ...] = ()
) -> dict[str, Any]:
    if kind := _refused(value) or ("complex" if way in unreal else ""):
        return {"x": kind}
    if len(way) > _DEEPEST:
        raise ValueError

    def elements(values: NDArray[Any], *name: str) -> list[dict[str, Any]]:
        return [_described(each, file, unreal, (*way, *name, i)) for i, each in enumerate(_by_column(values))]

    size = list(value.shape)
    if value.dtype.names is not None:
        return {"s": {name: elements(value[name], name) for name in value.dtype.names}, "size": size}
    if value.dtype == object:
        if any(each is None for each in value.flat):  # as SciPy reads a struct without fields
            return {"s": {}, "size": size}
        return {"c": elements(value), "size": size}
    return _plain(value, file)


def _plain(value: NDArray[Any], file: BinaryIO) -> dict[str, Any]:
    if value.dtype.kind == "U":
        return {"t": [row.rstrip() for row in _by_column(value)]}
    place = file.tell()
    np.asfortranarray(value).T.tofile(file)
    return {"a": value.dtype.str, "size": list(value.shape), "at": place}


def _refused(value: Any) -> str:
    """Class of what is neither numbers nor texts, cells or structs; else empty."""
    if isinstance(value, MatlabObject):
        return value.classname or "object"
    if isinstance(value, MatlabOpaque):
        return _of_object(value, _CLASS)
    return "function_handle" if isinstance(value, MatlabFunction) else "sparse" if issparse(value) else ""


def _by_column(values: NDArray[Any]) -> list[Any]:
    return values.reshape(-1, order="F").tolist() if values.dtype != object else list(values.reshape(-1, order="F"))


def _of_object(value: Any, names: Collection[str]) -> str:
    """What SciPy says of an object in a field of one of these names, empty if there is none."""
    found = [name for name in names if isinstance(value, MatlabOpaque) and name in (value.dtype.names or ())]
    told = value.reshape(-1)[0][found[0]] if found else ""
    return told.decode("utf-8", "replace") if isinstance(told, bytes) else str(told)


def read(path: str, folder: str) -> None:
    """Unpacks a file into `data` and `tree.json` in a folder.

    Raises:
        ValueError: It is of another version, or nested too deep.
        Exception: What SciPy raises on damaged bytes.
    """
    if matfile_version(path)[0] != 1:
        raise ValueError
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        content = loadmat(path, mat_dtype=True)
    unreal: frozenset[tuple[Any, ...]] = frozenset()
    if any(issubclass(each.category, np.exceptions.ComplexWarning) for each in told):  # their imaginary part is lost
        unreal = frozenset(_complex_places(loadmat(path).items()))
    with Path(folder, "data").open("wb") as file:
        tree = {}
        for name in [name for name in content if not name.startswith("__")]:
            value = content.pop(name)
            tree[_of_object(value, _NAME) or name] = _described(value, file, unreal, (name,))
    Path(folder, "tree.json").write_text(json.dumps(tree), encoding="utf-8")
