"""Workspaces of MATLAB: random ones, files of both versions as MATLAB writes them, and what a reader must find.

A workspace is a dictionary of arrays, texts, lists of texts, `Cells` of arrays, dictionaries for structs, and lists of
dictionaries for struct arrays.
"""

from itertools import count
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as of_numpy
from scipy.io import savemat

LETTERS = st.characters(min_codepoint=33, max_codepoint=0x2FFF, exclude_categories=("Cs", "Zs", "Zl", "Zp", "Cc"))
NAMES = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)
KINDS = st.sampled_from([np.float64, np.float32, np.int8, np.uint16, np.int32, np.int64, np.bool_])


_NUMBERS = count()


class Cells(list):
    """A cell array of one row, or of the shape of an array of objects."""


def arrays(least: int = 0, axes: int = 3) -> st.SearchStrategy[Any]:
    """Arrays without trailing axes of length one, which MATLAB lacks."""
    shapes = of_numpy.array_shapes(min_dims=1, max_dims=axes, min_side=least, max_side=4)
    shapes = shapes.filter(lambda shape: len(shape) < 3 or shape[-1] > 1)
    return KINDS.flatmap(
        lambda kind: of_numpy.arrays(
            kind, shapes, elements={"allow_nan": False} if np.dtype(kind).kind == "f" else None
        )
    )


TEXTS = st.text(LETTERS, max_size=5)
PLAIN = arrays() | TEXTS
CELLS = st.lists(arrays(axes=2), min_size=2, max_size=4).map(Cells) | st.lists(TEXTS, min_size=1, max_size=4)


@st.composite
def struct_arrays(draw: Any) -> list[dict[str, Any]]:
    """Struct arrays of at least two elements, whose fields are numbers, texts or structs."""
    number = draw(st.integers(2, 4))
    found: list[dict[str, Any]] = [{} for _ in range(number)]
    for name in draw(st.lists(NAMES, min_size=1, max_size=3, unique=True)):
        values = draw(st.sampled_from([arrays(axes=2), TEXTS, st.fixed_dictionaries({"k": arrays(1, 1), "t": TEXTS})]))
        for each in found:
            each[name] = draw(values)
    return found


WORKSPACES = st.dictionaries(
    NAMES, PLAIN | CELLS | struct_arrays() | st.dictionaries(NAMES, PLAIN | CELLS, min_size=1, max_size=3), max_size=5
)


def expected(workspace: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Variables as the reader must return them."""
    found: dict[str, Any] = {}
    for name, value in workspace.items():
        if isinstance(value, dict):
            found |= expected(value, f"{prefix}{name}.")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for key in value[0]:
                column = [each[key] for each in value]
                column = Cells(column) if not isinstance(column[0], dict) else column
                found |= expected({f"{name}.{key}": column}, prefix)
        elif isinstance(value, list):
            found[prefix + name] = _elements(value)
        elif isinstance(value, str):
            found[prefix + name] = np.array([value])
        else:
            found[prefix + name] = value.reshape(_squeezed(_size(value)))
    return found


def _size(value: Any) -> tuple[int, ...]:
    """As MATLAB has it; a vector is a row."""
    return (1, 1)[: 2 - value.ndim] + value.shape if value.ndim < 2 else value.shape


def _squeezed(size: tuple[int, ...]) -> tuple[int, ...]:
    if len(size) == 2 and 1 in size:
        return (size[0] * size[1],) if size != (1, 1) else (1,)
    return (0,) if size == (0, 0) else size


def _elements(values: list[Any]) -> Any:
    if isinstance(values[0], str):
        return np.array(values)
    sizes = [_size(value) for value in values if _size(value) != (0, 0)]
    blank = [_size(value) == (0, 0) for value in values]
    kept = [value for value, none in zip(values, blank, strict=True) if not none]
    dtype = np.result_type(*(value.dtype for value in kept)) if kept else np.float64
    if not kept:
        return np.empty((len(values), 0))
    if all(np.prod(size) == 1 for size in sizes):
        return np.array([np.nan if none else value.reshape(-1)[0] for value, none in zip(values, blank, strict=True)])
    vectors = all(len(size) == 2 and 1 in size for size in sizes)
    most = max(map(len, sizes))
    rest = (sizes[0] + (1,) * most)[1:most]
    shapes = [
        (value.size,) if vectors else (0, *rest) if none else (_size(value) + (1,) * most)[:most]
        for value, none in zip(values, blank, strict=True)
    ]
    found = [value.astype(dtype).reshape(shape) for value, shape in zip(values, shapes, strict=True)]
    return np.stack(found) if len(set(shapes)) == 1 else found


def same(found: Any, wanted: Any) -> bool:
    """Whether a variable is as expected: its shape, values and kind of type."""
    if isinstance(wanted, list):
        return isinstance(found, list) and len(found) == len(wanted) and all(map(same, found, wanted))
    if not isinstance(found, np.ndarray) or found.shape != wanted.shape:
        return False
    return (found.dtype.kind == "U") == (wanted.dtype.kind == "U") and np.array_equal(
        found, wanted, equal_nan=wanted.dtype.kind == "f"
    )


def write_v5(path: Path, workspace: dict[str, Any]) -> None:
    """As SciPy writes it."""
    savemat(path, {name: _for_scipy(value) for name, value in workspace.items()}, long_field_names=True)


def _for_scipy(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _for_scipy(each) for key, each in value.items()}
    if isinstance(value, list) and isinstance(value[0], dict):
        array = np.zeros((1, len(value)), [(key, object) for key in value[0]])
        for i, each in enumerate(value):
            for key in each:
                array[0, i][key] = _for_scipy(each[key])
        return array
    if isinstance(value, list):
        array = np.empty((1, len(value)), object)
        array[0] = [_for_scipy(each) for each in value] if len(value) > 1 else [None]
        if len(value) == 1:
            array[0, 0] = _for_scipy(value[0])
        return array
    return value if isinstance(value, str) else value.reshape(_size(value))


def write_v73(path: Path, workspace: dict[str, Any]) -> None:
    """HDF5 as MATLAB writes it."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in workspace.items():
            _put(file, file, name, value)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b" "))


def _put(file: Any, group: Any, name: str, value: Any) -> Any:
    if isinstance(value, dict):
        return _struct(file, group, name, value, value)
    if isinstance(value, list) and isinstance(value[0], dict):
        return _struct(file, group, name, {key: [each[key] for each in value] for key in value[0]}, None)
    if isinstance(value, list):
        return _classed(_references(file, group, name, value), "cell")
    if isinstance(value, str):
        codes = np.frombuffer(value.encode("utf-16-le"), "<u2").reshape(-1, 1)
        return _classed(_array(group, name, codes, (0, 0)), "char", MATLAB_int_decode=np.int32(2))
    size = _size(value)
    numbers = value.reshape(size).T
    if value.dtype == np.bool_:
        return _classed(_array(group, name, numbers.astype("u1"), size), "logical", MATLAB_int_decode=np.int32(1))
    kinds = {"float64": "double", "float32": "single"}
    return _classed(_array(group, name, numbers, size), kinds.get(value.dtype.name, value.dtype.name))


def _array(group: Any, name: str, numbers: Any, size: tuple[int, ...]) -> Any:
    if numbers.size:
        return group.create_dataset(name, data=numbers)
    node = group.create_dataset(name, data=np.array(size, "u8"))
    node.attrs["MATLAB_empty"] = np.uint8(1)
    return node


def _classed(node: Any, kind: str, **more: Any) -> Any:
    node.attrs["MATLAB_class"] = np.bytes_(kind)
    node.attrs.update(more)
    return node


def _references(file: Any, group: Any, name: str, values: list[Any]) -> Any:
    kept = file.require_group("#refs#")
    to = [_put(file, kept, f"n{next(_NUMBERS)}", value).ref for value in values]
    node = group.create_dataset(name, (len(to), 1), h5py.ref_dtype)
    node[:, 0] = to
    return node


def _struct(file: Any, group: Any, name: str, fields: dict[str, Any], single: Any) -> Any:
    node = _classed(group.create_group(name), "struct")
    letters = np.empty(len(fields), object)
    letters[:] = [np.array([letter.encode() for letter in key], "S1") for key in fields]
    node.attrs.create("MATLAB_fields", letters, dtype=h5py.vlen_dtype(np.dtype("S1")))
    for key, value in fields.items():
        _references(file, node, key, value) if single is None else _put(file, node, key, value)
    return node
