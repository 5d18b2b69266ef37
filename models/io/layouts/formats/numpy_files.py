"""NumPy files, `.npy` and `.npz`; the array of a `.npy` file is called `data`."""

import io
import math
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from .... import storage
from ....blocks import BLOCK
from ....errors import InputError
from ...untrusted import check_size, in_bytes
from .contents import Contents, TextTable
from .named_arrays import PICKLED, NamedArrays, Stored, stored

ONLY = "data"
"""Name of the array of a file that holds one without a name."""
_NAME_LENGTH = 26  # where the length of its name stands in the header of a member
_NAME = 30
_MOST_HEADER = 1 << 14
_DAMAGE = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError, MemoryError)


class DeclaredArray(NamedTuple):
    """What a header says of its array, and the length of that header."""

    shape: tuple[int, ...]
    by_column: bool
    dtype: np.dtype[Any]
    header: int

    @property
    def nbytes(self) -> int:
        """Bytes of its content."""
        return math.prod(self.shape) * self.dtype.itemsize


def open_npy(path: Path, how: TextTable) -> Contents:  # noqa: ARG001 - all openers have it
    """The array of a `.npy` file; a large one is mapped.

    Raises:
        InputError: The file is not one of NumPy or is damaged.
    """
    with path.open("rb") as file:
        begin = file.read(_MOST_HEADER)
    if not begin.startswith(npy.MAGIC_PREFIX):
        raise InputError("not an array of NumPy (.npy), or damaged.")
    declared = _declared_array(begin, path.stat().st_size, ONLY)
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
                begin = _beginning(archive, member, name)
                if begin is None:
                    unreadable[name] = "it is not an array of NumPy"
                    continue
                declared = _declared_array(begin, member.file_size, name)
                read = partial(_member, path, member, name, declared)
                readable, not_readable = _listed(name, declared, read)
                found |= readable
                unreadable |= not_readable
    except _DAMAGE as error:
        raise error if isinstance(error, InputError) else InputError(f"damaged npz archive ({error}).") from error
    return NamedArrays(path, found, unreadable, opened=partial(zipfile.ZipFile, path))


def _listed(
    name: str, declared: DeclaredArray, load: Callable[[Any], NDArray[Any]]
) -> tuple[dict[str, Stored], dict[str, str]]:
    if declared.dtype.hasobject:
        return {}, {name: PICKLED}
    return stored(name, declared.shape, declared.dtype, load)


def _whole(path: Path, declared: DeclaredArray) -> NDArray[Any]:
    shape, by_column, dtype, header = declared
    mapped = np.memmap(path, dtype, "r", header, shape, "F" if by_column else "C") if declared.nbytes else None
    if mapped is None:
        return np.empty(shape, dtype)
    return mapped if declared.nbytes > storage.ON_DISK else np.array(mapped)


def _beginning(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> bytes | None:
    """The first bytes of a member of an archive, `None` if it is not an array.

    Raises:
        InputError: It is damaged.
    """
    try:
        with archive.open(member) as file:
            begin = file.read(_MOST_HEADER)
    except _DAMAGE as error:
        raise InputError(f"array {name} is damaged ({error}).") from error
    return begin if begin.startswith(npy.MAGIC_PREFIX) else None


def _declared_array(begin: bytes, size: int, name: str) -> DeclaredArray:
    """What the first bytes of an array in the format of NumPy say of it.

    Args:
        begin: At least `_MOST_HEADER` of them, or all.
        size: Of its header and content.
        name: For messages.

    Raises:
        InputError: It is damaged.
    """
    file = io.BytesIO(begin)
    try:
        first = npy.read_magic(file) == (1, 0)
        shape, by_column, dtype = (npy.read_array_header_1_0 if first else npy.read_array_header_2_0)(file)
    except Exception as error:  # on damaged bytes NumPy raises almost any exception
        raise InputError(f"array {name} is damaged ({error}).") from error
    declared = DeclaredArray(shape, by_column, dtype, file.tell())
    if dtype.hasobject:
        return declared
    if declared.header + declared.nbytes != size or min(shape, default=0) < 0:
        there = in_bytes(size - declared.header)
        raise InputError(f"array {name} is damaged (its header says {in_bytes(declared.nbytes)}, not {there}).")
    return declared


def _member(
    path: Path, member: zipfile.ZipInfo, name: str, declared: DeclaredArray, archive: zipfile.ZipFile
) -> NDArray[Any]:
    """The array: in memory, or if it is large a map of its file, whose checksum is not compared, or of a temporary one.

    The temporary file holds what is compressed; where it has no room, the array comes into memory.

    Raises:
        InputError: The member is damaged.
    """
    shape, by_column, dtype, header = declared
    order = "F" if by_column else "C"
    try:
        if declared.nbytes > storage.ON_DISK and member.compress_type == zipfile.ZIP_STORED:
            with path.open("rb") as file:
                file.seek(member.header_offset + _NAME_LENGTH)
                begin = member.header_offset + _NAME + sum(struct.unpack("<HH", file.read(4)))
            return np.memmap(path, dtype, "r", begin + header, shape, order)
        with archive.open(member) as file:
            if declared.nbytes > storage.ON_DISK:
                file.read(header)
                unpacked = storage.spooled(iter(partial(file.read, BLOCK), b""), shape, dtype, order)
                if unpacked is not None:
                    return unpacked
                check_size(path, declared.nbytes)
        with archive.open(member) as file:
            return npy.read_array(file, allow_pickle=False)
    except _DAMAGE as error:
        raise error if isinstance(error, InputError) else InputError(f"array {name} is damaged ({error}).") from error
