"""What is in files of an unknown layout, and a map to begin with, as one text that is a map itself."""

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....errors import InputError, check_path, counted, printable
from ...untrusted import in_bytes
from ..assemble import read_mapped
from ..files import SourceFile, is_folder, names_below, source_files
from ..formats.contents import Contents, Variable, name_and_unit
from ..formats.objects import REST
from ..formats.registry import ending, open_contents
from ..mapping import TapMap
from ..patterns import FIELDS, compiled_pattern, fields_of, is_pattern
from ..tap_set import load_mapped
from .beside import bytes_of, file_groups, files_guesses, names_beside, tables_beside
from .guess import Guess, as_list, like, plain, rate_guess, shape_of, size_of
from .guess_arrays import array_guesses
from .guess_columns import column_guesses
from .opening import BLOCKS, opened, with_comma

_MOST_NAMES, _MOST_VARIABLES, _MOST_ATTRIBUTES = 6, 40, 12
_COMPARED = 6
"""Files whose arrays are compared."""
_SMALL = 1 << 27
"""Bytes of arrays that are read to show their range."""
_MOST_LEFT = 8
_RAGGED, _LONG = re.compile(r"taps have (\d+) to (\d+) samples; say their length"), 300
"""Taps of different lengths, and the rows above which a file is more likely a stream than a tap."""
_IN_ORDER, _BY_NUMBER = "is read in the order of the taps", "is read by numbers in the names of files"
_CLOSE = 0.1
"""Distances of positions below this share of the largest are noise."""
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
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: no such file.")
    lines = [line for path in paths for line in _files(path)]
    groups, guesses = [], []
    if how.files is None and any(map(is_folder, paths)):
        how, groups = file_groups(paths, how, guesses)
    files = groups[0] if groups else source_files(paths, how)
    files, written, contents, values, broken = _first(files, how, guesses)
    others = _compared(files[1:], contents, written, how.format)
    lines += [*broken, "", f"{files[0].below}:", *_held(contents, values)]
    lines += _differences(others[:1], contents, {file.path: file.below for file in files})
    guesses += _guessed(files, groups, contents, values, others)
    guesses = [guess for guess in guesses if guess.of_names or getattr(how, guess.key) == getattr(TapMap(), guess.key)]
    tables, told, spare = tables_beside(files, groups[1:], guesses, values, written)
    size = sum(map(bytes_of, (file.path for file in files)))
    if size > _TRIED or REST in contents.unreadable:
        result = f"This map was not tried on {in_bytes(size)}."
        told += map(_line, tables)
    else:
        guesses, result, also = _tried_with(sources, how, guesses, tables, spare)
        told += also
    if _is_long(contents, values) and others and not {"tap", "trigger"} & {guess.key for guess in guesses}:
        told.append('Perhaps: tap = "file" (if each file is one tap)')
    told += _not_used(_whole(how, guesses), contents)
    comments = (f"# {line}".rstrip() for line in map(printable, lines))
    notes = (f"# {line}".rstrip() for line in map(printable, [*told, result]))
    return "\n".join([*comments, "", *_map(how, guesses), *notes, ""])


class _First(NamedTuple):
    """The first file that can be read, before the others; the map that opens it; what it holds; and broken files."""

    files: list[SourceFile]
    written: TapMap
    contents: Contents
    values: dict[str, NDArray[Any]]
    broken: list[str]


def _first(files: Sequence[SourceFile], how: TapMap, guesses: list[Guess]) -> _First:
    """Opens the first files until one can be read, with guesses of how its table is written.

    Raises:
        InputError: None can; the message is that of the first one.
    """
    errors: list[InputError] = []
    for number, file in enumerate(files[:_COMPARED]):
        try:
            found: list[Guess] = []
            written, contents = opened(file.path, how, found)
            values = _read(contents)
            if (comma := with_comma(values, written)) is not None:
                found.append(comma)
                written = written.changed(decimal=",")
                contents = open_contents(file.path, written.text_table, written.format, BLOCKS)
                values = _read(contents)
        except InputError as error:
            errors.append(error)
            continue
        guesses += found
        rest = [*files[:number], *files[number + 1 :]]
        return _First([file, *rest], written, contents, values, list(map(str, errors)))
    raise errors[0]


def _guessed(
    files: Sequence[SourceFile],
    groups: Sequence[Sequence[SourceFile]],
    contents: Contents,
    values: Mapping[str, NDArray[Any]],
    others: Sequence[Contents],
) -> list[Guess]:
    """What names of files and the contents of the first mean; numbers in names are trials only if files are taps."""
    of_names: list[Guess] = []
    inside = list(_inside(contents, values, [], []))
    own = {guess.key for guess in inside if guess.key in ("what", "where") and _by_name(guess, values)}
    for of_taps in (True, False):
        of_names = files_guesses(files, groups, of_taps, own) if groups else []
        inside = list(_inside(contents, values, others, of_names))
        if any(guess.key == "tap" and guess.value == "file" for guess in inside):
            break
    found = [*of_names, *inside]
    return [*found, *names_beside(files[0].path, found, contents, values)]


def _by_name(guess: Guess, values: Mapping[str, NDArray[Any]]) -> bool:
    """Whether a column is called like a label, and changes."""
    name = guess.value if isinstance(guess.value, str) else ""
    return (
        name in values and values[name].ndim == 1 and like(guess.key, plain(name)) and len(np.unique(values[name])) > 1
    )


def _is_long(contents: Contents, values: Mapping[str, NDArray[Any]]) -> bool:
    """Whether a table has more rows than most taps."""
    return contents.table and len(next(iter(values.values()), ())) > _LONG


def _whole(how: TapMap, guesses: Sequence[Guess]) -> TapMap:
    return how.changed(**{guess.key: guess.value for guess in guesses if not guess.of_names})


def _tried_with(
    sources: Sequence[str | Path], how: TapMap, guesses: list[Guess], tables: list[Guess], spare: bool
) -> tuple[list[Guess], str, list[str]]:
    """Guesses, with those of tables beside the files if they fit; what that gives, and what else may be told.

    Taps that differ in length are cut to the shortest. A table in the order of the taps is doubtful if it has further
    columns (`spare`).
    """
    keys = {guess.key for guess in tables}
    joined = [*(guess for guess in guesses if guess.key not in keys), *tables]
    result, fits = _tried(sources, _whole(how, joined))
    if (ragged := _RAGGED.search(result)) is not None and int(ragged[2]) <= _LONG:
        shortest = Guess("length", "shortest", f"taps have {ragged[1]} to {ragged[2]} samples")
        return _tried_with(sources, how, [*guesses, shortest], tables, spare)
    doubtful = (spare and _IN_ORDER in result) or (
        "trigger" in {guess.key for guess in joined} and _BY_NUMBER in result
    )
    if not tables or (fits and not doubtful):
        return joined, result, []
    alone, without = _tried(sources, _whole(how, guesses))
    if not without:
        return joined, result, []
    return guesses, alone, [*map(_line, tables), result.replace("With this map", "With these lines")]


def _line(guess: Guess) -> str:
    return f"Perhaps: {guess.key} = {_toml(guess.value)} ({guess.reason})"


def _not_used(how: TapMap, contents: Contents) -> Iterator[str]:
    """Columns and arrays that no key of a map names."""
    texts = [text for key in how.__struct_fields__ for text in as_list(getattr(how, key)) if isinstance(text, str)]
    texts += [part for text in texts for part in re.split(r"[:=<>!]+", text)]
    columns, used = list(contents.columns), set(texts)
    fields = (*FIELDS, "sample")
    patterns = [
        compiled_pattern(text, "", fields) for text in texts if is_pattern(text) and _fields_known(text, fields)
    ]
    for text in as_list(how.taxels):
        begin, colon, end = str(text).partition(":")
        if colon and begin.isdecimal() and end.isdecimal():
            used |= set(columns[int(begin) : int(end)])
    left = [
        name
        for name in contents.variables
        if not {name, name_and_unit(name)[0]} & used and not any(each.fullmatch(name) for each in patterns)
    ]
    if left:
        shown_names = ", ".join(left[:_MOST_LEFT]) + (f", ... ({len(left)})" if len(left) > _MOST_LEFT else "")
        yield f"Not used: {shown_names}."


def _fields_known(text: str, fields: Sequence[str]) -> bool:
    return set(fields_of(text)) <= set(fields) and text.count("{") == len(re.findall(r"\{\w+\}", text))


def _compared(files: Sequence[SourceFile], first: Contents, how: TapMap, kind: str | None) -> list[Contents]:
    """What further files hold that can be read, to be compared with the first one."""
    found = []
    for file in files[: 1 if first.table else _COMPARED - 1]:
        with suppress(InputError):
            found.append(open_contents(file.path, how.text_table, kind, BLOCKS))
    return found


def _inside(
    contents: Contents, values: Mapping[str, NDArray[Any]], others: Sequence[Contents], known: Sequence[Guess]
) -> Iterator[Guess]:
    """What the contents of the first of one or several files may mean, beside what the names of files do."""
    named = {guess.key for guess in known}
    tells = bool(named & {"trial", "what", "x"})
    found = (
        column_guesses(contents, values, named) if contents.table else array_guesses(contents, values, others, tells)
    )
    if contents.table and "trial" in named:
        found = [guess for guess in found if guess.key != "tap" or guess.value == "row"]
    inside = [guess for guess in found if guess.key not in named]
    keys = named | {guess.key for guess in inside}
    yield from inside
    if any(guess.key == "time" and guess.value in ("ms", "us", "ns") for guess in inside):
        yield Guess("time_unit", next(guess.value for guess in inside if guess.key == "time"), "its name")
    if "time" not in keys and (rate := rate_guess(contents, values)) is not None:
        yield rate
    grid = any(guess.key == "taxels" and "{" in str(guess.value) for guess in inside)
    cut = {"tap", "taps", "axes"} if contents.table else {"tap"} if "time" in keys else keys
    labels = [values[guess.value] for guess in inside if guess.key in ("what", "where") and str(guess.value) in values]
    if (
        not keys & cut
        and not grid
        and not _is_long(contents, values)
        and others
        and tells
        and all(len(np.unique(of)) == 1 for of in labels)
    ):
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


def _read(contents: Contents) -> dict[str, NDArray[Any]]:
    """Columns, and the first arrays that are small together."""
    variables = contents.variables.values()
    sizes = np.cumsum([0 if contents.table else size_of(each) * each.dtype.itemsize for each in variables])
    names = [name for name, size in zip(contents.variables, sizes.tolist(), strict=True) if size <= _SMALL]
    names = [name for name in names if list(contents.columns).count(name) == 1] or names
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
        whole = contents.path.stat().st_size < BLOCKS << 20
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


def _differences(others: Sequence[Contents], first: Contents, names: Mapping[Path, str]) -> Iterator[str]:
    """Whether another file has other variables."""
    for other in others:
        apart = sorted(set(first.variables) ^ set(other.variables))
        if apart:
            yield f"{names[other.path]} differs in {', '.join(apart[:_MOST_NAMES])}."


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


def _tried(sources: Sequence[str | Path], how: TapMap) -> tuple[str, bool]:
    """What a map gives, in a sentence, and whether it gives anything."""
    try:
        if how.trigger is None:
            recording, told = (mapped := read_mapped(sources, how)).recording, mapped.left_out
            labels, shape, stream = recording.labels, recording.samples.shape, recording.is_stream
        else:
            labels, told = load_mapped(sources, how)
            shape, stream = labels.samples.shape, False
    except InputError as error:
        return f"With this map: {printable(str(error))}", False
    names = ("frame", "taxel") if stream else ("tap", "sample", "taxel")
    rows, *size = map(counted, shape, names)
    kind = f"{rows} of streams: cut them with trigger" if stream else rows
    counts = {"object": len(labels.what_name), "position": len(np.unique(labels.where))}
    counts["session"] = len(np.unique(labels.session))
    whole = f"{kind}, {' x '.join(size)}, {', '.join(counted(n, name) for name, n in counts.items())}."
    doubts = "" if stream else _doubts(shape, labels.what_name, labels.where)
    told = [text for text in told if "do not match files" not in text]
    return " ".join(["With this map:", f"{whole}{doubts}", *told]), True


def _doubts(shape: Sequence[int], names: Sequence[str], where: NDArray[Any]) -> str:
    """What makes a map doubtful that gives taps."""
    doubts = [f"each tap has 1 {name}" for name, n in zip(("sample", "taxel"), shape[1:], strict=True) if n == 1]
    if len(names) == 1:
        doubts.append("nothing tells objects apart")
    if len(names) == shape[0] > 1:
        doubts.append("there are as many objects as taps")
    twice = Counter(name.casefold() for name in names).most_common(1)[0]
    if twice[1] > 1:
        doubts.append(f"objects are called {twice[0]} with large and small letters")
    steps = np.diff(np.unique(where))
    if len(steps) > 1 and steps.min() < _CLOSE * steps.max():
        doubts.append(f"some positions are {steps.min():.2g} apart, others {steps.max():.2g}: where_round rounds them")
    return f" Doubtful: {' and '.join(doubts)}." if doubts else ""


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return str(value)
