"""Where labels stand: in columns and arrays, in the names of files, in tables beside them."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..recording import naming, runs
from .files import SourceFile
from .formats.contents import Contents, TextTable, Values
from .formats.registry import ENDINGS, ending, open_contents
from .mapping import option
from .patterns import filled, number_in, unclear_comma

_EXACT = 4  # names of a file as they are written
_HEADERS = {"what", "where", "name", "object", "label", "class", "position", "value", "id", "what_name", "where_value"}
"""Of lists of names and positions; another first line is the first of them."""
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
        kind: `"column"`, `"field"`, `"table"`, `"constant"`, `"file"`, `"gap"`, `"date"` of a column, or `"day"`, a
            field with a date.
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
    if begin == "date" and key == "session" and (rest.startswith(("file:", "folder:")) or rest == "{session}"):
        return LabelSource(key, "day", "session")
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
        files: All files of the recording.
    """

    folders: Sequence[Path]
    how: TextTable
    files: Sequence[SourceFile] = ()
    _known: dict[Path, dict[str, NDArray[Any]]] = field(default_factory=dict)
    _naming: dict[tuple[Path, str], dict[str, list[int]]] = field(default_factory=dict)

    @cached_property
    def numbers(self) -> Mapping[Path, int]:
        """Number of each file of the recording, from 0."""
        return {file.path: number for number, file in enumerate(self.files)}

    def label(
        self, source: LabelSource, file: SourceFile, rows: int, contents: Contents, found: Mapping[str, Values]
    ) -> Label:
        """Values of a column: in the rows that name the file, else by a column that both have, else in their order.

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
        values, _ = self.column(source, file)
        if (shared := self.shared(source, file, contents)) is not None:
            return values[_matching(self._columns(self._place(name, file))[shared], np.asarray(found[shared]), shared)]
        named = self._named(source, file)
        if named:
            if not (of_file := rows_of(file, named)):
                raise InputError(f"{name} has no row for this file.")
            return str(values[of_file[0]]) if len(of_file) == 1 else values[of_file]
        return values if len(self.files) == 1 and len(values) == rows else ByOrder(values, name)

    def names(self, source: LabelSource, file: SourceFile) -> NDArray[Any]:
        """Values of a column; of a list without a header all lines.

        Raises:
            InputError: As of `column`.
        """
        values, _ = self.column(source, file)
        columns = self._columns(self._place(source.name, file))
        header = next(iter(columns))
        if len(columns) > 1 or source.column or header.casefold().removesuffix("s") in _HEADERS:
            return values
        return np.array([header, *as_texts(values)])

    def shared(self, source: LabelSource, file: SourceFile, contents: Contents) -> str | None:
        """The column that both a table, which does not name files, and a file have, beside that of the labels."""
        values, _ = self.column(source, file)
        columns = self._columns(self._place(filled(source.name, file.fields), file))
        both = [key for key, of in columns.items() if key in contents.variables and of is not values]
        both = [key for key in both if len(contents.variables[key].shape) == 1 and not key.isdecimal()]
        return both[0] if both and not self._named(source, file) else None

    def _named(self, source: LabelSource, file: SourceFile) -> Mapping[str, list[int]]:
        """Rows of a table by the name of their file, see `rows_by_file`."""
        path = self._place(filled(source.name, file.fields), file)
        if (path, source.column) not in self._naming:
            below = [each for each in self.files if each.path.is_relative_to(path.parent)] or list(self.files)
            self._naming[path, source.column] = rows_by_file(self.column(source, file)[1], below)
        return self._naming[path, source.column]

    def column(self, source: LabelSource, file: SourceFile) -> tuple[NDArray[Any], dict[str, NDArray[Any]]]:
        """A column of a table beside a file or in another folder, and the other columns that hold texts.

        Args:
            source: The table and column; the only column, and one that is called like the label, needs no name.
            file: The file.

        Raises:
            InputError: There is no such table or column, or the table is damaged.
        """
        name = filled(source.name, file.fields)
        columns = self._columns(self._place(name, file))
        column = source.column or (next(iter(columns)) if len(columns) == 1 else source.key)
        if column not in columns:
            raise InputError(f"{name}: no column {column!r}; columns: {', '.join(columns)[:200]}.")
        return columns[column], {key: of for key, of in columns.items() if key != column and of.dtype.kind == "U"}

    def _place(self, name: str, file: SourceFile) -> Path:
        folders = [file.path.parent, *self.folders]
        path = next((there for folder in folders if (there := folder / name).is_file()), None)
        if path is None:
            places = ", ".join(dict.fromkeys(str(folder) for folder in folders))
            raise InputError(f"{name}: no such table; looked in {places}.")
        return path

    def _columns(self, path: Path) -> Mapping[str, NDArray[Any]]:
        """Columns of a table, or the arrays of one axis of a file."""
        if path not in self._known:
            contents = open_contents(path, self.how)
            values = contents.read(list(contents.variables))[0]
            arrays = {key: of for key, of in values.items() if isinstance(of, np.ndarray)}
            self._known[path] = {
                key: of.reshape(-1) for key, of in arrays.items() if of.size == max(of.shape, default=1)
            }
        return self._known[path]


def _matching(keys: NDArray[Any], wanted: NDArray[Any], name: str) -> NDArray[np.intp]:
    """The row of each wanted key, of numbers by their value."""
    rows: dict[str, int] = {}
    for row, text in enumerate(as_texts(as_known(keys))):
        if rows.setdefault(text, row) != row:
            raise InputError(f"the table has {name} {text} in two rows.")
    texts, _, which = distinct(as_known(wanted))
    missing = [text for text in texts if text not in rows]
    if missing:
        raise InputError(f"the table has no row with {name} {missing[0]}.")
    return np.array([rows[text] for text in texts])[which]


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
) -> NDArray[Any] | None:
    """The column that has most of the names of the files."""
    best, most = None, 0
    for of in columns.values():
        there = {*of.tolist(), *map(str.casefold, of.tolist())}
        count = sum(any(text in there for text in names(file)) for file in files)
        numbers = all(text.isdecimal() for text in there)
        if numbers and (count < max(2, len(files)) or len(there) < len(of)):
            count = 0
        if count > most:
            best, most = of, count
    return best


def rows_by_file(columns: Mapping[str, NDArray[Any]], files: Sequence[SourceFile]) -> dict[str, list[int]]:
    """Rows by the name of their file, from the column that names most files; empty where none does.

    A column of plain numbers names files only if it names all of several, each once: it may count something else.

    Raises:
        InputError: A name is that of files in several folders.
    """
    best = _naming(columns, files, _names_of)
    best = _naming(columns, files, _number_of) if best is None else best
    if best is None:
        has_endings = any(ending(text) in ENDINGS for of in columns.values() for text in of[:1].tolist())
        return {"": []} if has_endings else {}
    rows: dict[str, list[int]] = {}
    exact = {text for file in files for text in _names_of(file)[:_EXACT]}
    for row, text in enumerate(best.tolist()):
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


def needed(sources: Sequence[LabelSource], file: SourceFile, contents: Contents, tables: LabelTables) -> list[str]:
    """Variables of a file that hold labels, or that a table of labels has as well."""
    found = []
    for source in sources:
        name = filled(source.name, file.fields)
        with naming(option(source.key)):
            if source.kind in ("column", "date") and name not in contents.attributes:
                found.append(contents.named(name))
            elif source.kind == "table" and (shared := tables.shared(source, file, contents)) is not None:
                found.append(shared)
    return found


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
        InputError: It is nowhere, or differs in shape between rows; the message names the key.
    """
    with naming(option(source.key)):
        match source.kind:
            case "constant":
                return source.name
            case "field" | "day":
                return file.fields[source.name]
            case "table":
                return tables.label(source, file, rows, contents, values)
            case "file":
                return tables.numbers[file.path]
            case "gap":
                return ""
            case _:
                return _in_file(filled(source.name, file.fields), contents, values)


def _in_file(name: str, contents: Contents, values: Mapping[str, Values]) -> Label:
    """An attribute, or the values of a column or array."""
    if name in contents.attributes and name not in contents.variables:
        return contents.attributes[name]
    found = values[contents.named(name)]
    if isinstance(found, list):
        raise InputError(f"{name} has elements of different shapes, so it holds no labels.")
    found = found.reshape(-1) if found.size == max(found.shape, default=1) else found
    if found.ndim > 1:
        raise InputError(f"{name} has shape {found.shape}, expected one value for each tap.")
    return found if found.size != 1 else found.reshape(-1)[0].item()


def as_texts(values: NDArray[Any]) -> list[str]:
    """Labels as texts, whole numbers without a point."""
    if values.dtype.kind == "f":
        return [f"{value:.15g}" for value in values.tolist()]
    if values.dtype.kind == "S":
        return [value.decode("utf-8", "replace") for value in values.tolist()]
    return [str(value) for value in values.tolist()]


def distinct(values: NDArray[Any]) -> tuple[list[str], NDArray[np.intp], NDArray[np.intp]]:
    """Labels as texts, each once, in the order of appearance; first row of each, and which one each row has.

    Rows that follow one another mostly have the same, so that few of them are made texts.
    """
    starts = runs(values)
    texts, first, which = np.unique(as_texts(values[starts]), return_index=True, return_inverse=True)
    order = np.argsort(first)
    lengths = np.diff(starts, append=len(values))
    return texts[order].tolist(), starts[first[order]], np.repeat(np.argsort(order)[which], lengths)


LENGTHS_AND_ANGLES = {"m", "cm", "mm", "um", "µm", "nm", "in", "deg", "rad", "°"}


_PLAIN = re.compile(r"[-+\u2212]?[\d.,]+(?:[eE][-+]?\d+)? ?(?:°|[^\W\d_]{1,3})?")
"""A number alone or with a unit."""


@cache
def _as_number(text: str) -> tuple[float, str] | None:
    """A finite number and its unit; `None` for another text."""
    try:
        number = float(text) if "_" not in text else np.nan  # Python takes 1_000 for a number
    except ValueError:
        return number_in(text)
    return (number, "") if np.isfinite(number) else number_in(text)


def are_names(listed: NDArray[Any]) -> bool:
    """Whether a list of objects or positions holds names, not numbers with or without a unit."""
    return listed.dtype.kind in "US" and not all(map(_PLAIN.fullmatch, as_texts(listed)))


def by_name(
    key: str, values: NDArray[Any], listed: NDArray[Any], place: Callable[[int], str]
) -> NDArray[np.intp] | None:
    """Number of each label in a list of names; `None` where labels are numbers of its entries.

    Args:
        key: Which label.
        values: Labels, shape (n,).
        listed: The names.
        place: Where one of the labels stands.

    Raises:
        InputError: A name is not in the list, or is there twice.
    """
    number = {name: n for n, name in enumerate(as_texts(listed))}
    list_of = option("what_names" if key == "what" else "where_values")
    if are_names(listed) and len(number) < len(listed):
        raise InputError(f"{list_of} has a name twice: {', '.join(as_texts(listed))[:200]}.")
    texts, first, which = distinct(values)
    if not are_names(listed) or all(map(_PLAIN.fullmatch, texts)):
        return None
    for text, row in zip(texts, first.tolist(), strict=True):
        if text not in number:
            raise InputError(f"{option(key)}: {text!r} of {place(row)} is not in {list_of}: {', '.join(number)[:200]}.")
    return np.array([number[text] for text in texts], dtype=np.intp)[which]


def _no_number(key: str, text: str) -> str:
    """Why a text is none, and what to do."""
    if unclear_comma(text):
        return "has a comma that may be a decimal mark or separate thousands; write a point, or no comma"
    if key == "where" and text.lower() not in ("", "nan", "inf", "-inf") and not any(map(str.isdecimal, text)):
        return f"is not one number; list the names of positions in their order in {option('where_values')}"
    return "is not one number"


def as_numbers(
    key: str, values: NDArray[Any], place: Callable[[int], str] = "tap {}".format
) -> tuple[NDArray[np.float64], str]:
    """Labels as numbers, and the unit that all texts state.

    Args:
        key: Which label.
        values: Numbers or texts.
        place: Where one of them stands.

    Raises:
        InputError: One holds no number, or more than one, or one with a comma that may mean two things, or they have
            different units of length or angle.
    """
    if values.dtype.kind in "fiub" and np.isfinite(values).all():
        return values.astype(np.float64), ""
    texts, first, which = distinct(values)
    numbers, units = np.empty(len(texts)), set[str]()
    for number, text in enumerate(texts):
        found = _as_number(text)
        if found is None:
            raise InputError(f"{option(key)}: {text!r} of {place(int(first[number]))} {_no_number(key, text)}.")
        numbers[number] = found[0]
        units.add(found[1])
    if len(known := sorted(units & LENGTHS_AND_ANGLES)) > 1:
        raise InputError(f"{option(key)}: units differ, {' and '.join(known)}.")
    return numbers[which], units.pop() if len(units) == 1 else ""
