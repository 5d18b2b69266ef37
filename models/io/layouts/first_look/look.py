"""What is in files of an unknown layout, and a map to begin with, as one text that is a map itself."""

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import InputError, check_path, counted, printable
from ...untrusted import in_bytes
from ..assemble import read_mapped
from ..files import SourceFile, is_folder, kinds_of, names_below, source_files
from ..formats.contents import Contents, Variable
from ..formats.objects import REST
from ..formats.registry import ending, open_contents
from ..mapping import TapMap
from .guess import Guess, as_floats, column_guesses, shape_of, size_of
from .guess_arrays import array_guesses, names_beside
from .guess_names import name_pattern

_MOST_NAMES, _MOST_VARIABLES, _MOST_ATTRIBUTES = 6, 40, 12
_COMPARED = 6
"""Files whose arrays are compared."""
_GERMAN = re.compile(r"-?(\d+|\d{1,3}(\.\d{3})+),\d+")
"""A number with a decimal comma."""
_SMALL = 1 << 27
"""Bytes of arrays that are read to show their range."""
_BLOCKS = 4
"""Blocks of a table or of messages that are read for it."""
_TRIED = 1 << 28
"""Bytes of files whose map is tried."""


def look(sources: Sequence[str | Path], how: TapMap) -> str:
    """What files hold, in comments, and a map to begin with.

    Args:
        sources: Files and folders.
        how: What is known of the map.

    Raises:
        InputError: A file is missing or cannot be opened.
    """
    paths = [check_path(source) for source in sources]
    lines: list[str] = []
    for path in paths:
        lines += _files(path)
    kinds = {} if how.files is not None else _kinds(paths)
    kind = max(kinds, key=lambda each: kinds[each], default=None)
    files = source_files(paths, how if kind is None else how.changed(files=f"**/*{kind}"))
    guesses: list[Guess] = []
    if how.files is None and (len(files) > 1 or len(kinds) > 1):
        pattern, guesses = name_pattern([file.below for file in files])
        guesses.insert(0, Guess("files", pattern or f"**/*{kind}", counted(len(files), "file")))
    written, contents = _opened(files[0].path, how)
    values = _read(contents)
    if not written.header and how.header:
        guesses.append(Guess("header", False, "numbers in the first row"))
    if (comma := _with_comma(values, how)) is not None:
        guesses.append(comma)
        written = written.changed(decimal=",")
        contents = open_contents(files[0].path, written.text_table, how.format, _BLOCKS)
        values = _read(contents)
    lines += ["", f"{files[0].below}:", *_held(contents, values)]
    others = [open_contents(file.path, written.text_table, how.format, _BLOCKS) for file in _compared(files, contents)]
    lines += _differences(others[:1], contents, files[1:2])
    guesses += _inside(contents, values, others, guesses)
    guesses += names_beside(files[0].path, guesses, contents, values)
    guesses = [guess for guess in guesses if guess.of_names or getattr(how, guess.key) == getattr(TapMap(), guess.key)]
    size = sum(file.path.stat().st_size for file in files)
    if size > _TRIED or REST in contents.unreadable:
        result = f"This map was not tried on {in_bytes(size)}."
    else:
        whole = how.changed(**{guess.key: guess.value for guess in guesses if not guess.of_names})
        result = f"With this map: {_tried(sources, whole)}"
    comments = (f"# {line}".rstrip() for line in map(printable, lines))
    return "\n".join([*comments, "", *_map(how, guesses), f"# {result}", ""])


def _opened(path: Path, how: TapMap) -> tuple[TapMap, Contents]:
    """A file, and the map that opens it: a table whose columns hold numbers may have no header.

    Raises:
        InputError: It cannot be opened.
    """
    free = how.changed(header=False)
    try:
        return how, open_contents(path, how.text_table, how.format, _BLOCKS)
    except InputError:
        try:
            contents = open_contents(path, free.text_table, how.format, _BLOCKS)
        except InputError:
            contents = None
        if contents is None or not contents.table or any(as_floats(of) is None for of in _read(contents).values()):
            raise
        return free, contents


def _with_comma(values: Mapping[str, NDArray[Any]], how: TapMap) -> Guess | None:
    """Whether columns hold numbers with a decimal comma."""
    if how.decimal != ".":
        return None
    texts = [of for of in values.values() if of.dtype.kind == "U" and of.ndim == 1 and of.size]
    found = [of for of in texts if all(map(_GERMAN.fullmatch, of[:_MOST_VARIABLES].tolist()))]
    return Guess("decimal", ",", f"numbers such as {found[0][0]}") if found else None


def _compared(files: Sequence[SourceFile], first: Contents) -> Sequence[SourceFile]:
    """The files that are opened beside the first one."""
    return files[1:2] if first.table else files[1:_COMPARED]


def _inside(
    contents: Contents, values: Mapping[str, NDArray[Any]], others: Sequence[Contents], known: Sequence[Guess]
) -> Iterator[Guess]:
    """What the contents of the first of one or several files may mean, beside what the names of files do."""
    named = {guess.key for guess in known}
    tells = bool(named & {"trial", "what", "x"})
    found = column_guesses(contents, values) if contents.table else array_guesses(contents, values, others, tells)
    if contents.table and "trial" in named:
        found = [guess for guess in found if guess.key != "tap"]
    inside = [guess for guess in found if guess.key not in named]
    yield from inside
    keys = named | {guess.key for guess in inside}
    cut = {"tap", "taps"} if contents.table else {"tap"} if "time" in keys else keys
    if not keys & cut and others and tells:
        yield Guess("tap", "file", "each file is one tap, if it is")


def _files(path: Path) -> Iterator[str]:
    """How many files of which endings, and some names."""
    if not is_folder(path):
        yield f"{path}: a file of {in_bytes(path.stat().st_size)}."
        return
    names = names_below(path)
    kinds = Counter(ending(name) or "no ending" for name in names)
    shown = ", ".join(f"{n} {kind}" for kind, n in kinds.most_common(_MOST_NAMES))
    yield f"{path}: {counted(len(names), 'file')} ({shown})."
    yield from (f"  {name}" for name in names[:_MOST_NAMES])
    if len(names) > _MOST_NAMES:
        yield f"  ... and {len(names) - _MOST_NAMES} more"


def _kinds(paths: Sequence[Path]) -> dict[str, int]:
    """Bytes of the files of each known kind below folders; empty without folders.

    Raises:
        InputError: There is no such file in one of them.
    """
    found = Counter[str]()
    for path in filter(is_folder, paths):
        names = names_below(path)
        kinds = kinds_of(path, names)
        for name in names:
            if (kind := ending(name)) in kinds:
                found[kind] += _bytes(path / name)
    return dict(found)


def _bytes(path: Path) -> int:
    """Size of a file, or of a store of Zarr."""
    return sum(each.stat().st_size for each in path.rglob("*")) if path.is_dir() else path.stat().st_size


def _read(contents: Contents) -> dict[str, NDArray[Any]]:
    """Columns, and the first arrays that are small together."""
    variables = contents.variables.values()
    sizes = np.cumsum([0 if contents.table else size_of(each) * each.dtype.itemsize for each in variables])
    names = [name for name, size in zip(contents.variables, sizes.tolist(), strict=True) if size <= _SMALL]
    values = contents.read(names)[0]
    return {name: of for name, of in values.items() if isinstance(of, np.ndarray)}


def _held(contents: Contents, values: Mapping[str, NDArray[Any]]) -> Iterator[str]:
    """One line for each variable."""
    names = list(contents.variables)[:_MOST_VARIABLES]
    width = max((len(name) for name in names), default=0)
    for name in names:
        variable = contents.variables[name]
        parts = [] if contents.table else [shape_of(variable) or "one"]
        parts += [*([variable.unit] if variable.unit else []), *_summary(values.get(name), variable)]
        yield f"  {name:<{min(width, 40)}}  {', '.join(filter(None, parts))}"
    if len(contents.variables) > len(names):
        yield f"  ... and {len(contents.variables) - len(names)} more"
    for name, reason in contents.unreadable.items():
        yield f"  {name} is not read: {reason}"
    attributes = list(contents.attributes.items())
    yield from (f"  attribute {name}: {str(text)[:60]}" for name, text in attributes[:_MOST_ATTRIBUTES])
    if len(attributes) > _MOST_ATTRIBUTES:
        yield f"  ... and {len(attributes) - _MOST_ATTRIBUTES} more attributes"
    if contents.table and values:
        rows = len(next(iter(values.values())))
        whole = contents.path.stat().st_size < _BLOCKS << 20
        yield f"  {rows} rows" if whole else f"  the first {rows} rows, if there are more"


def _summary(values: NDArray[Any] | None, variable: Variable) -> Iterator[str]:
    if values is None or not values.size:
        yield str(variable.dtype)
        return
    if values.dtype.kind == "U" and values.ndim == 1:
        try:
            values = np.where(values == "", "nan", values).astype(np.float64)
        except ValueError:
            distinct = list(dict.fromkeys(values.tolist()))
            yield f"texts, {len(distinct)} different: {', '.join(distinct[:4])}{', ...' if len(distinct) > 4 else ''}"
            return
    if values.dtype.kind not in "fiub":
        yield str(values.dtype)
        return
    missing = int(np.isnan(values).sum()) if values.dtype.kind == "f" else 0
    if missing < values.size:
        yield f"{np.nanmin(values):g} to {np.nanmax(values):g}"
    if missing:
        yield f"{missing} missing"


def _differences(others: Sequence[Contents], first: Contents, files: Sequence[SourceFile]) -> Iterator[str]:
    """Whether another file has other variables."""
    for file, other in zip(files, others, strict=True):
        apart = sorted(set(first.variables) ^ set(other.variables))
        if apart:
            yield f"{file.below} differs in {', '.join(apart[:_MOST_NAMES])}."


def _map(how: TapMap, guesses: Sequence[Guess]) -> Iterator[str]:
    """Keys of the map: those that were given, and those that are guessed with the reasons."""
    for name in how.__struct_fields__:
        if (value := getattr(how, name)) != getattr(TapMap(), name):
            yield f"{name} = {_toml(value)}"
    for guess in guesses:
        if guess.of_names:
            yield f"# {guess.key}: {guess.value} in names, {guess.reason}"
        else:
            yield f"{guess.key} = {_toml(guess.value)}  # {guess.reason}"


def _tried(sources: Sequence[str | Path], how: TapMap) -> str:
    """What a map gives, in a sentence."""
    try:
        recording = read_mapped(sources, how).recording
    except InputError as error:
        return printable(str(error))
    labels, shape = recording.labels, recording.samples.shape
    names = ("frame", "taxel") if recording.is_stream else ("tap", "sample", "taxel")
    rows, *size = map(counted, shape, names)
    kind = f"{rows} of streams: cut them with trigger" if recording.is_stream else rows
    counts = {"object": len(labels.what_name), "position": len(np.unique(labels.where))}
    counts["session"] = len(np.unique(labels.session))
    whole = f"{kind}, {' x '.join(size)}, {', '.join(counted(n, name) for name, n in counts.items())}."
    return whole if recording.is_stream else f"{whole}{_doubts(shape, counts['object'])}"


def _doubts(shape: Sequence[int], objects: int) -> str:
    """What makes a map doubtful that gives taps."""
    doubts = [f"each tap has 1 {name}" for name, n in zip(("sample", "taxel"), shape[1:], strict=True) if n == 1]
    if objects == shape[0] > 1:
        doubts.append("there are as many objects as taps")
    return f" Doubtful: {' and '.join(doubts)}." if doubts else ""


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return str(value)
