"""Lists of names and positions that labels index: lines of a file, columns of a table, entries of a JSON document."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .files import SourceFile
from .formats.text_lines import Lines
from .label_tables import LabelTables, TableColumn
from .label_values import PLAIN, are_names, as_texts
from .labels import LabelSource
from .patterns import filled

_HEADERS = {"what", "where", "name", "object", "label", "class", "classe", "position", "value", "id", "what_name"}
_HEADERS |= {"where_value", "category", "categorie", "material", "texture", "surface", "shape", "target", "item"}
"""Of lists, in the singular; another first line is the first entry."""
_NUMBERED = re.compile(r"(\d+)(?:\s+|[:)=,;|]\s*|[.-]\s+)(\S.*)")
_SIGNS = re.compile(r"[,;\t|]")


class Listed(NamedTuple):
    """Names or positions that labels index.

    Attributes:
        entries: They, shape (n,).
        numbers: The number that labels have for each of them, shape (n,), for each column that may hold it.
    """

    entries: NDArray[Any]
    numbers: tuple[NDArray[np.int64], ...] = ()

    def indices(self, labels: NDArray[np.float64]) -> NDArray[np.int64] | None:
        """Place of each label in the list by the numbers beside it; `None` where these are not those of the labels.

        Raises:
            InputError: Several columns have the numbers of the labels, each in its own order.
        """
        found: list[NDArray[np.int64]] = []
        for numbers in self.numbers:
            order = np.argsort(numbers)
            at = np.minimum(np.searchsorted(numbers[order], labels), len(numbers) - 1)
            if (numbers[order][at] == labels).all():
                found.append(order[at])
        if any((other != found[0]).any() for other in found[1:]):
            raise InputError("several columns of the table have these numbers, in different orders.")
        return found[0] if found else None


def listed(source: LabelSource, file: SourceFile, tables: LabelTables) -> Listed:
    """Entries of a file: of a named column, else one in each line, all in one line, or the texts beside their numbers.

    Raises:
        InputError: There is no such file or column, or it is not clear what its entries are.
    """
    if not source.column:
        path = tables.place(filled(source.name, file.fields), file)
        if path.suffix.casefold() == ".json":
            return _of_json(path)
        if path.suffix.casefold() != ".npy" and (found := _of_lines(path)) is not None:
            return found
    column = tables.column(source, file)
    return Listed(column.values, _numbers_beside(column))


def _numbers_beside(column: TableColumn) -> tuple[NDArray[np.int64], ...]:
    """Other columns of whole numbers that all differ."""
    others = (as_texts(of) for name, of in column.columns.items() if name != column.name)
    whole = (texts for texts in others if all(map(str.isdecimal, texts)) and len(set(texts)) == len(texts))
    return tuple(np.array(list(map(int, texts)), dtype=np.int64) for texts in whole)


def _of_json(path: Path) -> Listed:
    """Of a list, or of an object by numbers or with numbers as values."""
    try:
        known = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no JSON document ({error}).") from error
    if isinstance(known, list) and all(isinstance(entry, str | int | float) for entry in known):
        return Listed(np.array(known))
    if isinstance(known, dict) and all(name.isdecimal() for name in known):
        return _numbered(list(known), [str(value) for value in known.values()])
    if isinstance(known, dict) and all(type(value) is int for value in known.values()):
        return _numbered([str(value) for value in known.values()], list(known))
    raise InputError(f"{path}: must be a list, or an object of names by their numbers.")


def _numbered(numbers: Sequence[str], names: Sequence[str]) -> Listed:
    return Listed(np.array(names), (np.array([int(number) for number in numbers], dtype=np.int64),))


def _of_lines(path: Path) -> Listed | None:
    """Of plain lines, or of lines that begin with a number; `None` where lines hold several columns."""
    content = b"".join(block.content for block in Lines(path, 0, "")).decode()
    lines = [line.strip() for line in content.split("\n")]
    lines = [line for line in lines if line and not line.startswith("#")]
    if len(lines) == 1 and len(cells := [cell.strip() for cell in _SIGNS.split(lines[0])]) > 1:
        return Listed(np.array(cells))
    pairs = [found.groups() for line in lines if (found := _NUMBERED.fullmatch(line))]
    if len(lines) == len(pairs) > 1 and all(len(set(each)) == len(pairs) for each in zip(*pairs, strict=True)):
        numbers, names = zip(*pairs, strict=True)
        if not any(map(_SIGNS.search, names)) and are_names(np.array(names)):
            return _numbered(numbers, names)
    if not lines or (any(map(_SIGNS.search, lines)) and not all(map(PLAIN.fullmatch, lines))):
        return None
    first = lines[0].strip('"').casefold()
    header = first in _HEADERS or first.removesuffix("s") in _HEADERS
    return Listed(np.array([line.strip('"') for line in lines[header:]]))
