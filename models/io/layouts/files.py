"""The files of a recording: those that were named, or those below a folder that match a pattern."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from re import Match, Pattern

from ...errors import InputError, check_path
from .formats.registry import ENDINGS, ending, unknown
from .mapping import TapMap, option
from .patterns import FIELDS, NUMBERS, compiled_pattern, fields_of, natural

_MOST_SHOWN = 5


@dataclass(frozen=True)
class SourceFile:
    """One file of a recording.

    Attributes:
        path: Where it is.
        below: Its path below the folder that was named, or its name, with `/` between folders.
        source: Number of the file or folder that was named, from 0.
        fields: Texts of the fields of its name, or of that of an array in it.
        array: Name of the array, if it is one of several in the file.
    """

    path: Path
    below: str
    source: int
    fields: dict[str, str] = field(default_factory=dict)
    array: str = ""


def source_files(sources: Sequence[Path], how: TapMap) -> list[SourceFile]:
    """The files, in the natural order of their names in each folder.

    Raises:
        InputError: There is none, one is named twice, or the name of one does not match a pattern of the map.
    """
    found = [file for number, path in enumerate(sources) for file in _below(check_path(path), number, how)]
    twice = [path for path, number in Counter(file.path.resolve() for file in found).items() if number > 1]
    if twice:
        raise InputError(f"{twice[0]}: named twice, so that its taps would be in training and test data.")
    texts = {key: text.removeprefix("date:") for key, text in how.label_texts.items()}
    patterns = {key: text for key, text in texts.items() if text.startswith(("file:", "folder:"))}
    for key, text in patterns.items():
        if key not in fields_of(text):
            raise InputError(f"{option(key)}: the pattern {text.partition(':')[2]!r} has no field {{{key}}}.")
    return [_labelled(file, patterns) for file in found]


def unmatched(sources: Sequence[Path], files: Sequence[SourceFile], how: TapMap) -> tuple[str, ...]:
    """How many files below each folder, of the kinds of those found, do not match the pattern of a map; sentences."""
    told = []
    for number, path in enumerate(sources):
        own = {file.below for file in files if file.source == number}
        if how.files is not None and is_folder(path):
            kinds = set(map(ending, own))
            others = [name for name in names_below(path) if ending(name) in kinds and name not in own]
            others = [name for name in others if not _is_table(name, how)]
            if others:
                whole = len(own) + len(others)
                told.append(
                    f"{len(others)} of {whole} files below {path} do not match files (--files), such as {others[0]}."
                )
    return tuple(told)


def _below(path: Path, number: int, how: TapMap) -> Iterator[SourceFile]:
    if not path.exists():
        raise InputError(f"{path}: no such file.")
    if not is_folder(path):
        yield SourceFile(path, path.name, number)
        return
    names = names_below(path)
    if how.files is None:
        names = [name for name in names if not _is_table(name, how)]
        kinds = kinds_of(path, names, how.format)
        if len({ENDINGS.get(kind, kind) for kind in kinds}) > 1:
            counted = ", ".join(f"{n} {kind or 'without ending'}" for kind, n in kinds.most_common(_MOST_SHOWN))
            raise InputError(f"{path}: holds files of several kinds ({counted}); say which with files (--files).")
        yield from (SourceFile(path / name, name, number) for name in names if ending(name) in kinds)
        return
    pattern = compiled_pattern(how.files, "files (--files)")
    names = [name for name in names if not _is_table(name, how)]
    matched = [(name, found) for name in names if (found := _match(pattern, name))]
    if not matched:
        shown = ", ".join(names[:_MOST_SHOWN]) or "none"
        why = _no_number(how.files, names) or f"; files: {shown}."
        raise InputError(f"{path}: none of {len(names)} files matches files (--files) {how.files!r}{why}")
    yield from (SourceFile(path / name, name, number, found.groupdict()) for name, found in matched)


def _no_number(pattern: str, names: Sequence[str]) -> str:
    """End of a sentence on a field that must be a number and is none in the first name that would match otherwise."""
    free = re.sub(r"\{(\w+)\}", lambda found: f"{{{found[1]}{'_' * (found[1] in NUMBERS)}}}", pattern)
    any_text = compiled_pattern(free, "", (*FIELDS, *(f"{name}_" for name in NUMBERS)))
    for name in names:
        fields = match.groupdict() if (match := _match(any_text, name)) else {}
        for field_name, text in fields.items():
            number = field_name.removesuffix("_")
            if number != field_name and not compiled_pattern(f"{{{number}}}", "").fullmatch(text):
                return (
                    f": {{{number}}} must be one number, with letters around it, but is {text!r} in {name}. List it "
                    "in a table beside the files, as labels.csv:COLUMN, or call the field {what} or {session}."
                )
    return ""


def _match(pattern: Pattern[str], name: str) -> Match[str] | None:
    """Match of a name, or of the name with its ending in small letters, as patterns of files have them."""
    small = name.removesuffix(PurePosixPath(name).suffix) + ending(name)
    return pattern.fullmatch(small) or pattern.fullmatch(name)


def _is_table(name: str, how: TapMap) -> bool:
    """Whether a map names this file as a table of labels or events."""
    texts = filter(None, (*how.label_texts.values(), *how.extra, how.what_value, how.events))
    own = name, name.rpartition("/")[2]
    return any(text == each or text.startswith(f"{each}:") for text in texts for each in own)


def is_folder(path: Path) -> bool:
    """Whether a path is a folder of files, and no store of Zarr."""
    return path.is_dir() and ending(path.name) not in ENDINGS


def kinds_of(folder: Path, names: Sequence[str], stated: str | None = None) -> Counter[str]:
    """Endings of the files of known kinds among those of a folder, or of a format that is stated, if any end so.

    Raises:
        InputError: There is none.
    """
    every = Counter(map(ending, names))
    kinds = Counter({kind: n for kind, n in every.items() if kind in ENDINGS})
    if stated is not None:
        known = {kind: n for kind, n in kinds.items() if ENDINGS[kind] == stated}
        kinds = Counter(known or {kind: n for kind, n in every.items() if kind not in ENDINGS})
    if not kinds:
        such = f"*{max(every, key=lambda kind: every[kind], default='')}"
        way = f"; if those called {such} are text, say format (--format) text" if every and stated is None else ""
        raise unknown(folder, names, f"no file of a known kind in this folder ({', '.join(sorted(ENDINGS))}){way}")
    return kinds


def names_below(folder: Path) -> list[str]:
    """Paths of the files below a folder in natural order; a store of Zarr is one."""
    return sorted(_names(folder), key=natural)


def _names(folder: Path) -> Iterator[str]:
    seen: set[Path] = set()
    for root, folders, files in folder.walk(follow_symlinks=True):
        if (real := root.resolve()) in seen:  # a link to a folder above
            folders.clear()
            continue
        seen.add(real)
        stores = [name for name in folders if ending(name) in ENDINGS]
        folders[:] = [name for name in folders if name not in stores and not name.startswith(".")]
        for name in (*files, *stores):
            if not name.startswith("."):
                yield (root / name).relative_to(folder).as_posix()


def _labelled(file: SourceFile, patterns: dict[str, str]) -> SourceFile:
    """The file with the fields of its name."""
    fields = dict(file.fields)
    for key, text in patterns.items():
        kind, _, pattern = text.partition(":")
        name = file.path.name if kind == "file" else file.below
        found = _match(compiled_pattern(pattern, option(key)), name)
        if found is None:
            why = _no_number(pattern, [name]) or "."
            raise InputError(f"{file.path}: its name {name!r} does not match {option(key)} {text!r}{why}")
        for field_name, value in found.groupdict().items():
            if fields.setdefault(field_name, value) != value:
                raise InputError(f"{file.path}: {{{field_name}}} is {fields[field_name]!r} and {value!r}.")
    return SourceFile(file.path, file.below, file.source, fields)
