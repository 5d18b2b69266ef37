"""HDF5 and netCDF files of others, by the names of their groups and arrays."""

from functools import partial
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import InputError
from ...untrusted import is_sealed, read_first
from .contents import Contents, TextTable, Values, Variable
from .hdf5_nodes import OTHER_FILE, arrays_in, attributes_of, is_elsewhere, unit_of
from .named_arrays import (
    RAW,
    TEXT,
    NamedArrays,
    Stored,
    field_at,
    fields_of,
    joined_letters,
    plain,
    plain_dtype,
    read_rows,
    refusal,
    texts,
)
from .netcdf3 import is_netcdf3, open_netcdf3
from .scaled import Packing, packing_of

_NO_VARIABLE = b"This is a netCDF dimension but not a netCDF variable"
_MOST_ELEMENTS = 1_000_000


def open_netcdf(path: Path, how: TextTable) -> Contents:
    """Variables of a netCDF file, of version 4 or one of the classic ones.

    Raises:
        InputError: The file is neither, or is damaged.
    """
    return open_netcdf3(path) if is_netcdf3(path) else open_hdf5(path, how)


def open_hdf5(path: Path, how: TextTable) -> Contents:  # noqa: ARG001 - all openers have it
    """Arrays of an HDF5 file, groups joined by `/`; attributes of groups and arrays are called `group@attribute`.

    Raises:
        InputError: The file is not HDF5, or is damaged.
    """
    import h5py  # noqa: PLC0415

    if not h5py.is_hdf5(path):
        raise InputError("not an HDF5 file, or damaged or truncated.")
    if not is_sealed(path) and not read_first("hdf5", path):
        raise InputError("not an HDF5 file, or damaged or truncated.")
    try:
        with h5py.File(path, "r") as file:
            found, unreadable, attributes = _listed(file)
    except InputError:
        raise
    except Exception as error:  # on damaged bytes HDF5 raises almost any exception
        raise InputError(f"damaged HDF5 file ({error}).") from error
    return NamedArrays(path, found, unreadable, attributes, partial(h5py.File, path, "r"))


def _listed(file: Any) -> tuple[dict[str, Stored], dict[str, str], dict[str, str | float]]:
    import h5py  # noqa: PLC0415

    found: dict[str, Stored] = {}
    unreadable: dict[str, str] = {}
    attributes = attributes_of(file.attrs)
    for name, node in arrays_in(file):
        if node is None:
            unreadable[name] = OTHER_FILE
            continue
        attributes |= attributes_of(node.attrs, f"{name}@")
        if isinstance(node, h5py.Group) or node.attrs.get("NAME", b"").startswith(_NO_VARIABLE):
            continue
        if is_elsewhere(node):
            unreadable[name] = OTHER_FILE
            continue
        try:
            _ = node.dtype
        except TypeError:
            unreadable[name] = "it has a type that NumPy lacks"
            continue
        readable, not_readable = _array(name, node)
        found |= readable
        unreadable |= not_readable
    return found, unreadable, attributes


def _array(name: str, node: Any) -> tuple[dict[str, Stored], dict[str, str]]:
    """The variables of an array: itself, or each field of a compound type."""
    import h5py  # noqa: PLC0415

    if h5py.check_ref_dtype(node.dtype) is h5py.Reference:
        return _referred(name, node)
    unit = unit_of(node.attrs)
    shape = node.shape if node.shape is not None else (0,)
    packing = packing_of(node.attrs, node.dtype)
    letters = node.dtype.str == "|S1" and len(shape) > 0 and "DIMENSION_LIST" in node.attrs
    load = partial(_read, name, packing, letters)
    found, unreadable = {}, {}
    nbytes = prod(shape) * node.dtype.itemsize
    for each, axes, dtype, at in fields_of(name, shape, node.dtype):
        element = h5py.check_vlen_dtype(dtype)
        if h5py.check_string_dtype(dtype) is not None:
            variable = Variable(axes[:-1] if letters else axes, TEXT, unit)
            found[each] = Stored(variable, nbytes, load, partial(_text_field, at), mapped=False)
        elif element is not None and element.kind in "fiub":
            found[each] = Stored(Variable((*axes, None), element, unit), nbytes, load, partial(_ragged, at, element))
        elif why := RAW if dtype.hasobject else refusal(dtype):
            unreadable[each] = why
        else:
            kind = plain_dtype(dtype) if packing is None else packing.dtype
            found[each] = Stored(Variable(axes, _bare(kind), unit), nbytes, load, partial(_plain_field, at))
    return found, unreadable


def _bare(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """A type without what HDF5 says of it, such as the names of an enumeration."""
    return np.dtype(dtype.str) if dtype.kind != "U" else dtype


def _plain_field(at: tuple[int, ...], values: NDArray[Any]) -> NDArray[Any]:
    return plain(field_at(values, at))


def _text_field(at: tuple[int, ...], values: NDArray[Any]) -> NDArray[np.str_]:
    return texts(field_at(values, at))


def _ragged(at: tuple[int, ...], dtype: np.dtype[Any], values: NDArray[Any]) -> Values:
    """Elements of any length, one array if they have the same; one that was never written has none."""
    field = field_at(values, at)
    elements = [np.asarray(each, dtype=dtype).reshape(-1) for each in field.reshape(-1)]
    if len({len(each) for each in elements}) > 1:
        return elements
    return np.stack(elements).reshape(*field.shape, -1) if elements else np.empty((*field.shape, 0), dtype)


def _read(name: Any, packing: Packing | None, letters: bool, file: Any) -> NDArray[Any]:
    """An array; a large one in a temporary file."""
    node = file[name]
    if node.shape is None:
        return np.empty(0, node.dtype)
    if not node.shape:
        values = np.asarray(node[()]) if node.dtype.names is None else np.array(node[()], dtype=node.dtype)
        return values if packing is None else packing(values)
    dtype = node.dtype if packing is None else packing.dtype
    chunk = node.chunks[0] if node.chunks else 1
    values = read_rows(lambda which: node[which] if packing is None else packing(node[which]), node.shape, dtype, chunk)
    return joined_letters(values) if letters else values


def _referred(name: str, node: Any) -> tuple[dict[str, Stored], dict[str, str]]:
    """Elements to which an array refers, as one array if they have the same shape."""
    import h5py  # noqa: PLC0415

    if node.size > _MOST_ELEMENTS:
        return {}, {name: f"it refers to more than {_MOST_ELEMENTS:,} arrays"}
    to = list(np.asarray(node[()]).reshape(-1))
    arrays: list[Any] = [node.file[each] if each else None for each in to]
    if not all(isinstance(each, h5py.Dataset) and each.shape is not None for each in arrays):
        return {}, {name: "it refers to what is not an array"}
    if any(is_elsewhere(each) for each in arrays):
        return {}, {name: OTHER_FILE}
    is_text = {h5py.check_string_dtype(each.dtype) is not None for each in arrays}
    if len(is_text) > 1 or (is_text == {False} and any(each.dtype.kind not in "fiub" for each in arrays)):
        return {}, {name: "it refers to arrays of different types"}
    dtype = TEXT if True in is_text else np.result_type(*{_bare(each.dtype) for each in arrays} or {np.float64})
    shapes = {each.shape for each in arrays}
    if len({len(shape) for shape in shapes}) > 1:
        return {}, {name: "it refers to arrays that differ in the number of their axes"}
    nbytes = sum(each.nbytes for each in arrays)
    axes = tuple(n[0] if len(set(n)) == 1 else None for n in zip(*shapes, strict=True))
    same = node.shape if len(shapes) < 2 else None
    load = partial(_elements, to, dtype, same)
    return {name: Stored(Variable((*node.shape, *axes), dtype, unit_of(node.attrs)), nbytes, load, mapped=False)}, {}


def _elements(to: list[Any], dtype: np.dtype[Any], same: tuple[int, ...] | None, file: Any) -> Values:
    each = (plain(np.asarray(file[reference][()])) for reference in to)
    values = [one if dtype.kind == "U" else one.astype(dtype, copy=False) for one in each]
    if same is None:
        return values
    return np.stack(values).reshape(*same, *values[0].shape) if values else np.empty(same, dtype)
