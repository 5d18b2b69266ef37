"""MATLAB files of version 5 to 7, and of 7.3, which are HDF5 with axes in reverse order."""

import json
import shutil
import tempfile
import weakref
from collections.abc import Mapping
from functools import partial
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .... import storage
from ....errors import InputError
from ...untrusted import read_first
from .contents import Contents, TextTable
from .matlab_hdf5 import workspace_of
from .matlab_tree import CellArray, Leaf, Node, StructArray, Unreadable, Workspace, way_out
from .named_arrays import TEXT, NamedArrays


def open_mat(path: Path, how: TextTable) -> Contents:  # noqa: ARG001 - all openers have it
    """Arrays of a MATLAB file.

    Raises:
        InputError: The file is not a MATLAB file of version 5 to 7.3, or is damaged.
    """
    import h5py  # noqa: PLC0415

    if not h5py.is_hdf5(path):
        return _open_v5(path)
    if not read_first("hdf5", path):
        raise InputError("damaged MATLAB 7.3 file.")
    try:
        with h5py.File(path, "r") as file:
            workspace = workspace_of(file)
    except InputError:
        raise
    except Exception as error:  # on damaged bytes HDF5 raises almost any exception
        raise InputError(f"damaged MATLAB 7.3 file ({error}).") from error
    return NamedArrays(path, workspace.found, workspace.unreadable, opened=partial(h5py.File, path, "r"))


def _open_v5(path: Path) -> Contents:
    """Arrays as SciPy unpacks them in another process, into a folder that goes with them."""
    folder = Path(tempfile.mkdtemp(prefix="solidtouch-"))
    try:
        if not read_first("mat_tree", path, folder):
            raise InputError("not a MATLAB file of version 5 to 7.3, or damaged or truncated.")
        workspace = Workspace()
        for name, told in json.loads((folder / "tree.json").read_text(encoding="utf-8")).items():
            workspace.add(name, _node(folder / "data", told))
        contents = NamedArrays(path, workspace.found, workspace.unreadable)
        weakref.finalize(contents, shutil.rmtree, folder, ignore_errors=True)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return contents


def _node(data: Path, told: Mapping[str, Any]) -> Node:
    """What `io.isolated.mat_tree` describes."""
    if "x" in told:
        return Unreadable(way_out(told["x"]))
    if "t" in told:
        rows = told["t"] or [""]
        return Leaf((len(rows), 1), TEXT, lambda _: np.array(rows, dtype=np.str_).reshape(-1, 1))
    size = tuple(told["size"])
    if "c" in told:
        return CellArray(size, [_node(data, each) for each in told["c"]])
    if "s" in told:
        return StructArray(size, {key: [_node(data, each) for each in of] for key, of in told["s"].items()})
    dtype = np.dtype(told["a"])
    return Leaf(size, dtype, lambda _: _numbers(data, dtype, size, told["at"]))


def _numbers(data: Path, dtype: np.dtype[Any], size: tuple[int, ...], at: int) -> NDArray[Any]:
    """An array of the unpacked bytes, mapped if it is large."""
    if not prod(size):
        return np.empty(size, dtype)
    mapped = np.memmap(data, dtype, "r", at, size, "F")
    return mapped if mapped.nbytes > storage.ON_DISK else np.array(mapped)
