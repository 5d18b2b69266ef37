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
from .formats.registry import ENDINGS, open_contents
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


def label_source(key: str, text: str) -> LabelSource:
    """Where a label stands, from the text of a map."""
    begin, _, rest = text.partition(":")
    if text.startswith("="):
        return LabelSource(key, "constant", text[1:])
    if begin == "column" and rest:
        return LabelSource(key, "column", rest)
    if begin in ("file", "folder") and rest:
        return LabelSource(key, "field", key)
    if text == "file" and key in ("session", "trial"):
        return LabelSource(key, "file", "")
    if begin in ("gap", "date") and rest and key == "session":
        return LabelSource(key, begin, rest)
    head, _, column = text.rpartition(":")
    for name, wanted in ((text, ""), (head, column)):
        if ENDINGS.get(Path(name).suffix.lower()) == "text":
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
    _known: dict[str, dict[str, NDArray[Any]]] = field(default_factory=dict)

    def columns(self, name: str) -> Mapping[str, NDArray[Any]]:
        """Columns of a table, as texts.

        Raises:
            InputError: It is in none of the folders, or damaged.
        """
        if name not in self._known:
            path = next((there for folder in self.folders if (there := folder / name).is_file()), None)
            if path is None:
                places = ", ".join(str(folder) for folder in self.folders)
                raise InputError(f"{name}: no such table of labels; looked in {places}.")
            contents = open_contents(path, self.how)
            self._known[name] = {key: np.asarray(of) for key, of in contents.read(list(contents.variables))[0].items()}
        return self._known[name]

    def label(self, source: LabelSource, file: SourceFile) -> Label:
        """Values of a column in the rows of a file, or in all rows if none names a file.

        Raises:
            InputError: There is no such column, or no row for this file.
        """
        columns = self.columns(source.name)
        column = source.column or source.key
        if column not in columns:
            raise InputError(f"{source.name}: no column {column!r}; columns: {', '.join(columns)[:200]}.")
        ending_free = file.below.rpartition(".")[0] or file.below
        names = {file.below, file.path.name, ending_free, ending_free.rpartition("/")[2]}
        for key, texts in columns.items():
            rows = np.flatnonzero(np.isin(texts, list(names))) if key != column else []
            if len(rows):
                return str(columns[column][rows[0]]) if len(rows) == 1 else columns[column][rows]
        if any(Path(text).suffix.lower() in ENDINGS for texts in columns.values() for text in texts[:1].tolist()):
            raise InputError(f"{file.path}: {source.name} has no row for this file.")
        return ByOrder(columns[column], source.name)


def needed(sources: Sequence[LabelSource], fields: dict[str, str], contents: Contents) -> list[str]:
    """Variables of a file that hold labels."""
    names = [filled(each.name, fields) for each in sources if each.kind in ("column", "date")]
    return [contents.named(name) for name in names if name not in contents.attributes]


def label_of(
    source: LabelSource, file: SourceFile, contents: Contents, values: Mapping[str, Values], tables: LabelTables
) -> Label:
    """A label of the taps or rows of a file.

    Raises:
        InputError: It is nowhere, or differs in shape between rows.
    """
    fields = file.fields
    if source.kind == "constant":
        return source.name
    if source.kind == "field":
        return fields[source.name]
    if source.kind == "table":
        return tables.label(source, file)
    if source.kind == "file":
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
