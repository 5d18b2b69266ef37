"""Tables of labels beside a recording."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from ...errors import InputError
from ..recording import naming, runs
from .files import SourceFile
from .formats.contents import Contents, TextTable, Values
from .formats.registry import ENDINGS, ending, open_contents
from .label_values import as_known, as_texts
from .labels import ByOrder, Label, LabelSource
from .patterns import filled

_SEVERAL = re.compile(r"[,;\t|]")
_EXACT = 4  # names of a file as they are written
_HEADERS = {"what", "where", "name", "object", "label", "class", "position", "value", "id", "what_name", "where_value"}
"""Of lists of names and positions; another first line is the first of them."""


class TableColumn(NamedTuple):
    """A column of a table.

    Attributes:
        name: Of the column.
        values: Its values, shape (rows,).
        unit: That its header states, or empty.
        columns: All columns of the table.
        path: Of the table.
    """

    name: str
    values: NDArray[Any]
    unit: str
    columns: Mapping[str, NDArray[Any]]
    path: Path

    @property
    def texts_beside(self) -> dict[str, NDArray[Any]]:
        """The other columns that hold texts."""
        return {key: of for key, of in self.columns.items() if key != self.name and of.dtype.kind == "U"}


@dataclass(frozen=True, eq=False)
class LabelTables:
    """Tables beside the recording.

    Attributes:
        folders: Where they are looked for, in this order.
        how: How they are written.
        files: All files of the recording.
        events: The table of presses, which rows of files do not share.
        time: The column of times, likewise.
        told: How each table was read, a sentence by its name.
    """

    folders: Sequence[Path]
    how: TextTable
    files: Sequence[SourceFile] = ()
    events: str = ""
    time: str = ""
    told: dict[str, str] = field(default_factory=dict)
    _opened: dict[tuple[Path, TextTable], tuple[Contents, dict[str, NDArray[Any]]]] = field(default_factory=dict)
    _known: dict[tuple[Path, str, str], TableColumn] = field(default_factory=dict)
    _naming: dict[tuple[Path, str, bool], dict[str, list[int]]] = field(default_factory=dict)

    @cached_property
    def numbers(self) -> Mapping[Path, int]:
        """Number of each file of the recording, from 0."""
        return {file.path: number for number, file in enumerate(self.files)}

    def label(
        self, source: LabelSource, file: SourceFile, rows: int, contents: Contents, found: Mapping[str, Values]
    ) -> Label:
        """Values of a column: in the rows that name the file, by columns that both have, or else in their order.

        Args:
            source: The table and column; the only column needs no name.
            file: The file that is labelled.
            rows: Number of its rows, or of its taps.
            contents: What it holds.
            found: Its variables that were read.

        Raises:
            InputError: There is no such table or column, or no row for this file, or for a row of it.
        """
        name = filled(source.name, file.fields)
        column = self.column(source, file)
        values = column.values
        among, by = self._rows(source, file)
        if keys := self.shared(source, file, contents):
            own = [column.columns[key][among] for key in keys]
            by = " and ".join([*([by] if by else []), f"its column{'s' * (len(keys) > 1)} {', '.join(keys)}"])
            self.told[name] = f"{name} is read by {by}, which the recording has as well."
            return values[among[_matching(own, [np.asarray(found[key]) for key in keys], keys)]]
        if not by:
            among, by = self._rows(source, file, numbers=True)
        if by:
            self.told[name] = f"{name} is read by {by}."
            return str(values[among[0]]) if len(among) == 1 else values[among]
        if name != self.events:
            self.told[name] = f"{name} is read in the order of the taps, as it names no files and shares no column."
        return values if len(self.files) == 1 and len(values) == rows else ByOrder(values, name)

    def _rows(self, source: LabelSource, file: SourceFile, numbers: bool = False) -> tuple[NDArray[np.intp], str]:
        """Rows of a table that are about a file, and what tells so; all of them and an empty text if nothing does."""
        if not (named := self._named(source, file, numbers)):
            return np.arange(len(self.column(source, file).values)), ""
        if not (rows := rows_of(file, named)):
            raise InputError(f"{filled(source.name, file.fields)} has no row for this file.")
        return np.array(rows, dtype=np.intp), "numbers in the names of files" if numbers else "names of files"

    def names(self, source: LabelSource, file: SourceFile) -> NDArray[Any]:
        """Values of a column; of a list without a header all lines.

        Raises:
            InputError: As of `column`.
        """
        column = self.column(source, file)
        if len(column.columns) > 1 or source.column or column.name.casefold().removesuffix("s") in _HEADERS:
            return column.values
        return np.array([column.name, *as_texts(column.values)])

    def shared(self, source: LabelSource, file: SourceFile, contents: Contents) -> list[str]:
        """Columns of a table, beside that of the labels, that a file has as well and that tell its rows apart.

        As few as do, in the order of the table; none where there is one row for the file.

        Raises:
            InputError: They tell half of the rows apart or more, but not all.
        """
        if source.name == self.events:
            return []
        column = self.column(source, file)
        columns, apart = column.columns, (column.name, self.time)
        among, _ = self._rows(source, file)
        both = [key for key in columns if key in contents.variables and key not in apart]
        both = [key for key in both if len(contents.variables[key].shape) == 1 and not key.isdecimal()]
        if len(among) < 2 or not both:
            return []
        for number in range(1, len(both) + 1):
            texts = _joint([columns[key][among] for key in both[:number]])
            if len(set(texts)) == len(texts):
                return both[:number]
            if number == len(both) and 2 * len(set(texts)) >= len(texts):
                twice = Counter(texts).most_common(1)[0][0]
                raise InputError(f"the table has {', '.join(both)} {', '.join(twice)} in two rows.")
        return []

    def _named(self, source: LabelSource, file: SourceFile, numbers: bool = False) -> Mapping[str, list[int]]:
        """Rows of a table by the name of their file or the number in it, see `rows_by_file`."""
        path = self._place(filled(source.name, file.fields), file)
        key = path, source.column, numbers
        if key not in self._naming:
            below = [each for each in self.files if each.path.is_relative_to(path.parent)] or list(self.files)
            self._naming[key] = rows_by_file(self.column(source, file).texts_beside, below, numbers)
        return self._naming[key]

    def column(self, source: LabelSource, file: SourceFile) -> TableColumn:
        """A column of a table beside a file or in another folder.

        A table that is written in another way than the recording is read as it is written.

        Args:
            source: The table and column; the only column, and one that is called like the label, needs no name.
            file: The file.

        Raises:
            InputError: There is no such table or column, or the table is damaged.
        """
        name = filled(source.name, file.fields)
        path = self._place(name, file)
        key = path, source.column, source.key
        if key not in self._known:
            whys = []
            for how in dict.fromkeys([structs.replace(self.how, delimiter=None), self.how, TextTable()]):
                try:
                    self._known[key] = self._read(path, name, source, how)
                except InputError as error:
                    whys.append(error)
                else:
                    break
            else:
                raise whys[0]
        return self._known[key]

    def _read(self, path: Path, name: str, source: LabelSource, how: TextTable) -> TableColumn:
        """A column of a table that is written in some way, or an array of one axis of a file."""
        if (path, how) not in self._opened:
            contents = open_contents(path, how)
            values = contents.read(list(contents.variables))[0]
            arrays = {key: of for key, of in values.items() if isinstance(of, np.ndarray)}
            columns = {key: of.reshape(-1) for key, of in arrays.items() if of.size == max(of.shape, default=1)}
            self._opened[path, how] = contents, columns
        contents, columns = self._opened[path, how]
        with naming(name):
            alone = len(columns) == 1 and not source.column
            column = next(iter(columns)) if alone else contents.named(source.column or source.key)
            first = [column, *as_texts(columns[column][:1])] if alone else []
            if _SEVERAL.search(" ".join(first)):
                raise InputError(f"{first[0]!r} may be several columns; say which with {name}:COLUMN.")
            if column not in columns:
                raise InputError(f"{column} has shape {contents.variables[column].shape}, so it is no column.")
        return TableColumn(column, columns[column], contents.variables[column].unit, columns, path)

    def _place(self, name: str, file: SourceFile) -> Path:
        folders = [file.path.parent, *self.folders]
        path = next((there for folder in folders if (there := folder / name).is_file()), None)
        if path is None:
            places = ", ".join(dict.fromkeys(str(folder) for folder in folders))
            raise InputError(f"{name}: no such table; looked in {places}.")
        return path


def _joint(columns: Sequence[NDArray[Any]]) -> list[tuple[str, ...]]:
    """The texts of each row, of numbers by their value."""
    return list(zip(*(as_texts(as_known(of)) for of in columns), strict=True))


def _matching(keys: Sequence[NDArray[Any]], wanted: Sequence[NDArray[Any]], names: Sequence[str]) -> NDArray[np.intp]:
    """The row of each wanted key."""
    row = {key: number for number, key in enumerate(_joint(keys))}
    starts = runs(*wanted)
    texts = _joint([of[starts] for of in wanted])
    missing = [key for key in texts if key not in row]
    if missing:
        raise InputError(f"the table has no row with {', '.join(names)} {', '.join(missing[0])}.")
    return np.repeat([row[key] for key in texts], np.diff(starts, append=len(wanted[0])))


def _names_of(file: SourceFile) -> tuple[str, ...]:
    """What a table may call a file, with large or small letters."""
    free = file.below.rpartition(".")[0] or file.below
    names = file.below, free, file.path.name, free.rpartition("/")[2]
    return *names, *map(str.casefold, names)


def _number_of(file: SourceFile) -> tuple[str, ...]:
    """The only number in its name, by which a table may call a file as well."""
    numbers = re.findall(r"\d+", file.path.stem)
    return tuple(str(int(number)) for number in numbers) if len(numbers) == 1 else ()


def rows_of(file: SourceFile, named: Mapping[str, list[int]]) -> list[int]:
    """Rows of a file among those by name, empty if it has none."""
    return next((named[text] for text in (*_names_of(file), *_number_of(file)) if text in named), [])


def _naming(
    columns: Mapping[str, NDArray[Any]], files: Sequence[SourceFile], names: Callable[[SourceFile], tuple[str, ...]]
) -> list[str]:
    """The columns that have most of the names of the files."""
    count: dict[str, int] = {}
    for name, of in columns.items():
        there = {*of.tolist(), *map(str.casefold, of.tolist())}
        count[name] = sum(any(text in there for text in names(file)) for file in files)
        numbers = all(text.isdecimal() for text in there)
        if numbers and (count[name] < max(2, len(files)) or len(there) < len(of)):
            count[name] = 0
    most = max(count.values(), default=0)
    return [name for name, number in count.items() if number == most > 0]


def rows_by_file(
    columns: Mapping[str, NDArray[Any]], files: Sequence[SourceFile], numbers: bool = False
) -> dict[str, list[int]]:
    """Rows by the name of their file, from the column that names most files; empty where none does.

    A column of plain numbers names files only if it names all of several, each once: it may count something else.

    Args:
        columns: Of texts.
        files: The files.
        numbers: Whether files go by the only number in their names instead.

    Raises:
        InputError: A name is that of files in several folders, or several columns number the files.
    """
    best = _naming(columns, files, _number_of if numbers else _names_of)
    if numbers and len(best) > 1:
        raise InputError(f"columns {' and '.join(best)} of the table of labels may both number the files; keep one.")
    if not best:
        has_endings = any(ending(text) in ENDINGS for of in columns.values() for text in of[:1].tolist())
        return {"": []} if has_endings and not numbers else {}
    rows: dict[str, list[int]] = {}
    exact = {text for file in files for text in _names_of(file)[:_EXACT]}
    for row, text in enumerate(columns[best[0]].tolist()):
        rows.setdefault(text if text in exact else text.casefold(), []).append(row)
    used: dict[str, SourceFile] = {}
    for file in files:
        text = next((text for text in _names_of(file) if text in rows), None)
        if text is not None and used.setdefault(text, file) is not file:
            raise InputError(
                f"the table of labels names {text}, which {used[text].below} and {file.below} may be; write the folder "
                "before the name, as in a/1.csv."
            )
    return rows
