"""Tables of labels beside a recording."""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from ...errors import InputError
from ..recording import naming, runs
from .file_rows import FileRows, counts_otherwise, file_rows, rows_by_field, rows_by_key
from .files import SourceFile
from .formats.contents import Contents, TextTable, Values
from .formats.registry import open_contents
from .label_values import as_known, as_texts
from .labels import ByOrder, Label, LabelSource
from .patterns import filled

_SEVERAL = re.compile(r"[,;\t|]")


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
        """The other columns that hold texts or whole numbers, as texts."""
        others = {key: of for key, of in self.columns.items() if key != self.name and of.dtype.kind in "Uiu"}
        return {key: of if of.dtype.kind == "U" else np.array(as_texts(of)) for key, of in others.items()}


@dataclass(frozen=True, eq=False)
class LabelTables:
    """Tables beside the recording.

    Attributes:
        folders: Where they are looked for, in this order.
        how: How they are written.
        files: All files of the recording.
        labels: Tables and columns of all labels.
        events: The table of presses, which rows of files do not share.
        time: The column of times, likewise.
        told: How each table was read, a sentence by its name.
    """

    folders: Sequence[Path]
    how: TextTable
    files: Sequence[SourceFile] = ()
    labels: Collection[tuple[str, str]] = ()
    events: str = ""
    time: str = ""
    told: dict[str, str] = field(default_factory=dict)
    _opened: dict[tuple[Path, TextTable], tuple[Contents, dict[str, NDArray[Any]]]] = field(default_factory=dict)
    _known: dict[tuple[Path, str, str], TableColumn] = field(default_factory=dict)
    _places: dict[tuple[str, Path], Path] = field(default_factory=dict)
    _counting: dict[tuple[Path, str, int], list[str]] = field(default_factory=dict)
    _by_file: dict[tuple[Path, str, str, str], FileRows] = field(default_factory=dict)

    @cached_property
    def numbers(self) -> Mapping[Path, int]:
        """Number of each file of the recording, from 0."""
        return {file.path: number for number, file in enumerate(self.files)}

    def label(
        self, source: LabelSource, file: SourceFile, rows: int, contents: Contents, found: Mapping[str, Values]
    ) -> Label:
        """Values of a column: in the rows about the file, by columns that both have, or else in their order.

        Args:
            source: The table and column; the only column needs no name.
            file: The file that is labelled.
            rows: Number of its rows, or of its taps.
            contents: What it holds.
            found: Its variables that were read.

        Raises:
            InputError: There is no such table or column, or no row for this file, or for a row of it.
        """
        name, column = filled(source.name, file.fields), self.column(source, file)
        about = FileRows({}) if source.by == "order" else self._about(source, file)
        keys = self.shared(source, file, contents)
        about = FileRows({}) if keys and about.numbered else about
        among = np.array(about.rows.get(file.path, ()) if about.by else np.arange(len(column.values)), dtype=np.intp)
        if not len(among):
            raise InputError(f"{name} has no row for this file.")
        by, both = [about.by] * bool(about.by), self._both(source, file, contents)
        if keys:
            by.append(f"its column{'s' * (len(keys) > 1)} {', '.join(keys)}")
            self.told[name] = f"{name} is read by {' and '.join(by)}, which the recording has as well."
            own = [column.columns[key][among] for key in keys]
            return column.values[among[_matching(own, [np.asarray(found[of]) for of in keys.values()], list(keys))]]
        if by:
            self.told[name] = f"{name} is read by {by[0]}."
        elif source.name != self.events:
            why = "" if source.by or both else ", as it names no files and shares no column"
            self.told[name] = f"{name} is read in the order of the taps{why}."
        values = column.values[among]
        if len(values) == 1 and by:
            return str(values[0])
        these, place = tuple(among.tolist()), (str(column.path), column.name)
        counts: list[str] = []
        if not source.by:
            counts = self._contrary(source, column, among, both, found) or _names_columns(column, contents)
        alone = list(about.rows.values()).count(about.rows[file.path]) == 1 if by else len(self.files) == 1
        if len(values) == rows and alone and not counts:
            return values
        if source.by or source.name == self.events:
            return ByOrder(values, name, place, these)
        hint = _hint(source, column.name, about, counts)
        return ByOrder(values, name, place, these, hint, "rows" if counts else "files" if about.doubt else "")

    def _contrary(
        self,
        source: LabelSource,
        column: TableColumn,
        among: NDArray[np.intp],
        both: Mapping[str, str],
        found: Mapping[str, Values],
    ) -> list[str]:
        """Columns by which rows are not in the order of the taps: they count otherwise, or differ from those here."""
        if not both and (known := self._counting.get((column.path, column.name, len(among)))) is not None:
            return known
        beside = {key: of[among] for key, of in column.texts_beside.items() if (source.name, key) not in self.labels}
        if not both:
            found_here = [key for key, of in beside.items() if counts_otherwise(of)]
            if len(among) == len(column.values):  # the same for all files
                self._counting[column.path, column.name, len(among)] = found_here
            return found_here
        groups = _joint([column.columns[key][among] for key in both])
        here = [np.asarray(found[of]) for of in both.values()]
        here = _joint([of[runs(*here)] for of in here])
        there = [group for n, group in enumerate(groups) if not n or group != groups[n - 1]]
        inside = range(len(there) - len(here) + 1) if len(self.files) > 1 else [0] * (len(there) == len(here))
        if not any(there[n : n + len(here)] == here for n in inside):
            return list(both)
        return [key for key, of in beside.items() if counts_otherwise(of, groups)]

    def _about(self, source: LabelSource, file: SourceFile) -> FileRows:
        """Rows of a table by file, and what tells so."""
        name = filled(source.name, file.fields)
        path = self.place(name, file)
        key = path, source.column or source.key, source.by, source.own
        if key not in self._by_file:
            column = self.column(source, file)
            files = [each for each in self.files if filled(source.name, each.fields) == name]
            files = [each for each in files if each.path.is_relative_to(path.parent)] or files
            self._by_file[key] = self._told_by(source, column, files)
        return self._by_file[key]

    def _told_by(self, source: LabelSource, column: TableColumn, files: Sequence[SourceFile]) -> FileRows:
        if not source.by:
            found = file_rows(column.texts_beside, files)
            if not found.by and not found.doubt and column.values.dtype.kind == "U" and len(files) > 1:
                own = file_rows({column.name: column.values}, files)
                return own if own.rows and all(own.rows.values()) else found
            return found
        if source.by not in column.columns:
            raise InputError(f"{source.name}: no column {source.by}; columns: {', '.join(column.columns)[:200]}.")
        key = column.columns[source.by]
        if source.own:
            in_names = all(source.own.casefold() in file.fields for file in files)
            rows = rows_by_field(key, source.own, files) if in_names else {}
        else:
            rows = rows_by_key(source.by, key, files)
            in_names = any(rows.values())
        return FileRows(rows, f"its column {source.by}") if in_names else FileRows({})

    def shared(self, source: LabelSource, file: SourceFile, contents: Contents) -> dict[str, str]:
        """Columns of a table that tell its rows apart, beside that of the labels, and the variables of a file they are.

        As few as do, in the order of the table; none where there is one row for the file.

        Raises:
            InputError: They tell half of the rows apart or more, but not all; or there is no such variable.
        """
        if source.name == self.events or source.by == "order":
            return {}
        about = self._about(source, file)
        column, own = self.column(source, file), self._both(source, file, contents)
        if source.by and not about.by:
            own = {source.by: contents.named(source.own or source.by)} | own
        whole = not about.by or about.numbered
        among = range(len(column.values)) if whole else about.rows.get(file.path, ())
        both = list(own)
        if len(among) < 2 or not both:
            return {}
        for number in range(1, len(both) + 1):
            texts = _joint([column.columns[key][list(among)] for key in both[:number]])
            if len(set(texts)) == len(texts):
                return {key: own[key] for key in both[:number]}
            if number == len(both) and (source.by in both or 2 * len(set(texts)) >= len(texts)):
                twice = Counter(texts).most_common(1)[0][0]
                raise InputError(f"the table has {', '.join(both)} {', '.join(twice)} in two rows.")
        return {}

    def needed(self, source: LabelSource, file: SourceFile, contents: Contents) -> list[str]:
        """Variables of a file that a table of labels has as well."""
        return list((self.shared(source, file, contents) or self._both(source, file, contents)).values())

    def _both(self, source: LabelSource, file: SourceFile, contents: Contents) -> dict[str, str]:
        """Columns of a table, beside that of the labels, and the variables of a file that are called so."""
        if source.name == self.events:
            return {}
        column = self.column(source, file)
        found = {key: _alike(key, contents) for key in column.columns if key not in (column.name, self.time)}
        found = {key: of for key, of in found.items() if of and not key.isdecimal()}
        return {key: of for key, of in found.items() if len(contents.variables[of].shape) == 1}

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
        path = self.place(name, file)
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

    def place(self, name: str, file: SourceFile) -> Path:
        """Where a table is.

        Raises:
            InputError: There is none.
        """
        beside = file.path.parent
        if (name, beside) in self._places:
            return self._places[name, beside]
        folders = [beside, *self.folders]
        path = next((there for folder in folders if (there := folder / name).is_file()), None)
        if path is None:
            places = ", ".join(dict.fromkeys(str(folder) for folder in folders))
            raise InputError(f"{name}: no such table; looked in {places}.")
        self._places[name, beside] = path
        return path


def _hint(source: LabelSource, column: str, about: FileRows, counts: Sequence[str]) -> str:
    """How a table may be read in another way."""
    name = f"{source.name}:{column}"
    if counts:
        return (
            f"by its column {counts[0]} its rows are in another order than the taps; {name}:KEY reads it by the names "
            f"of files in its column KEY, {name}:KEY=OWN by a column or field OWN of the recording, {name}:order in "
            "the order of the taps"
        )
    if about.doubt:
        return f"{about.doubt}; {name}:COLUMN reads it by these numbers, {name}:order in the order of the taps"
    return f"{name}:KEY=OWN compares its column KEY with a column or field OWN of the recording"


def _names_columns(column: TableColumn, contents: Contents) -> list[str]:
    """Columns of a table that name columns or arrays of a file, one for each row and in another order than these."""
    there = list(contents.variables)
    known = {key: of.tolist() for key, of in column.texts_beside.items() if set(of.tolist()) <= set(there)}
    return [key for key, of in known.items() if 1 < len(of) == len(set(of)) and of != sorted(of, key=there.index)]


def _alike(name: str, contents: Contents) -> str:
    """The variable of a file that is called so, with large or small letters if only one is; empty if none is."""
    found = [each for each in contents.variables if each.casefold() == name.casefold()]
    return name if name in found else found[0] if len(found) == 1 else ""


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
