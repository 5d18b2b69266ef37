"""Where labels stand: in columns and arrays, in the names of files, in tables beside them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .files import SourceFile
from .formats.contents import Contents, TextTable, Values
from .formats.registry import ENDINGS, ending, open_contents
from .patterns import filled, number_in

type Label = NDArray[Any] | str | float | ByOrder
"""One value for each tap or row, or the same for all."""


class ByOrder(NamedTuple):
    """Values of all taps of a recording in their order, from a table."""

    values: NDArray[Any]
    table: str


class LabelSource(NamedTuple):
    """Where a label stands.

    Attributes:
        key: Which label.
        kind: `"column"`, `"field"`, `"table"`, `"constant"`, `"file"`, `"gap"` or `"date"`.
        name: Of the column, field or table, or the constant itself.
        column: Of a table.
    """

    key: str
    kind: str
    name: str
    column: str = ""


def as_known(values: NDArray[Any] | str) -> Any:
    """Texts as numbers where all are; a single text likewise."""
    if isinstance(values, str):
        return as_known(np.array([values]))[0].item()
    if values.dtype.kind != "U":
        return values
    try:
        return values.astype(np.float64)
    except ValueError:
        return values


def label_source(key: str, text: str) -> LabelSource:
    """Where a label stands, from the text of a map."""
    begin, _, rest = text.partition(":")
    kinds = {"column": "column", "file": "field", "folder": "field"}
    kinds |= {"gap": "gap", "date": "date"} if key == "session" else {}
    if text.startswith("="):
        return LabelSource(key, "constant", text[1:])
    if rest and begin in kinds:
        return LabelSource(key, kinds[begin], key if kinds[begin] == "field" else rest)
    if text == "file" and key in ("session", "trial"):
        return LabelSource(key, "file", "")
    head, _, column = text.rpartition(":")
    for name, wanted in ((text, ""), (head, column)):
        if ENDINGS.get(ending(name)) in ("text", "npy"):
            return LabelSource(key, "table", name, wanted)
    return LabelSource(key, "column", text)


@dataclass(frozen=True, eq=False)
class LabelTables:
    """Tables beside the recording.

    Attributes:
        folders: Where they are looked for, in this order.
        how: How they are written.
    """

    folders: Sequence[Path]
    how: TextTable
    _known: dict[Path, dict[str, NDArray[Any]]] = field(default_factory=dict)

    def label(self, source: LabelSource, file: SourceFile, rows: int) -> Label:
        """Values of a column: in the row or rows that name the file, else in the rows of the file, else in all.

        Args:
            source: The table and column; the only column needs no name.
            file: The file that is labelled.
            rows: Number of its rows, or of its taps.

        Raises:
            InputError: There is no such table or column, or no row for this file.
        """
        name = filled(source.name, file.fields)
        columns = self.columns(name, file)
        column = source.column or (next(iter(columns)) if len(columns) == 1 else source.key)
        if column not in columns:
            raise InputError(f"{name}: no column {column!r}; columns: {', '.join(columns)[:200]}.")
        ending_free = file.below.rpartition(".")[0] or file.below
        names = [file.below, file.path.name, ending_free, ending_free.rpartition("/")[2]]
        texts = {key: of for key, of in columns.items() if key != column and of.dtype.kind == "U"}
        for of in texts.values():
            if len(found := np.flatnonzero(np.isin(of, names))):
                return str(columns[column][found[0]]) if len(found) == 1 else columns[column][found]
        if any(ending(text) in ENDINGS for of in texts.values() for text in of[:1].tolist()):
            raise InputError(f"{name} has no row for this file.")
        return columns[column] if len(columns[column]) == rows else ByOrder(columns[column], name)

    def columns(self, name: str, file: SourceFile) -> Mapping[str, NDArray[Any]]:
        """Columns of a table, or the arrays of one axis of a file, that stands beside a file or in another folder.

        Raises:
            InputError: It is in none of them, or damaged.
        """
        folders = [file.path.parent, *self.folders]
        path = next((there for folder in folders if (there := folder / name).is_file()), None)
        if path is None:
            places = ", ".join(dict.fromkeys(str(folder) for folder in folders))
            raise InputError(f"{name}: no such table of labels; looked in {places}.")
        if path not in self._known:
            contents = open_contents(path, self.how)
            values = contents.read(list(contents.variables))[0]
            arrays = {key: of for key, of in values.items() if isinstance(of, np.ndarray)}
            self._known[path] = {
                key: of.reshape(-1) for key, of in arrays.items() if of.size == max(of.shape, default=1)
            }
        return self._known[path]


def needed(sources: Sequence[LabelSource], fields: dict[str, str], contents: Contents) -> list[str]:
    """Variables of a file that hold labels."""
    names = [filled(each.name, fields) for each in sources if each.kind in ("column", "date")]
    return [contents.named(name) for name in names if name not in contents.attributes]


def label_of(
    source: LabelSource,
    file: SourceFile,
    contents: Contents,
    values: Mapping[str, Values],
    tables: LabelTables,
    rows: int,
) -> Label:
    """A label of the taps or rows of a file, of which there are so many.

    Raises:
        InputError: It is nowhere, or differs in shape between rows.
    """
    fields = file.fields
    if source.kind == "constant":
        return source.name
    if source.kind == "field":
        return fields[source.name]
    if source.kind == "table":
        return tables.label(source, file, rows)
    if source.kind in ("file", "gap"):
        return file.below
    name = filled(source.name, fields)
    if name in contents.attributes and name not in contents.variables:
        return contents.attributes[name]
    found = values[contents.named(name)]
    if isinstance(found, list):
        raise InputError(f"{source.key}: {name} has elements of different shapes, so it holds no labels.")
    found = found.reshape(-1) if found.size == max(found.shape, default=1) else found
    if found.ndim > 1:
        raise InputError(f"{source.key}: {name} has shape {found.shape}, expected one value for each tap.")
    return found if found.size != 1 else found.reshape(-1)[0].item()


def as_texts(values: NDArray[Any]) -> list[str]:
    """Labels as texts, whole numbers without a point."""
    if values.dtype.kind == "f":
        return [f"{value:.15g}" for value in values.tolist()]
    if values.dtype.kind == "S":
        return [value.decode("utf-8", "replace") for value in values.tolist()]
    return [str(value) for value in values.tolist()]


@cache
def _as_number(text: str) -> tuple[float, str] | None:
    try:
        return float(text), ""
    except ValueError:
        return number_in(text)


def as_numbers(key: str, values: NDArray[Any]) -> tuple[NDArray[np.float64], str]:
    """Labels as numbers, and the unit that all texts state.

    Raises:
        InputError: One holds no number, or more than one.
    """
    if values.dtype.kind in "fiub":
        return values.astype(np.float64), ""
    found = [_as_number(text) for text in as_texts(values)]
    for number, (text, each) in enumerate(zip(as_texts(values), found, strict=True)):
        if each is None:
            raise InputError(f"{key} (--{key}): {text!r} of tap {number} is not one number.")
    units = {each[1] for each in found if each is not None}
    numbers = np.array([each[0] for each in found if each is not None])
    return numbers, units.pop() if len(units) == 1 else ""
