"""Pieces of a recording: the taps or frames of one file or array, with their labels as they stand there."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..recording import naming
from .columns import FirstColumns, agreeing, taxel_columns, taxel_slice
from .files import SourceFile
from .formats.contents import Contents, Values
from .formats.registry import open_contents
from .labels import ByOrder, Label, LabelSource, LabelTables, as_known, label_of, label_source, needed
from .mapping import LABELS, PLANE, TapMap
from .patterns import compiled_pattern, filled, is_pattern, natural
from .rows import among_kept, check_labels, check_numbers, condition, kept, tap_column, tap_starts
from .signal import Signal, arranged, side_by_side, split_frames

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
        row: Number of the row or tap of the file that each one begins with, shape (rows,).
        whole: Number of rows or taps of the file, kept or not.
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
    row: NDArray[np.intp] = field(default_factory=lambda: np.arange(0))
    whole: int = 0

    @property
    def rows(self) -> int:
        """Number of taps or frames."""
        return len(self.signal.samples)


def pieces(files: Sequence[SourceFile], how: TapMap, tables: LabelTables) -> Iterator[Piece]:
    """The pieces of all files, in their order.

    Raises:
        InputError: A file cannot be read as the map says; the message names it.
    """
    first: FirstColumns = {}
    for file in files:
        contents = open_contents(file.path, how.text_table, how.format)
        with naming(file.path):
            alone = _only_array(contents) if how.taps is None else None
            if how.taps is None and alone is None:
                yield _of_columns(file, contents, how, tables, first)
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


def _of_columns(file: SourceFile, contents: Contents, how: TapMap, tables: LabelTables, first: FirstColumns) -> Piece:
    """Taps or frames whose taxels are columns; those of further files agree with the first ones."""
    columns = agreeing(taxel_columns(how, contents), contents, how, first)
    sources = sources_of(how, file.fields)
    further, labels = _further(how, sources, file, contents), needed(list(sources.values()), file.fields, contents)
    numbers = [name for name in further if name not in labels and contents.variables[name].dtype == np.float64]
    beside = [*columns, *(name for name in numbers if contents.variables[name].shape[1:] == ())]
    values, frames = contents.read([name for name in further if name not in beside[len(columns) :]], beside)
    if frames is None:
        raise InputError("no taxels: say which columns they are with taxels (--taxels).")
    values |= {name: frames[:, len(columns) + n] for n, name in enumerate(beside[len(columns) :])}
    frames = frames[:, : len(columns)]
    axes = how.axis_names
    if axes is not None and len(axes) != 2:
        raise InputError(f"axes (--axes) {how.axes!r}: rows and columns are two axes.")
    units = {contents.variables[name].unit for name in columns}
    signal = arranged(frames, axes, "the table", frames=True)
    return _piece(file, contents, how, tables, (signal, sources, values, units.pop() if len(units) == 1 else ""))


def _of_arrays(file: SourceFile, names: Sequence[str], contents: Contents, how: TapMap, tables: LabelTables) -> Piece:
    """Taps or frames of one array, or of several side by side."""
    sources = sources_of(how, file.fields)
    values, _ = contents.read([*dict.fromkeys([*names, *_further(how, sources, file, contents)])])
    frames = how.tap is not None or how.trigger is not None
    signal = side_by_side([arranged(values[name], how.axis_names, name, frames) for name in names], names)
    if how.taxels is not None:
        signal = signal.with_taxels(taxel_slice(how))
    units = {contents.variables[name].unit for name in names}
    return _piece(file, contents, how, tables, (signal, sources, values, units.pop() if len(units) == 1 else ""))


def _further(how: TapMap, sources: Mapping[str, LabelSource], file: SourceFile, contents: Contents) -> list[str]:
    """Variables that are needed beside the samples."""
    names = needed(list(sources.values()), file.fields, contents)
    named = [how.time, tap_column(how), condition(how)[0], how.signal]
    named += [value for value in (how.what_names, how.where_values) if isinstance(value, str)]
    return [*dict.fromkeys([*names, *(_named(contents, name, file) for name in named if name)])]


def _named(contents: Contents, name: str, file: SourceFile) -> str:
    return contents.named(filled(name, file.fields))


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
    which = np.arange(rows)
    labels = {key: label_of(of, file, contents, values, tables, rows) for key, of in sources.items()}
    labels = {
        key: as_known(of) if key in how.extra and isinstance(of, np.ndarray | str) else of for key, of in labels.items()
    }
    time_s = _times(how, file, contents, values)
    rises = None if how.signal is None else np.asarray(values[_named(contents, how.signal, file)])
    per_row: dict[str, Any] = {"time": time_s, "rises": rises, **labels}
    if (column := tap_column(how)) and not (how.tap or "").startswith("ends:"):
        per_row["tap"] = np.asarray(values[_named(contents, column, file)])
    starts = None
    if not signal.cut:
        ends = np.asarray(values[_named(contents, column, file)]) if column and "tap" not in per_row else None
        starts = tap_starts(rows, how, per_row.get("tap"), ends, labels)
    if how.keep is not None:
        mask = kept(how, np.asarray(values[_named(contents, condition(how)[0], file)]), rows)
        per_row = {
            key: of[mask] if isinstance(of, np.ndarray) and len(of) == rows else of for key, of in per_row.items()
        }
        signal, which = signal.select(mask), np.flatnonzero(mask)
        starts = None if starts is None else among_kept(starts, which, rows)
    if not signal.cut:
        changing = {key: per_row[key] for key in labels}

        def place(row: int) -> str:
            return contents.place(int(which[row]))

        if starts is not None and "tap" in per_row:
            check_numbers(how, per_row["tap"], starts, changing, place)
        check_labels(changing, len(signal.samples), starts, place)
    elif how.tap is not None:
        raise InputError(f"tap (--tap) {how.tap!r} divides rows into taps, but {how.taps} has an axis of taps.")
    time_s = per_row["time"]
    rate = None if time_s is None else _rate(time_s, signal, starts)
    labels = {key: per_row[key] for key in labels}
    if starts is not None:
        labels = {key: of[starts] if isinstance(of, np.ndarray) else of for key, of in labels.items()}
        time_s, which = None if time_s is None else time_s[starts], which[starts]
        signal = Signal(split_frames(np.asarray(signal.samples), starts))
    listed = {key: np.asarray(values[_named(contents, name, file)]) for key, name in _tables(how).items()}
    units = _label_units(sources, file, contents)
    return Piece(file, signal, labels, rate, unit, listed, time_s, units, per_row["rises"], which, rows)


def with_ordered_labels(found: Sequence[Piece]) -> list[Piece]:
    """The pieces with those labels that tables list in the order of all their taps or rows.

    Raises:
        InputError: A table has another number of rows.
    """
    labels, sharing = [dict(piece.labels) for piece in found], dict[tuple[str, int], list[int]]()
    for number, piece in enumerate(found):
        for key, of in piece.labels.items():
            if isinstance(of, ByOrder):
                sharing.setdefault((key, id(of.values)), []).append(number)
    for (key, _), numbers in sharing.items():
        parts = _parts(labels[numbers[0]][key], [found[number] for number in numbers])
        for number, part in zip(numbers, parts, strict=True):
            labels[number][key] = part
    return [replace(piece, labels=of) for piece, of in zip(found, labels, strict=True)]


def _parts(label: Any, sharing: Sequence[Piece]) -> list[NDArray[Any]]:
    """Values of a table for each piece that shares it: one for each tap, else for each row, else those of each file."""
    values, taps, rows = label.values, [piece.rows for piece in sharing], [piece.whole for piece in sharing]
    if len(values) == sum(taps):
        return np.split(values, np.cumsum(taps)[:-1])
    if len(values) == sum(rows):
        return [part[piece.row] for part, piece in zip(np.split(values, np.cumsum(rows)[:-1]), sharing, strict=True)]
    if all(number == len(values) for number in taps):
        return [values] * len(sharing)
    raise InputError(
        f"{label.table}: {len(values)} rows for {sum(taps)} taps, and no column with the names of the files."
    )


def _label_units(sources: Mapping[str, LabelSource], file: SourceFile, contents: Contents) -> dict[str, str]:
    """Units of labels that are columns or arrays."""
    names = {key: filled(of.name, file.fields) for key, of in sources.items() if of.kind == "column"}
    return {
        key: contents.variables[contents.named(name)].unit
        for key, name in names.items()
        if name not in contents.attributes
    }


def _tables(how: TapMap) -> dict[str, str]:
    named = {"what_names": how.what_names, "where_values": how.where_values}
    return {key: name for key, name in named.items() if isinstance(name, str)}


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
    steps = steps[~np.isnan(steps)]
    if not steps.size:
        return None
    step = float(np.median(steps))
    if not step > 0:
        raise InputError("time (--time) does not increase.")
    return float(f"{1 / step:.6g}")
