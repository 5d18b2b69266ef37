"""The bytes of a MATLAB v5 to v7 file to arrays.

SciPy reads such files too, but looks up the kind of an element in a C table without checking it, so that a damaged
file ends the whole program. The layout is the "MAT-File Level 5 File Format" of the MathWorks: a header of 128 bytes,
then elements, each with a tag of 8 bytes that gives its kind and the length of its data. A variable is an element of
kind matrix, whose data are again elements: flags, dimensions, name, content.
"""

import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError

_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXTS = {1: "utf-8", 2: "utf-8", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CELL, _CHAR = 1, 4
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_OTHERS = {2: "struct", 3: "object", 5: "sparse matrix", 16: "function", 17: "string or object"}
_DAMAGE = (struct.error, zlib.error, ValueError, KeyError, IndexError, OverflowError, MemoryError, RecursionError)

Content = NDArray[Any] | str


def read_v5(content: bytes) -> dict[str, Content]:
    """The variables of a file: arrays as MATLAB shapes them, text without padding, cells of text as lists.

    Returns:
        For each name the array, or for what cannot be read the name of its kind.

    Raises:
        InputError: The bytes are of another kind, damaged or truncated.
    """
    endian = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if endian is None or not content.startswith(b"MATLAB"):
        raise InputError("this is no MATLAB file of version 5 to 7.3, or it is truncated.")
    try:
        variables = dict(_variables(memoryview(content)[128:], endian))
    except _DAMAGE as error:
        raise InputError(f"this MATLAB file is damaged or truncated ({error}).") from error
    return {name: value for name, value in variables.items() if name}


def _variables(data: memoryview, endian: str) -> Iterator[tuple[str, Content]]:
    for kind, body in _elements(data, endian):
        if kind == _COMPRESSED:
            yield from _variables(memoryview(zlib.decompress(body)), endian)
        elif kind == _MATRIX:
            yield _variable(body, endian)


def _elements(data: memoryview, endian: str) -> Iterator[tuple[int, memoryview]]:
    """Kind and data of each element; up to 4 bytes of data stand in the tag itself."""
    position = 0
    while position < len(data):
        kind, length = struct.unpack_from(f"{endian}II", data, position)
        start = position + 8
        if kind >> 16:
            kind, length, start = kind & 0xFFFF, kind >> 16, position + 4
        if start + length > len(data):
            raise ValueError(f"an element of {length} bytes reaches beyond the end")
        yield kind, data[start : start + length]
        position = start + length
        if kind != _COMPRESSED:
            position += -position % 8


def _variable(data: memoryview, endian: str) -> tuple[str, Content]:
    """Name and value of a variable."""
    elements = _elements(data, endian)
    flags = _numbers(*next(elements, (6, memoryview(b""))), endian)
    if not len(flags):
        return "", np.empty((0, 0))
    kind = int(flags[0]) & 0xFF
    if kind == 17:  # has no dimensions
        return _name(next(elements)[1]), _OTHERS[kind]
    shape = tuple(int(size) for size in _numbers(*next(elements), endian))
    name = _name(next(elements)[1])
    if kind in _OTHERS or int(flags[0]) & 0x800:
        return name, _OTHERS.get(kind, "complex array")
    if kind == _CELL:
        return name, _cell([_variable(body, endian)[1] for _, body in elements])
    encoding, body = next(elements, (6, memoryview(b"")))
    if kind == _CHAR:
        return name, _texts(encoding, body, shape, endian)
    values = _numbers(encoding, body, endian).astype(_CLASSES[kind])
    return name, values.reshape(shape, order="F")


def _name(data: memoryview) -> str:
    return bytes(data).decode("ascii", "replace")


def _numbers(kind: int, data: memoryview, endian: str) -> NDArray[Any]:
    return np.frombuffer(data, dtype=f"{endian}{_NUMBERS[kind]}")


def _texts(kind: int, data: memoryview, shape: tuple[int, ...], endian: str) -> Content:
    """The rows of a character matrix, without their padding."""
    encoding = _TEXTS[kind] if _TEXTS[kind] == "utf-8" else f"{_TEXTS[kind]}-{'le' if endian == '<' else 'be'}"
    letters = np.array(list(bytes(data).decode(encoding)), dtype=np.str_)
    if len(shape) != 2 or not len(letters):
        return np.array([], dtype=np.str_)
    rows = letters.reshape(shape[0], -1, order="F")
    return np.array(["".join(row).rstrip() for row in rows], dtype=np.str_)


def _cell(values: list[Content]) -> Content:
    if not all(isinstance(value, np.ndarray) and value.dtype.kind == "U" and value.size <= 1 for value in values):
        return "cell with something else than one text in each place"
    return np.array(["".join(value) for value in values], dtype=np.str_)
