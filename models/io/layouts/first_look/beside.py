"""Guesses which files of a folder are the recording, and what others beside them say of it."""

import re
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import InputError, counted
from ..files import SourceFile, is_folder, kinds_of, names_below
from ..formats.contents import Contents, TextTable
from ..formats.registry import ENDINGS, WAYS_OUT, ending, open_contents
from ..formats.text_lines import Lines
from ..mapping import TapMap
from ..patterns import compiled_pattern, fields_of, filled
from .guess import NAMES, Guess, as_floats, indices, like, plain
from .guess_names import name_pattern

_UTF16 = b"\xff\xfe", b"\xfe\xff"
_BEGIN = 1 << 16
"""Bytes of a file that tell its layout."""
_NUMBER = re.compile(r"[-+]?\d+([.,]\d+)?([eE][-+]?\d+)?|nan|NaN")
_LETTERS = re.compile(r"[^\W\d_]*")
_LIST_BYTES = 1 << 16
_MOST_TABLES, _MOST_COLUMNS = 6, 6
_ONSET = r"onset|^(t )?press", r"^(start|begin|event)", r"^(time|stamp|timestamp|zeit)\b", r"^frame"
"""What the times of presses are called."""


def file_groups(paths: Sequence[Path], how: TapMap, guesses: list[Guess]) -> tuple[TapMap, list[list[SourceFile]]]:
    """Files of folders by their layout, the largest group first, and the map with their format.

    Files of one layout have the same format, and tables the same first line but for numbers. Files named one by one
    belong to the first group.

    Args:
        paths: Files and folders.
        how: What is known of the map.
        guesses: Gets the format, where no file has a known ending.

    Raises:
        InputError: There is no file of a known kind.
    """
    named = [SourceFile(path, path.name, n) for n, path in enumerate(paths) if not is_folder(path)]
    every = [
        SourceFile(path / name, name, n)
        for n, path in enumerate(paths)
        if is_folder(path)
        for name in names_below(path)
    ]
    known = [file for file in every if ending(file.below) in ENDINGS]
    if every and not known and not named and how.format is None and not any(map(is_never_read, every)):
        how = how.changed(format="text")
        guesses.append(Guess("format", "text", "files of text, by their contents"))
    if how.format is not None:
        known = every
    if not known and not named:
        folder = next(filter(is_folder, paths))
        kinds_of(folder, names_below(folder))  # it says what is wrong
        raise InputError(f"{folder}: no file in this folder.")
    layouts: dict[tuple[str, str], tuple[str, ...]] = {}
    found: dict[tuple[str, ...], list[SourceFile]] = {}
    for file in known:
        stem = ending(file.below), re.sub(r"\d+", "#", file.below)
        if stem not in layouts:
            layouts[stem] = _layout(file.path, how)
        found.setdefault(layouts[stem], []).append(file)
    groups = sorted(found.values(), key=lambda group: -sum(bytes_of(file.path) for file in group))
    return how, [[*named, *(groups[0] if groups else [])], *groups[1:]]


def is_never_read(file: SourceFile) -> bool:
    """Whether a file is of a kind that is never read, or holds no text."""
    try:
        Lines(file.path, 0, "")
    except InputError:
        return True
    return ending(file.below) in WAYS_OUT or not ending(file.below)


def _layout(path: Path, how: TapMap) -> tuple[str, ...]:
    """What files of one layout have in common."""
    kind = how.format or ENDINGS[ending(path.name)]
    if kind not in ("text", "npy", "parquet", "arrow"):
        return (kind,)
    try:
        if kind == "npy":
            return kind, *(str(len(of.shape)) for of in open_contents(path, how.text_table, kind).variables.values())
        if kind != "text":
            return kind, *open_contents(path, how.text_table, kind).variables
        with path.open("rb") as file:
            begin = file.read(_BEGIN)
    except (InputError, OSError):
        return kind, "not read"
    lines = begin.decode("utf-16" if begin[:2] in _UTF16 else "utf-8", errors="replace").splitlines()[how.skip_rows :]
    line = next((each for each in lines if each.strip() and not (how.comment and each.startswith(how.comment))), "")
    cells = [cell for cell in re.split(r"[,;\t| ]", line) if cell.strip()]
    numbers = sum(_NUMBER.fullmatch(cell.strip()) is not None for cell in cells)
    return kind, f"{len(cells)} numbers" if 2 * numbers >= len(cells) else _NUMBER.sub("#", line)


def is_row(contents: Contents) -> bool:
    """Whether names of columns are cells of a row: half of them numbers that do not count, and all above numbers."""
    names = contents.columns
    of_numbers = [name for name, of in contents.variables.items() if of.dtype.kind == "f"]
    if not all(map(_NUMBER.match, of_numbers)):
        return False
    numbers = [name for name in names if _NUMBER.fullmatch(name)]
    counted_up = all(name.isdecimal() for name in numbers) and len({int(n) - i for i, n in enumerate(numbers)}) == 1
    return 2 * len(numbers) >= len(names) > 0 and not (counted_up and len(numbers) > 1)


def bytes_of(path: Path) -> int:
    """Size of a file, or of a store of Zarr; 0 of a link to nothing."""
    try:
        return sum(each.stat().st_size for each in path.rglob("*")) if path.is_dir() else path.stat().st_size
    except OSError:
        return 0


def files_guesses(
    files: Sequence[SourceFile],
    groups: Sequence[Sequence[SourceFile]],
    of_taps: bool,
    taken: Set[str] = frozenset(),
) -> list[Guess]:
    """The pattern of the files of a recording beside other ones, and its fields.

    Args:
        files: Those of the recording.
        groups: These, and others beside them.
        of_taps: As for `name_pattern`.
        taken: Likewise.
    """
    names = [f"{file.below.removesuffix(file.path.suffix)}{ending(file.below)}" for file in files]
    others = [file.below for group in groups[1:] for file in group]
    if len(names) == 1 and not others:
        return []
    pattern, fields = name_pattern(names, of_taps, taken)
    if not pattern:
        pattern = f"**/*{ending(names[0])}"
        if len(names) == 1 and _taken(pattern, others):
            pattern = re.sub(r"[{}*?]", "?", names[0])
    too = _taken(pattern, others)
    if too and (narrow := _with_letters(pattern, names)) != pattern:
        pattern, too = narrow, _taken(narrow, others)
    reason = counted(len(names), "file") + (f"; it takes {too[0]} as well, which has another layout" if too else "")
    return [Guess("files", pattern, reason), *fields]


def _taken(pattern: str, names: Sequence[str]) -> list[str]:
    """The names that a pattern matches."""
    return list(filter(compiled_pattern(pattern, "files").fullmatch, names))


def _with_letters(pattern: str, names: Sequence[str]) -> str:
    """The pattern with the letters before the numbers of its fields, where these are the same in all names."""
    compiled = compiled_pattern(pattern, "files")
    texts = [found.groupdict() for name in names if (found := compiled.fullmatch(name))]
    for key in fields_of(pattern):
        letters = {_LETTERS.match(found[key])[0] for found in texts}  # pyright: ignore - it always matches
        if len(letters) == 1:
            pattern = pattern.replace(f"{{{key}}}", f"{letters.pop()}{{{key}}}", 1)
    return pattern


def names_beside(
    path: Path, found: Sequence[Guess], contents: Contents, values: Mapping[str, NDArray[Any]]
) -> Iterator[Guess]:
    """A list of the names of objects in a file of text beside the recording, where objects are numbers."""
    called = {guess.key: guess.value for guess in found}
    if "what_names" in called:
        return
    axes, lowest, count = str(called.get("axes", "")).split(","), 0, 0
    if (index := indices(called, values).get("what")) is not None:
        lowest, count = int(index.min()), int(index.max()) + 1
    elif "what" in axes and called.get("taps") in contents.variables:
        count = contents.variables[called["taps"]].shape[axes.index("what")] or 0
    for file in sorted(path.parent.glob("*.txt")):
        if count < 2 or not re.search(NAMES, file.stem, re.IGNORECASE) or file.stat().st_size > _LIST_BYTES:
            continue
        lines = [line for line in file.read_text("utf-8", errors="replace").splitlines() if line.strip()]
        if len(lines) == count - (lowest == 1):
            yield Guess("what_names", file.name, f"{len(lines)} lines, one for each object")
            if lowest == 1:
                yield Guess("one_based", True, f"{called['what']} runs from 1 to {len(lines)}")
            return


def tables_beside(
    files: Sequence[SourceFile],
    groups: Sequence[Sequence[SourceFile]],
    known: Sequence[Guess],
    values: Mapping[str, NDArray[Any]],
    how: TapMap,
) -> tuple[list[Guess], list[str], bool]:
    """Labels and presses in tables beside a recording, and what files of other layouts there are, in sentences.

    The last is whether a table has columns that are neither, which may say how its rows belong to taps.

    Args:
        files: Those of the recording.
        groups: Files of other layouts.
        known: What its files and their names tell.
        values: Columns and arrays of the first file.
        how: How its tables are written.
    """
    called = {guess.key: guess.value for guess in known}
    found: dict[str, Guess] = {}
    told, spare = [], False
    for group in groups[:_MOST_TABLES]:
        whose = group[0].below + (f" and {len(group) - 1} more" if len(group) > 1 else "")
        columns = _columns(group[0], how)
        shown_names = ", ".join(list(columns)[:_MOST_COLUMNS])
        told.append(f"{whose}: another layout{f' ({shown_names})' if shown_names else ''}, not part of the recording.")
        name = _template([file.below for file in group], files, str(called.get("files", "")))
        if not name and (one := list(_labels_beside(group[0].below, columns, set(called), values))):
            told.append(f'Perhaps: {one[0].key} = "{one[0].value}" (one of {len(group)} tables)')
        if not name or not columns:
            continue
        if not called.keys() & {"tap", "taps", "axes"} or called.get("trigger") == "signal":
            for guess in _presses(name, columns, called, values):
                found.setdefault(guess.key, guess)
        for guess in _names_of_indices(name, columns, called, values):
            found.setdefault(guess.key, guess)
        for guess in _labels_beside(name, columns, {*called, *found}, values):
            found.setdefault(guess.key, guess)
        weaker = {guess.key for guess in known if guess.of_names}
        rather = _labels_beside(name, columns, {*called, *found} - weaker, values)
        told += [f'Perhaps: {guess.key} = "{guess.value}" (a table beside, rather than names)' for guess in rather]
        used = {str(guess.value).removeprefix(f"{name}:") for guess in found.values()}
        used |= {each for each, of in columns.items() if _counts_up(of)}
        spare |= len(columns) > 1 and not set(columns) <= used
    if len(groups) > _MOST_TABLES:
        told.append(f"... and files of {len(groups) - _MOST_TABLES} further layouts.")
    return list(found.values()), told, spare


def _columns(file: SourceFile, how: TapMap) -> dict[str, NDArray[Any]]:
    """Columns of a table, or the one axis of an array; none where it is no table."""
    if ENDINGS.get(ending(file.below)) not in ("text", "npy"):
        return {}
    for written in (TextTable(decimal=how.decimal), TextTable(), how.text_table):
        with suppress(InputError):
            contents = open_contents(file.path, written, None, 1)
            if contents.table and written.header and is_row(contents):
                continue
            return {name: of for name, of in contents.read(list(contents.variables))[0].items() if np.ndim(of) == 1}  # pyright: ignore
    return {}


def _template(tables: Sequence[str], files: Sequence[SourceFile], pattern: str) -> str:
    """What a map calls a table, or tables that differ in a field of the names of files; empty if nothing does."""
    if len(tables) == 1:
        return tables[0]
    folders = {file.below.rpartition("/")[0] for file in files}
    names = {table.rpartition("/")[2] for table in tables}
    if len(names) == 1 and folders == {table.rpartition("/")[0] for table in tables}:
        return names.pop()
    matches = [
        found.groupdict() for file in files if (found := compiled_pattern(pattern, "files").fullmatch(file.below))
    ]
    for key in matches[0] if matches else ():
        texts = sorted({match[key] for match in matches}, key=len, reverse=True)
        made = {table.replace(text, f"{{{key}}}") for text in texts for table in tables}
        for name in made:
            if {filled(name, {key: text}) for text in texts} == set(tables):
                return name
    return ""


def _presses(
    name: str, columns: Mapping[str, NDArray[Any]], called: Mapping[str, Any], values: Mapping[str, NDArray[Any]]
) -> Iterator[Guess]:
    """Presses of a stream in a table of them, and the samples of each if their duration is stated."""
    onset = next((each for of in _ONSET for each in columns if re.search(of, plain(each), re.IGNORECASE)), None)
    if onset is None or called.get("trigger"):
        return
    yield Guess("trigger", "events", f"{len(columns[onset])} times of presses in a table")
    yield Guess("events", f"{name}:{onset}", "its name")
    long = next((each for each in columns if re.search(r"^(duration|dauer)", plain(each), re.IGNORECASE)), None)
    times = as_floats(values[called["time"]]) if called.get("time") in values else None
    lasting = None if long is None else as_floats(columns[long])
    if times is not None and lasting is not None and (step := float(np.nanmedian(np.diff(times)))) > 0:
        yield Guess(
            "window", int(np.round(np.nanmin(lasting) / step)), f"{name}:{long}, at the rate of {called['time']}"
        )


def _names_of_indices(
    name: str, columns: Mapping[str, NDArray[Any]], called: Mapping[str, Any], values: Mapping[str, NDArray[Any]]
) -> Iterator[Guess]:
    """Names of objects in a table that numbers them in order, where the recording has these numbers."""
    found = values.get(called["what"]) if isinstance(called.get("what"), str) else None
    index = None if found is None or found.ndim != 1 else as_floats(found)
    if index is None or "what_names" in called:
        return
    numbers = [of for each in columns.values() if (of := as_floats(each)) is not None]
    texts = [each for each, of in columns.items() if as_floats(of) is None and len(set(of.tolist())) == len(of)]
    for first in (0, 1):
        counted_up = any(_counts_up(of, (first,)) for of in numbers)
        if texts and counted_up and set(np.unique(index)) <= set(range(first, first + len(columns[texts[0]]))):
            yield Guess("what_names", f"{name}:{texts[0]}", f"names of the numbers of {called['what']}")
            if first:
                yield Guess("one_based", True, "the table numbers them from 1")
            return


def _counts_up(values: NDArray[Any], begins: Sequence[int] = (0, 1)) -> bool:
    """Whether numbers are those of the rows, from 0 or 1."""
    floats = as_floats(values)
    return floats is not None and any((floats == np.arange(first, first + len(floats))).all() for first in begins)


def _labels_beside(
    name: str, columns: Mapping[str, NDArray[Any]], taken: Set[str], values: Mapping[str, NDArray[Any]]
) -> Iterator[Guess]:
    """Labels in a table that are nowhere else."""
    own = {each: of for each, of in columns.items() if each not in values or len(columns) == 1}
    own = {each: of for each, of in own.items() if len(set(of.tolist())) > 1}
    for key in ("what", "where", "session"):
        fitting = [each for each in own if like(key, plain(each))]
        if key == "where":
            fitting = [each for each in fitting if as_floats(own[each]) is not None]
        if key == "what" and not fitting:
            repeat = {each: len(set(of.tolist())) for each, of in own.items() if of.dtype.kind == "U" or len(own) == 1}
            fitting = [each for each, n in repeat.items() if n <= len(own[each]) // 2]
        if fitting and key not in taken and not (key == "where" and "x" in taken):
            column = "" if name.endswith(".npy") else f":{fitting[0]}"
            yield Guess(
                key, f"{name}{column}", f"a table beside, {len(set(own[fitting[0]].tolist()))} different values"
            )
