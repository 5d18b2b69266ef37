"""Pieces of a recording: the taps or frames of one file or array, with their labels as they stand there."""

import operator
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..recording import naming
from .files import SourceFile
from .formats.contents import Contents, Values
from .formats.registry import open_contents
from .labels import Label, LabelSource, LabelTables, as_known, as_numbers, label_of, label_source, needed
from .mapping import LABELS, PLANE, TapMap
from .patterns import compiled_pattern, filled, is_pattern, natural
from .signal import Signal, arranged, runs, side_by_side, split_frames

_CONDITION = re.compile(r"(.+?)(!=|=|<|>)(.*)")
_COMPARED = {"=": operator.eq, "!=": operator.ne, "<": operator.lt, ">": operator.gt}
_UNITS = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}


@dataclass(frozen=True, eq=False)
class Piece:
    """Taps or frames of one file or array.

    Attributes:
        file: Where they come from; its fields include those of the array's name.
        signal: The samples.
        labels: Values of each tap or row, or the same for all.
        rate_hz: From its times, `None` without.
        unit: Of its samples, as the file states it.
        tables: Names and positions that are in the file, by key of the map.
        time_s: Times of its rows or taps, if known.
        label_units: Units of its labels, as the file states them.
        rises: Signal that rises at each press, shape (rows,).
    """

    file: SourceFile
    signal: Signal
    labels: Mapping[str, Label]
    rate_hz: float | None = None
    unit: str = ""
    tables: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    time_s: NDArray[np.float64] | None = None
    label_units: Mapping[str, str] = field(default_factory=dict)
    rises: NDArray[Any] | None = None

    @property
    def rows(self) -> int:
        """Number of taps or frames."""
        return len(self.signal.samples)


def pieces(files: Sequence[SourceFile], how: TapMap, tables: LabelTables) -> Iterator[Piece]:
    """The pieces of all files, in their order.

    Raises:
        InputError: A file cannot be read as the map says; the message names it.
    """
    for file in files:
        contents = open_contents(file.path, how.text_table, how.format)
        with naming(file.path):
            alone = _only_array(contents) if how.taps is None else None
            if how.taps is None and alone is None:
                yield _of_columns(file, contents, how, tables)
            else:
                for names, fields in _arrays(how.taps or alone or "", file, contents):
                    whose = replace(file, fields=file.fields | fields)
                    yield _of_arrays(whose, names, contents, how, tables)


def _only_array(contents: Contents) -> str | None:
    """The array of a file that holds no other."""
    return None if contents.table or len(contents.variables) != 1 else next(iter(contents.variables))


def _arrays(
    pattern: str | tuple[str, ...], file: SourceFile, contents: Contents
) -> list[tuple[list[str], dict[str, str]]]:
    """Names of arrays of samples that stand side by side, for each piece, with the fields of these names.

    Pieces are in natural order of their names.
    """
    if isinstance(pattern, tuple):
        return [([contents.named(filled(name, file.fields)) for name in pattern], {})]
    if pattern in contents.variables or not is_pattern(pattern):
        return [([contents.named(pattern)], {})]
    compiled = compiled_pattern(pattern, "taps (--taps)")
    matches = ((name, compiled.fullmatch(name)) for name in contents.variables)
    found = [([name], match.groupdict()) for name, match in matches if match]
    if not found:
        there = ", ".join(list(contents.variables)[:8])
        raise InputError(f"no array matches taps (--taps) {pattern!r}; arrays: {there}.")
    return sorted(found, key=lambda each: natural(each[0][0]))


def sources_of(how: TapMap, fields: Mapping[str, str]) -> dict[str, LabelSource]:
    """Where each label stands that is anywhere: keys of the map, else fields of a name."""
    found: dict[str, LabelSource] = {}
    for key in LABELS:
        text = getattr(how, key)
        if isinstance(text, tuple):
            found |= {axis: label_source(axis, each) for axis, each in zip(PLANE, text, strict=False)}
        elif text is not None:
            found[key] = label_source(key, text)
        elif key in fields:
            found[key] = LabelSource(key, "field", key)
    if how.what_value is not None and how.what_value != "names":
        found["what_value"] = label_source("what_value", how.what_value)
    for name in how.extra:
        found[name] = label_source(name, name)
    return found


def _of_columns(file: SourceFile, contents: Contents, how: TapMap, tables: LabelTables) -> Piece:
    """Taps or frames whose taxels are columns."""
    columns = _taxel_columns(how, contents)
    sources = sources_of(how, file.fields)
    values, frames = contents.read(_further(how, sources, file, contents), columns)
    if frames is None:
        raise InputError("no taxels: say which columns they are with taxels (--taxels).")
    axes = how.axis_names
    if axes is not None and len(axes) != 2:  # noqa: PLR2004
        raise InputError(f"axes (--axes) {how.axes!r}: rows and columns are two axes.")
    units = {contents.variables[name].unit for name in columns}
    signal = arranged(frames, axes, "the table", frames=True)
    return _piece(file, contents, how, tables, (signal, sources, values, units.pop() if len(units) == 1 else ""))


def _of_arrays(
    file: SourceFile, names: Sequence[str], contents: Contents, how: TapMap, tables: LabelTables
) -> Piece:
    """Taps or frames of one array, or of several side by side."""
    sources = sources_of(how, file.fields)
    values, _ = contents.read([*dict.fromkeys([*names, *_further(how, sources, file, contents)])])
    frames = how.tap is not None or how.trigger is not None
    signal = side_by_side([arranged(values[name], how.axis_names, name, frames) for name in names], names)
    if how.taxels is not None:
        signal = signal.with_taxels(_taxel_slice(how))
    units = {contents.variables[name].unit for name in names}
    return _piece(file, contents, how, tables, (signal, sources, values, units.pop() if len(units) == 1 else ""))


def _further(how: TapMap, sources: Mapping[str, LabelSource], file: SourceFile, contents: Contents) -> list[str]:
    """Variables that are needed beside the samples."""
    names = needed(list(sources.values()), file.fields, contents)
    named = [how.time, _tap_column(how), _condition(how)[0], how.signal]
    named += [value for value in (how.what_names, how.where_values) if isinstance(value, str)]
    return [*dict.fromkeys([*names, *(_named(contents, name, file) for name in named if name)])]


def _named(contents: Contents, name: str, file: SourceFile) -> str:
    return contents.named(filled(name, file.fields))


def _tap_column(how: TapMap) -> str | None:
    """Column or array that says which rows are a tap."""
    if how.tap is None or how.tap in ("file", "row"):
        return None
    return how.tap.removeprefix("restart:").removeprefix("ends:").removeprefix("column:")


def _condition(how: TapMap) -> tuple[str, str, str]:
    """Column, comparison and value of `keep`; without a comparison the column holds truth values."""
    found = _CONDITION.fullmatch(how.keep or "")
    return (found[1].strip(), found[2], found[3].strip()) if found else (how.keep or "", "", "")


def _piece(
    file: SourceFile,
    contents: Contents,
    how: TapMap,
    tables: LabelTables,
    found: tuple[Signal, Mapping[str, LabelSource], Mapping[str, Values], str],
) -> Piece:
    """The piece, its frames divided into taps where the map says how."""
    signal, sources, values, unit = found
    rows = len(signal.samples)
    labels = {key: label_of(of, file, contents, values, tables, rows) for key, of in sources.items()}
    labels = {
        key: as_known(of) if key in how.extra and isinstance(of, np.ndarray | str) else of for key, of in labels.items()
    }
    time_s = _times(how, file, contents, values)
    rises = None if how.signal is None else np.asarray(values[_named(contents, how.signal, file)])
    per_row: dict[str, Any] = {"time": time_s, "rises": rises, **labels}
    if (column := _tap_column(how)) and not (how.tap or "").startswith("ends:"):
        per_row["tap"] = np.asarray(values[_named(contents, column, file)])
    if how.keep is not None:
        mask = _kept(how, file, contents, values, rows)
        per_row = {key: of[mask] if isinstance(of, np.ndarray) and len(of) == rows else of for key, of in per_row.items()}
        signal = signal.select(mask)
    starts = None
    if not signal.cut:
        ends = np.asarray(values[_named(contents, column, file)]) if column and "tap" not in per_row else None
        changing = {key: per_row[key] for key in labels}
        starts = _tap_starts(len(signal.samples), how, contents, per_row.get("tap"), ends, changing)
        _check_labels(changing, signal, starts, contents)
    elif how.tap is not None:
        raise InputError(f"tap (--tap) {how.tap!r} divides rows into taps, but {how.taps} has an axis of taps.")
    time_s = per_row["time"]
    rate = None if time_s is None else _rate(time_s, signal, starts)
    labels = {key: per_row[key] for key in labels}
    if starts is not None:
        labels = {key: of[starts] if isinstance(of, np.ndarray) else of for key, of in labels.items()}
        time_s = time_s[starts] if time_s is not None else None
        signal = Signal(split_frames(np.asarray(signal.samples), starts))
    kept = {key: np.asarray(values[_named(contents, name, file)]) for key, name in _tables(how).items()}
    return Piece(file, signal, labels, rate, unit, kept, time_s, _label_units(sources, file, contents), per_row["rises"])


def _label_units(sources: Mapping[str, LabelSource], file: SourceFile, contents: Contents) -> dict[str, str]:
    """Units of labels that are columns or arrays."""
    names = {key: filled(of.name, file.fields) for key, of in sources.items() if of.kind == "column"}
    return {
        key: contents.variables[contents.named(name)].unit
        for key, name in names.items()
        if name not in contents.attributes
    }


def _kept(
    how: TapMap, file: SourceFile, contents: Contents, values: Mapping[str, Values], rows: int
) -> NDArray[np.bool_]:
    """Which rows or taps `keep` keeps."""
    name, comparison, wanted = _condition(how)
    column = np.asarray(values[_named(contents, name, file)])
    if column.shape != (rows,):
        raise InputError(f"keep (--keep): {name} has shape {column.shape}, expected one value for each of {rows} rows.")
    column = as_known(column)
    if not comparison:
        if column.dtype.kind == "U":
            raise InputError(f"keep (--keep): {name} holds texts such as {column[0]!r}; compare it, as in {name}=1.")
        return column != 0
    if column.dtype.kind == "U":
        if comparison not in ("=", "!="):
            raise InputError(f"keep (--keep): {name} holds texts such as {column[0]!r}, which {comparison} cannot compare.")
        return (column == wanted) == (comparison == "=")
    try:
        number = float(wanted)
    except ValueError:
        raise InputError(f"keep (--keep): {name} holds numbers, but {wanted!r} is none.") from None
    return _COMPARED[comparison](column, number)


def _tables(how: TapMap) -> dict[str, str]:
    named = {"what_names": how.what_names, "where_values": how.where_values}
    return {key: name for key, name in named.items() if isinstance(name, str)}


def _tap_starts(
    rows: int,
    how: TapMap,
    contents: Contents,
    number: NDArray[Any] | None,
    ends: NDArray[Any] | None,
    labels: Mapping[str, Label],
) -> NDArray[np.intp] | None:
    """First row of each tap, `None` for a stream."""
    if how.tap is None:
        return None
    if not rows:
        return np.zeros(0, dtype=np.intp)
    if how.tap == "file":
        return np.zeros(1, dtype=np.intp)
    if how.tap == "row":
        return np.arange(rows)
    if ends is not None:
        bounds = np.concatenate([[0], ends.astype(np.intp).reshape(-1)])
        if (np.diff(bounds) <= 0).any() or bounds[-1] != rows:
            raise InputError(f"tap (--tap) {how.tap!r}: its numbers must rise to the {rows} rows, and end there.")
        return bounds[:-1]
    if number is None or number.shape != (rows,):
        raise InputError(f"tap (--tap) {how.tap!r}: expected one number for each of {rows} rows.")
    if how.tap.startswith("restart:"):
        count, _ = as_numbers("tap", number)
        return np.flatnonzero(np.concatenate([[True], np.diff(count) <= 0]))
    changing = [of for key, of in labels.items() if key in LABELS and isinstance(of, np.ndarray) and len(of) == rows]
    starts = runs(number, *changing)
    seen: set[tuple[Any, ...]] = set()
    previous: tuple[Any, ...] = ()
    for start in starts.tolist():
        key = (number[start].item(), *(of[start].item() for of in changing))
        if previous[:1] == key[:1]:
            raise InputError(
                f"{contents.place(start)}: a label changes within tap {key[0]} from {previous[1:]} to {key[1:]}."
            )
        if key in seen:
            raise InputError(
                f"{contents.place(start)}: tap {key[0]} starts again after another tap; rows of a tap must follow one "
                "another; if the column counts within taps, say tap = 'restart:COLUMN'."
            )
        seen.add(key)
        previous = key
    return starts


def _check_labels(
    labels: Mapping[str, Label], signal: Signal, starts: NDArray[np.intp] | None, contents: Contents
) -> None:
    """Checks that labels of rows are as many, and do not change within a tap."""
    rows = len(signal.samples)
    for key, values in labels.items():
        if not isinstance(values, np.ndarray):
            continue
        if len(values) != rows:
            raise InputError(f"{key} (--{key}) has {len(values)} values for {rows} rows.")
        if starts is not None:
            first = np.repeat(starts, np.diff(starts, append=rows))
            bad = np.flatnonzero(values != values[first])
            if len(bad):
                raise InputError(
                    f"{contents.place(int(bad[0]))}: {key} changes within a tap from {values[first[bad[0]]]} to "
                    f"{values[bad[0]]}."
                )


def _times(
    how: TapMap, file: SourceFile, contents: Contents, values: Mapping[str, Values]
) -> NDArray[np.float64] | None:
    """Times in seconds."""
    if how.time is None:
        return None
    name = _named(contents, how.time, file)
    found = values[name]
    if isinstance(found, list):
        raise InputError(f"time (--time): {name} has elements of different lengths; give the rate with --rate.")
    try:
        numbers = found.astype(np.float64)
    except ValueError:
        raise InputError(f"time (--time): {name} holds texts, not numbers.") from None
    unit = how.time_unit or contents.variables[name].unit or "s"
    if unit not in _UNITS:
        raise InputError(f"time (--time): {name} is in {unit!r}; say its unit with --time-unit s, ms, us or ns.")
    return numbers * _UNITS[unit]


def _rate(time_s: NDArray[np.float64], signal: Signal, starts: NDArray[np.intp] | None) -> float | None:
    """Samples per second from the median step, to six digits; `None` where times are those of taps."""
    if signal.cut and time_s.shape[-1:] != (np.asarray(signal.samples[0]).shape[0],):
        return None
    steps = np.diff(time_s)
    if starts is not None:
        inside = np.ones(len(steps), dtype=bool)
        inside[starts[1:] - 1] = False
        steps = steps[inside]
    if not steps.size:
        return None
    step = float(np.median(steps))
    if not step > 0:
        raise InputError("time (--time) does not increase.")
    return float(f"{1 / step:.6g}")


def _taxel_columns(how: TapMap, contents: Contents) -> list[str]:
    """Names of the columns of samples, in the order of the file."""
    names = list(contents.variables)
    if how.taxels is None:
        raise InputError(
            f"say which columns are taxels with taxels (--taxels), or which array holds the samples with taps (--taps); "
            f"there are: {', '.join(names[:12])}{', ...' if len(names) > 12 else ''}."  # noqa: PLR2004
        )
    wanted = (how.taxels,) if isinstance(how.taxels, str) else how.taxels
    found: list[str] = []
    for text in wanted:
        part = _as_slice(text)
        if part is not None and text not in names:
            matched = names[part]
        elif is_pattern(text) and text not in names:
            matched = [name for name in names if fnmatchcase(name, _literal_brackets(text))]
        else:
            matched = [contents.named(text)]
        if not matched:
            raise InputError(f"no column matches taxels (--taxels) {text!r}; columns: {', '.join(names[:12])}.")
        found += [name for name in matched if name not in found]
    return found


def _literal_brackets(text: str) -> str:
    """Units in headers stand in brackets, which `fnmatch` would read as a set of letters."""
    return text.replace("[", "[[]")


def _as_slice(text: str) -> slice | None:
    begin, colon, end = text.partition(":")
    if not colon or not all(not part or part.lstrip("-").isdecimal() for part in (begin, end)):
        return None
    return slice(int(begin) if begin else None, int(end) if end else None)


def _taxel_slice(how: TapMap) -> slice:
    chosen = _as_slice(how.taxels) if isinstance(how.taxels, str) else None
    if chosen is None:
        raise InputError(f"taxels (--taxels) of an array must be a slice such as 0:12, got {how.taxels!r}.")
    return chosen


