"""NumPy archives, `.npz`, to named arrays in the layout of `io.arrays`.

Headers are read and checked before any data, as a small archive may unpack to more than the memory.
"""

import io
import math
import struct
import zipfile
import zlib
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from .. import storage
from ..blocks import BLOCK
from ..errors import InputError
from .arrays import check_layout, is_used
from .untrusted import check_size, in_bytes

_NAME_LENGTH = 26  # where the length of its name stands in the header of a member
_NAME = 30
MOST_HEADER = 1 << 14
DAMAGE = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError, MemoryError)


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


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """Arrays of an archive; a large one is mapped, so that it need not fit into memory, a compressed one once unpacked.

    Those that no tap set holds are not read; in their place are zeros of the same shape.

    Raises:
        InputError: The file is not an archive, is damaged, or contains pickled objects; or its headers show that an
            array is missing, has the wrong type or shape, or is too large.
    """
    if not zipfile.is_zipfile(path):
        raise InputError("not an npz archive, or truncated.")
    try:
        with zipfile.ZipFile(path) as archive:
            members = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
            declared = {name: _declared(archive, member, name) for name, member in members.items()}
            samples = check_layout(declared)
            used = {name for name in declared if is_used(name, declared[name], declared[samples])}
            sizes = [declared[name].nbytes for name in used]
            check_size(path, sum(sizes), sum(size for size in sizes if size <= storage.ON_DISK))
            return {
                name: read_member(path, archive, members[name], name, array)
                if name in used
                else np.broadcast_to(np.zeros((), array.dtype), array.shape)
                for name, array in declared.items()
            }
    except InputError:
        raise
    except DAMAGE as error:
        raise InputError(f"damaged npz archive ({error}).") from error


def _declared(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> DeclaredArray:
    if (begin := beginning(archive, member, name)) is None:
        raise InputError(f"member {name} of the archive is not an array.")
    declared = declared_array(begin, member.file_size, name)
    if declared.dtype.hasobject:
        raise InputError(f"array {name} contains pickled objects, which are refused.")
    return declared


def beginning(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> bytes | None:
    """The first bytes of a member of an archive, `None` if it is not an array.

    Raises:
        InputError: It is damaged.
    """
    try:
        with archive.open(member) as file:
            begin = file.read(MOST_HEADER)
    except DAMAGE as error:
        raise InputError(f"array {name} is damaged ({error}).") from error
    return begin if begin.startswith(npy.MAGIC_PREFIX) else None


def declared_array(begin: bytes, size: int, name: str) -> DeclaredArray:
    """What the first bytes of an array in the format of NumPy say of it.

    Args:
        begin: At least `MOST_HEADER` of them, or all.
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


def read_member(
    path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str, declared: DeclaredArray
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
    except DAMAGE as error:
        raise error if isinstance(error, InputError) else InputError(f"array {name} is damaged ({error}).") from error
