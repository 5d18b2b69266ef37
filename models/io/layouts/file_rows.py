"""Which rows of a table are about which file of a recording."""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .files import SourceFile
from .formats.registry import ENDINGS, ending
from .label_values import as_known, as_texts
from .patterns import NUMBERS, number_in

_ENDING = re.compile(r"\.[^\W\d]\w{0,5}$")
type Rows = dict[Path, list[int]]
type Columns = Mapping[str, NDArray[Any]]


class FileRows(NamedTuple):
    """Rows of a table by file.

    Attributes:
        rows: Of each file, in their order; nothing where no column tells.
        by: What tells so.
        doubt: Columns that nearly tell, in parts of a sentence.
        numbered: Whether the numbers in names tell, which columns that the recording has as well outweigh.
    """

    rows: Rows
    by: str = ""
    doubt: str = ""
    numbered: bool = False


def file_rows(columns: Columns, files: Sequence[SourceFile]) -> FileRows:
    """Rows by the names of files, by fields and folders in these, or by the numbers in them.

    A column of plain numbers names files, called so or with one number in their names, only if it has each of several
    once, and as for numbers in names nothing else: it may count something else.

    Args:
        columns: Of texts.
        files: Those that the table may be about.

    Raises:
        InputError: A row may be that of several files, or several columns number the files.
    """
    beside = {**_by_fields(columns, files), **_by_folders(columns, files)}
    if (naming := _naming(columns, files)) is not None:
        rows = _of_names(columns[naming], files)
        by = [f"names of files in its column {naming}"]
        if _twice(rows) and beside:
            rows, by = _common([rows, *beside.values()]), [*by, *beside]
        if (twice := _twice(rows)) is not None:
            text = columns[naming][twice[0]]
            one, other = (str(next(file.below for file in files if file.path == path)) for path in twice[1:])
            raise InputError(
                f"the table of labels names {text}, which {one} and {other} may be; write the folder before the name, "
                "as in a/1.csv, or into a column of its own."
            )
        return FileRows(rows, " and ".join(by))
    if any(ending(text) in ENDINGS for of in columns.values() for text in of[:1].tolist()):
        return FileRows({file.path: [] for file in files}, "names of files")
    if beside:
        return FileRows(_common(list(beside.values())), " and ".join(beside))
    return _by_numbers(columns, files)


def rows_by_key(name: str, values: NDArray[Any], files: Sequence[SourceFile]) -> Rows:
    """Rows by a column that tells files: by their names, a field of that name, the number or the folders in them."""
    ways = [
        _of_names(values, files),
        _rows(_in_field(values, name), files, lambda file: _field(file, name)),
        _rows(_whole(values), files, _number_of),
        _rows(_folded(values), files, _folders_of),
    ]
    return {file.path: next((of[file.path] for of in ways if of[file.path]), []) for file in files}


def rows_by_field(values: NDArray[Any], name: str, files: Sequence[SourceFile]) -> Rows:
    """Rows whose value is that of a field in the names of files."""
    return _rows(_in_field(values, name), files, lambda file: _field(file, name))


def _rows(texts: Sequence[str], files: Sequence[SourceFile], names: Callable[[SourceFile], Iterable[str]]) -> Rows:
    """Rows whose text is one of a file, of that which comes first."""
    where: dict[str, list[int]] = {}
    for row, text in enumerate(texts):
        where.setdefault(text, []).append(row)
    return {file.path: next((where[name] for name in names(file) if name in where), []) for file in files}


def _common(parts: Sequence[Rows]) -> Rows:
    common = {path: set(of).intersection(*(part[path] for part in parts[1:])) for path, of in parts[0].items()}
    return {path: sorted(of) for path, of in common.items()}


def _twice(rows: Rows) -> tuple[int, Path, Path] | None:
    """A row of two files, and these."""
    owner: dict[int, Path] = {}
    for path, of in rows.items():
        for row in of:
            if owner.setdefault(row, path) != path:
                return row, owner[row], path
    return None


def _names_of(file: SourceFile) -> tuple[str, ...]:
    """What a table may call a file."""
    free = file.below.rpartition(".")[0] or file.below
    return file.below, free, file.path.name, free.rpartition("/")[2]


def _of_names(values: NDArray[Any], files: Sequence[SourceFile]) -> Rows:
    """Rows by names as they are written, else with large or small letters, or with other folders and endings."""
    exact = {name for file in files for name in _names_of(file)}
    texts = as_texts(values)
    rows = _rows(
        [text if text in exact else text.casefold() for text in texts],
        files,
        lambda file: (*_names_of(file), *map(str.casefold, _names_of(file))),
    )
    elsewhere: dict[str, list[tuple[int, str]]] = {}
    for row, text in enumerate(texts):
        path = text.casefold().replace("\\", "/")
        free = _ENDING.sub("", path)
        if "/" in path or free != path:
            elsewhere.setdefault(free.rpartition("/")[2], []).append((row, f"/{free}"))
    stems = Counter(_ENDING.sub("", file.path.name.casefold()) for file in files)
    for file in files:
        end = _ENDING.sub("", f"/{file.below.casefold()}")
        named = elsewhere.get(end.rpartition("/")[2], []) if not rows[file.path] else []
        below = [row for row, path in named if path.endswith(end)]
        alone = stems[end.rpartition("/")[2]] == 1
        rows[file.path] += below or [row for row, _ in named if alone]
    return rows


def _naming(columns: Columns, files: Sequence[SourceFile]) -> str | None:
    """The column that has most of the names of the files."""
    count: dict[str, int] = {}
    for name, of in columns.items():
        count[name] = sum(map(bool, _of_names(of, files).values()))
        if _numbers(of) and (count[name] < max(2, len(files)) or len(set(of.tolist())) < len(of)):
            count[name] = 0
    most = max(count.values(), default=0)
    return next((name for name, number in count.items() if number == most > 0), None)


def _field(file: SourceFile, name: str) -> list[str]:
    key = name.casefold()
    return _in_field(np.array([file.fields[key]]), key) if key in file.fields and key != "taxel" else []


def _in_field(values: NDArray[Any], name: str) -> list[str]:
    """Values as those of a field are compared: numbers by their value."""
    if name.casefold() in NUMBERS:
        numbers = [number_in(text) for text in as_texts(values)]
        return ["" if number is None else f"{number[0]:.15g}" for number in numbers]
    return [as_texts(np.array([as_known(text)]))[0].casefold() for text in as_texts(values)]


def _by_fields(columns: Columns, files: Sequence[SourceFile]) -> dict[str, Rows]:
    """Rows by columns that are called like a field of the names of files, if they have its text for half of these."""
    found = {}
    for name, of in columns.items():
        if all(_field(file, name) for file in files):
            rows = rows_by_field(of, name, files)
            if 2 * sum(map(bool, rows.values())) >= len(files):
                found[f"its column {name}, as in the names of files"] = rows
    return found


def _folders_of(file: SourceFile) -> list[str]:
    return [folder.casefold() for folder in reversed(file.below.split("/")[:-1])]


def _folded(values: NDArray[Any]) -> list[str]:
    return [text.casefold() for text in as_texts(values)]


def _by_folders(columns: Columns, files: Sequence[SourceFile]) -> dict[str, Rows]:
    """Rows by columns of texts that name a folder of every file."""
    found = {}
    for name, of in columns.items():
        rows = {} if _numbers(of) else _rows(_folded(of), files, _folders_of)
        if rows and all(rows.values()):
            found[f"its column {name}, which names folders"] = rows
    return found


def _numbers(values: NDArray[Any]) -> bool:
    return all(text.isdecimal() for text in values.tolist())


def _number_of(file: SourceFile) -> list[str]:
    """The only number in its name."""
    numbers = re.findall(r"\d+", file.path.stem)
    return [str(int(number)) for number in numbers] if len(numbers) == 1 else []


def counts_otherwise(values: NDArray[Any], groups: Sequence[Any] = ()) -> bool:
    """Whether values are the numbers of all rows, from 0 or 1, in another order than that of the rows.

    Args:
        values: Texts.
        groups: What each row is of, if rows are counted in each of several.
    """
    if not _numbers(values):
        return False
    numbers: dict[Any, list[int]] = {}
    for group, text in zip(groups or [None] * len(values), values.tolist(), strict=True):
        numbers.setdefault(group, []).append(int(text))
    count = [sorted(of) == list(range(least := min(of), least + len(of))) and least < 2 for of in numbers.values()]
    return all(count) and any(of != sorted(of) for of in numbers.values())


def _whole(values: NDArray[Any]) -> list[str]:
    return [str(int(text)) if text.isdecimal() else text for text in as_texts(values)]


def _by_numbers(columns: Columns, files: Sequence[SourceFile]) -> FileRows:
    """Rows by a column that has the number in the name of each file once, and nothing else.

    Files that are numbered from 0 or 1 in another order than the rows may be in the order of these, so a column tells
    then only if names of files have its name.
    """
    wanted = [number for file in files for number in _number_of(file)]
    if len(set(wanted)) < len(files) or len(files) < 2:
        return FileRows({})
    doubts, same = [], dict[str, bool]()
    for name, of in columns.items():
        there = _whole(of)
        if not _numbers(of) or len(set(there)) < len(there) or 2 * len(set(wanted) & set(there)) < len(files):
            continue
        if set(there) == set(wanted):
            same[name] = not counts_otherwise(of)
        else:
            doubts.append(f"its column {name} has numbers in the names of files, but not the same ones")
    called = [name for name in same if all(name.casefold() in file.below.casefold() for file in files)]
    exact = called if len(called) == 1 else list(same)
    if len(exact) > 1:
        raise InputError(
            f"columns {' and '.join(exact)} of the table of labels may both number the files; say which with "
            f"TABLE:COLUMN:{exact[0]}."
        )
    if exact and (called or same[exact[0]]):
        rows = _rows(_whole(columns[exact[0]]), files, _number_of)
        return FileRows(rows, f"numbers of files in its column {exact[0]}", numbered=True)
    return FileRows({}, doubt="; ".join(doubts))
