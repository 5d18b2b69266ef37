"""Rows as JSON: an object in each line, a list of objects, or an object of lists."""

import json
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, override

import msgspec
from numpy.typing import NDArray

from ....errors import InputError
from ...untrusted import check_size, in_bytes
from . import objects
from .columns import Part, gathered
from .contents import Contents, TextTable, Values
from .text_lines import BLOCK, Lines, TextBlock, from_windows

_IN_MEMORY = 12  # times the size of a document that its objects take
_DOCUMENT = ".json"
_STRUCTURE = re.compile(rb'"(?:[^"\\]|\\.)*+(?:"|\\?\Z)|[\[\]{},]')  # of a document, and what hides it
_CLOSING = bytes.maketrans(b"[{", b"]}")
_SHOWN = 80


def open_json(path: Path, how: TextTable, most: int | None = None) -> Contents:  # noqa: ARG001 - as the other readers
    """Rows of a `.json` document, or of a file with an object in each line.

    A document is a list of objects, or an object of equally long lists, whose texts and numbers beside these are
    attributes of the file. With `most`, only rows in its first 4 MiB are read.

    Raises:
        InputError: It is no such file, or damaged; the message names the line.
    """
    is_document = path.suffix.lower() == _DOCUMENT and not _has_lines(path)
    return JsonDocument(path, whole=most is None) if is_document else JsonLines(path)


class JsonLines(Contents):
    """Objects, one in each line; the first 4 MiB tell which fields there are.

    Args:
        path: The file.
        size: Bytes that are read at a time.
    """

    table = True

    def __init__(self, path: Path, size: int = BLOCK) -> None:
        self.path, self.unreadable, self.attributes = path, {}, {}
        self._lines = Lines(path, 0, "", size)
        first = next(iter(Lines(path, 0, "")), TextBlock(1, b""))
        self.variables, self._paths = objects.fields(_rows(first))
        if not self.variables:
            raise InputError("there are no objects with keys.")

    @override
    def read(self, names: Sequence[str], columns: Sequence[str] = ()) -> tuple[dict[str, Values], NDArray[Any] | None]:
        asked, numbers = _asked(self, self._paths, names, columns)

        def parts() -> Iterator[Part]:
            for block in self._lines:
                yield objects.part(_rows(block), asked, numbers, lambda row, block=block: _line(block, row))

        return gathered(parts, list(names), len(columns), self.most)

    @override
    def place(self, row: int) -> str:
        for block in self._lines:
            length = sum(1 for line in block.content.splitlines() if line.strip())
            if row < length:
                return _line(block, row)
            row -= length
        raise IndexError(row)


class JsonDocument(Contents):
    """A list of objects, or an object of equally long lists; as many rows as 4 MiB hold tell which fields there are.

    Args:
        path: The file.
        whole: Whether all of a file above 4 MiB is read, or only the rows at its begin.
    """

    table = True

    def __init__(self, path: Path, *, whole: bool = True) -> None:
        self.path, self.unreadable, self.attributes = path, {}, {}
        size = path.stat().st_size
        begin = b"" if whole or size <= BLOCK else closed(_utf8(path, BLOCK))
        if begin:
            self.unreadable[objects.REST] = f"its first {in_bytes(BLOCK)} tell what there is"
        else:
            check_size(path, 0, _IN_MEMORY * size)
        found = decoded(begin or _utf8(path), lambda: "")
        self._rows: list[Any] = found if isinstance(found, list) else self._transposed(found)
        first = max(1, len(self._rows) * BLOCK // max(size, BLOCK))
        self.variables, self._paths = objects.fields(self._rows[:first], len(self._rows))
        if not self.variables:
            raise InputError("there is neither a list of objects nor an object of lists.")

    def _transposed(self, found: object) -> list[Any]:
        """Rows of an object of lists; what else it holds become attributes."""
        if not isinstance(found, dict):
            return []
        lists = {key: each for key, each in found.items() if isinstance(each, list)}
        self.attributes = {key: each for key, each in found.items() if isinstance(each, str | int | float)}
        lengths = {key: len(each) for key, each in lists.items()}
        if len(set(lengths.values())) > 1 and not self.unreadable:
            first = next(iter(lengths))
            other = next(key for key, length in lengths.items() if length != lengths[first])
            raise InputError(f"the list {first} has {lengths[first]} items, but {other} has {lengths[other]}.")
        return [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=False)]  # of a begin

    @override
    def read(self, names: Sequence[str], columns: Sequence[str] = ()) -> tuple[dict[str, Values], NDArray[Any] | None]:
        asked, numbers = _asked(self, self._paths, names, columns)
        part = objects.part(self._rows, asked, numbers, self.place)
        return gathered(lambda: [part], list(names), len(columns))


def _asked(
    contents: Contents, paths: dict[str, objects.Path], names: Sequence[str], columns: Sequence[str]
) -> tuple[list[tuple[objects.Path, Any]], list[objects.Path]]:
    full = [contents.named(name) for name in names]
    return [(paths[name], contents.variables[name]) for name in full], [paths[contents.named(c)] for c in columns]


def _has_lines(path: Path) -> bool:
    """Whether the first line is an object and not all of the file."""
    lines = [line for line in _utf8(path, BLOCK).split(b"\n") if line.strip()]
    try:
        return len(lines) > 1 and isinstance(msgspec.json.decode(lines[0]), dict)
    except (msgspec.DecodeError, RecursionError):
        return False


def _rows(block: TextBlock) -> list[Any]:
    """Objects of some lines.

    Raises:
        InputError: A line is none; the message names it.
    """
    try:
        found = msgspec.json.Decoder().decode_lines(block.content)
    except (msgspec.DecodeError, RecursionError):
        lines = [line for line in block.content.split(b"\n") if line.strip()]
        found = [decoded(line, lambda i=i: f"{_line(block, i)}: ") for i, line in enumerate(lines)]
    for i, row in enumerate(found):
        if not isinstance(row, dict):
            raise InputError(f"{_line(block, i)}: not an object with keys.")
    return found


def _utf8(path: Path, most: int = -1) -> bytes:
    """Bytes of a file, or the first ones, in UTF-8; those of no encoding of Unicode are text of Windows."""
    try:
        with path.open("rb") as file:
            content = file.read(most)
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}.") from error
    encoding = json.detect_encoding(content)
    try:
        return content.decode(encoding, "strict" if most < 0 else "ignore").encode()
    except UnicodeDecodeError:
        return from_windows(content)


def closed(begin: bytes) -> bytes:
    """The begin of a document up to the last item of its list, or of the lists in its object, that it holds.

    >>> closed(b'[{"a": 1}, {"a": 2}, {"a'), closed(b'{"a": [1, 2], "b": [3, 4, 5')
    (b'[{"a": 1}, {"a": 2}]', b'{"a": [1, 2], "b": [3, 4]}')
    """
    open_, end, closing = b"", 0, b""
    for sign in _STRUCTURE.finditer(begin):
        if sign[0] in b"[{":
            open_ += sign[0]
        elif sign[0] in b"]}":
            open_ = open_[:-1]
        elif sign[0] == b"," and (len(open_) == 1 or (len(open_) == 2 and open_.endswith(b"["))):
            end, closing = sign.start(), open_[::-1].translate(_CLOSING)
    return begin[:end] + closing


def decoded(content: bytes, where: Callable[[], str]) -> Any:
    """Value of JSON, also with NaN and Infinity.

    Raises:
        InputError: It is not JSON; the message begins with `where`.
    """
    try:
        return msgspec.json.decode(content)
    except (msgspec.DecodeError, RecursionError):
        pass
    try:
        return json.loads(content)  # which knows NaN and Infinity
    except json.JSONDecodeError as error:
        place = where() or f"line {error.lineno}: "
        raise InputError(f"{place}not JSON: {error.msg} at character {error.colno}.") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where()}not JSON: {str(error)[:_SHOWN]}.") from error


def _line(block: TextBlock, row: int) -> str:
    """Line of a row of a block."""
    lines = (number for number, line in enumerate(block.content.split(b"\n"), block.line) if line.strip())
    return f"line {next(islice(lines, row, None))}"
