"""Variables of a MATLAB 7.3 file: HDF5 with axes in reverse order, and with references for cells and struct arrays."""

from collections.abc import Sequence
from functools import partial
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .... import storage
from ....errors import InputError
from .hdf5_nodes import OTHER_FILE, inside, is_elsewhere
from .matlab_tree import (
    BYTES_PER_NODE,
    DEEPEST,
    MOST_NODES,
    CellArray,
    Leaf,
    Node,
    Size,
    StructArray,
    Unreadable,
    Workspace,
    way_out,
)
from .named_arrays import TEXT, in_blocks

_MOST_AXES = 32
_TOO_MANY = "holds more elements of cells and structs than a file of its size can, so it is damaged."
_NUMBERS = {
    "double": np.float64,
    "canonical empty": np.float64,
    "single": np.float32,
    "logical": np.bool_,
    **{f"{sign}int{bits}": np.dtype(f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)},
}


def workspace_of(file: Any) -> Workspace:
    """Variables of an open file.

    Raises:
        InputError: It holds more elements than are read.
    """
    walk, workspace = _Walk(file), Workspace()
    for name in file:
        if not name.startswith("#"):
            workspace.add(name, Unreadable(OTHER_FILE) if inside(file, name) is None else walk.node(name, 0))
    return workspace


class _Walk:
    """Goes through a file, as far as it is not endless."""

    def __init__(self, file: Any) -> None:
        self.file, self.left = file, MOST_NODES + file.id.get_filesize() // BYTES_PER_NODE

    def node(self, at: Any, depth: int) -> Node:
        """What is at a path or a reference."""
        import h5py  # noqa: PLC0415

        self.left -= 1
        if self.left < 0:
            raise InputError(_TOO_MANY)
        if depth > DEEPEST:
            return Unreadable(f"it has more than {DEEPEST} structs or cells inside each other")
        found = self.file[at] if at else None
        if isinstance(found, h5py.Group):
            return self._struct(found, depth)
        if found is None:
            return Unreadable("the file says where it is, but nothing is there")
        return self._array(found, at, depth)

    def _struct(self, group: Any, depth: int) -> Node:
        if "MATLAB_sparse" in group.attrs:
            return Unreadable(way_out("sparse"))
        kind = class_of(group)
        if kind not in ("", "struct") or "MATLAB_object_decode" in group.attrs:
            return Unreadable(way_out(kind))
        names = _field_names(group)
        members = {name: inside(group, name) for name in names}
        if None in members.values():
            return Unreadable(OTHER_FILE)
        if members and all(map(_is_element_list, members.values())):
            sizes = {_size(each) for each in members.values()}
            if len(sizes) > 1:
                return Unreadable("the fields of a struct array differ in size")
            return StructArray(sizes.pop(), {name: self._elements(each, depth) for name, each in members.items()})
        return StructArray((1, 1), {name: [self.node(each.ref, depth + 1)] for name, each in members.items()})

    def _elements(self, array: Any, depth: int) -> list[Node]:
        if array.size > self.left:
            raise InputError(_TOO_MANY)
        return [self.node(reference, depth + 1) for reference in array[()].reshape(-1)]

    def _array(self, array: Any, at: Any, depth: int) -> Node:
        kind = class_of(array)
        if is_elsewhere(array):
            return Unreadable(OTHER_FILE)
        if "MATLAB_object_decode" in array.attrs:
            return Unreadable(way_out(kind))
        if kind == "cell" or (kind == "" and _is_element_list(array)):
            return CellArray(_size(array), [] if _is_empty(array) else self._elements(array, depth))
        if kind == "struct":
            return StructArray(_size(array), {name: [] for name in _field_names(array)})
        return _leaf(array, at, kind)


def _leaf(array: Any, at: Any, kind: str) -> Node:
    """Numbers or texts of a class of MATLAB, or of none, as other programs write them."""
    size, empty = _size(array), _is_empty(array)
    if kind == "char":
        return Leaf((1 if empty else size[0], 1), TEXT, partial(_texts, at, empty))
    if array.dtype.names is not None:
        return Unreadable(way_out("complex"))
    stored = array.dtype
    if kind not in _NUMBERS and (kind or stored.kind not in "fiub"):
        return Unreadable(way_out(kind))
    told = np.dtype(_NUMBERS.get(kind, stored))
    dtype = stored if stored.kind == told.kind and not empty else told
    return Leaf(size, dtype, partial(_empty, size, dtype) if empty else partial(_numbers, at, dtype))


def _is_empty(array: Any) -> bool:
    return "MATLAB_empty" in array.attrs and bool(array.attrs["MATLAB_empty"])


def class_of(node: Any) -> str:
    """Class of a variable in MATLAB."""
    if "MATLAB_class" not in node.attrs:
        return ""
    kind = node.attrs["MATLAB_class"]
    return kind.decode("utf-8", "replace") if isinstance(kind, bytes) else str(kind)


def _is_element_list(node: Any) -> bool:
    """Whether an array refers to the elements of a struct array."""
    import h5py  # noqa: PLC0415

    is_array = isinstance(node, h5py.Dataset)
    return is_array and class_of(node) == "" and h5py.check_ref_dtype(node.dtype) is h5py.Reference


def _field_names(node: Any) -> Sequence[str]:
    """Fields of a struct in MATLAB's order, where the file tells it."""
    import h5py  # noqa: PLC0415

    there = list(node) if isinstance(node, h5py.Group) else []
    told = [
        "".join(letter.decode("utf-8", "replace") for letter in name) for name in node.attrs.get("MATLAB_fields", ())
    ]
    if not isinstance(node, h5py.Group):
        return told
    return told if sorted(told) == sorted(there) else there


def _size(array: Any) -> Size:
    """Size in MATLAB; the content of an empty array is its size."""
    if _is_empty(array):
        told = tuple(map(int, array[()].reshape(-1))) if array.size <= _MOST_AXES else ()
        return told if len(told) > 1 and min(told) == 0 else (0, 0)
    size = array.shape[::-1]
    return (*size, *[1] * (2 - len(size)))


def _empty(size: Size, dtype: np.dtype[Any], _: Any) -> NDArray[Any]:
    return np.empty(size, dtype)


def _numbers(at: Any, dtype: np.dtype[Any], file: Any) -> NDArray[Any]:
    """A numeric array; a large one in a temporary file, written in blocks of whole chunks."""
    node = file[at]
    if node.ndim and node.nbytes > storage.ON_DISK:
        chunk = node.chunks[-1] if node.chunks else 1
        parts = in_blocks(lambda which: _cast(node[..., which].T, dtype), node.shape[-1], node.nbytes, chunk)
        found = storage.spooled(parts, node.shape[::-1], dtype)
        if found is not None:
            return found
    values = _cast(node[()].T, dtype)
    return values.reshape(*values.shape, *[1] * (2 - values.ndim))


def _cast(values: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    return values.astype(dtype, copy=False)


def _texts(at: Any, empty: bool, file: Any) -> NDArray[np.str_]:
    """Rows of a matrix of characters, stored as UTF-16 codes, without padding."""
    if empty:
        return np.array([[""]])
    rows = file[at][()].T
    rows = rows.reshape(len(rows), prod(rows.shape[1:])) if rows.ndim else rows.reshape(1, 1)
    found = [row.astype("<u2").tobytes().decode("utf-16-le", "replace").rstrip() for row in rows]
    return np.array(found, dtype=np.str_).reshape(-1, 1)
