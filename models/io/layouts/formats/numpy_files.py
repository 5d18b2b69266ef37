"""NumPy files, `.npy` and `.npz`; the array of a `.npy` file is called `data`."""

import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from .... import storage
from ....errors import InputError
from ...npz import DAMAGE, MOST_HEADER, DeclaredArray, beginning, declared_array, read_member
from .contents import Contents, TextTable
from .named_arrays import PICKLED, NamedArrays, Stored, stored

ONLY = "data"
"""Name of the array of a file that holds one without a name."""


def open_npy(path: Path, how: TextTable) -> Contents:  # noqa: ARG001 - all openers have it
    """The array of a `.npy` file; a large one is mapped.

    Raises:
        InputError: The file is not one of NumPy or is damaged.
    """
    with path.open("rb") as file:
        begin = file.read(MOST_HEADER)
    if not begin.startswith(npy.MAGIC_PREFIX):
        raise InputError("not an array of NumPy (.npy), or damaged.")
    declared = declared_array(begin, path.stat().st_size, ONLY)
    found, unreadable = _listed(ONLY, declared, lambda _: _whole(path, declared))
    return NamedArrays(path, found, unreadable)


def open_npz(path: Path, how: TextTable) -> Contents:  # noqa: ARG001
    """Arrays of a `.npz` archive; a large one is mapped, a compressed one once unpacked.

    Raises:
        InputError: The file is not an archive, or the header of an array is damaged.
    """
    if not zipfile.is_zipfile(path):
        raise InputError("not an npz archive, or truncated.")
    found: dict[str, Stored] = {}
    unreadable: dict[str, str] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for member in archive.infolist():
                name = member.filename.removesuffix(".npy")
                begin = beginning(archive, member, name)
                if begin is None:
                    unreadable[name] = "it is not an array of NumPy"
                    continue
                declared = declared_array(begin, member.file_size, name)
                read = partial(_member, path, member, name, declared)
                readable, not_readable = _listed(name, declared, read)
                found |= readable
                unreadable |= not_readable
    except DAMAGE as error:
        raise error if isinstance(error, InputError) else InputError(f"damaged npz archive ({error}).") from error
    return NamedArrays(path, found, unreadable, opened=partial(zipfile.ZipFile, path))


def _listed(
    name: str, declared: DeclaredArray, load: Callable[[Any], NDArray[Any]]
) -> tuple[dict[str, Stored], dict[str, str]]:
    if declared.dtype.hasobject:
        return {}, {name: PICKLED}
    return stored(name, declared.shape, declared.dtype, load)


def _member(
    path: Path, member: zipfile.ZipInfo, name: str, declared: DeclaredArray, archive: zipfile.ZipFile
) -> NDArray[Any]:
    return read_member(path, archive, member, name, declared)


def _whole(path: Path, declared: DeclaredArray) -> NDArray[Any]:
    shape, by_column, dtype, header = declared
    mapped = np.memmap(path, dtype, "r", header, shape, "F" if by_column else "C") if declared.nbytes else None
    if mapped is None:
        return np.empty(shape, dtype)
    return mapped if declared.nbytes > storage.ON_DISK else np.array(mapped)
