"""Zarr stores of version 2 and 3, which are folders; groups are joined by `/`."""

from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import InputError
from ...untrusted import read_first
from .contents import Contents, TextTable
from .hdf5_nodes import attributes_of, unit_of
from .named_arrays import NamedArrays, Stored, read_rows, stored
from .numpy_files import ONLY
from .scaled import Packing, packing_of

_TOLD = ("zarr.json", ".zarray", ".zgroup")


def open_zarr(path: Path, how: TextTable) -> Contents:  # noqa: ARG001 - all openers have it
    """Arrays of a store; the one of a store that is an array is called `data`.

    Raises:
        InputError: The folder is not a store, or is damaged.
    """
    import zarr  # noqa: PLC0415

    if not path.is_dir():
        raise InputError("is a file, expected a Zarr store, which is a folder.")
    if not any((path / name).is_file() for name in _TOLD) or not read_first("zarr_store", path):
        raise InputError("not a Zarr store, or damaged.")
    found: dict[str, Stored] = {}
    unreadable: dict[str, str] = {}
    attributes: dict[str, str | float] = {}
    for folder in sorted({file.parent for file in path.rglob("*") if file.name in _TOLD}):
        name = folder.relative_to(path).as_posix().removeprefix(".")
        try:
            node = zarr.open(str(folder), mode="r")
            attributes |= attributes_of(node.attrs, f"{name}@" if name else "")
            readable, not_readable = _array(name, node) if isinstance(node, zarr.Array) else ({}, {})
        except Exception as error:  # noqa: BLE001, RUF100 - on damaged bytes Zarr raises almost any exception
            readable, not_readable = {}, {name or ONLY: f"it is damaged or of an unknown type ({error})"}
        found |= readable
        unreadable |= not_readable
    if not found and not unreadable:
        raise InputError("a Zarr store without arrays.")
    return NamedArrays(path, found, unreadable, attributes, partial(_opened, path))


def _opened(path: Path) -> AbstractContextManager[Path]:
    return nullcontext(path)


def _array(name: str, node: Any) -> tuple[dict[str, Stored], dict[str, str]]:
    told = dict(node.attrs)
    if "_ARRAY_DIMENSIONS" in told and node.metadata.zarr_format == 2 and node.fill_value is not None:
        told.setdefault("_FillValue", node.fill_value)  # where xarray keeps it
    packing = packing_of(told, node.dtype)
    dtype = node.dtype if packing is None else packing.dtype
    return stored(name or ONLY, node.shape, dtype, partial(_read, name, packing), unit_of(told))


def _read(name: str, packing: Packing | None, path: Path) -> NDArray[Any]:
    """An array; a large one in a temporary file."""
    import zarr  # noqa: PLC0415

    node: Any = zarr.open_array(str(path / name), mode="r")
    if not node.shape:
        values = np.asarray(node[()], node.dtype)
        return values if packing is None else packing(values)
    dtype = node.dtype if packing is None else packing.dtype
    return read_rows(
        lambda which: node[which] if packing is None else packing(node[which]), node.shape, dtype, node.chunks[0]
    )
