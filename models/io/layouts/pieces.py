"""Pieces of a recording: the taps or frames of one file or array, with their labels as they stand there."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...settings import Missing
from ..recording import as_samples, naming
from .columns import FirstColumns, agreeing, taxel_columns, taxel_slice
from .files import SourceFile
from .formats.contents import Contents, Values, unit_at_end
from .formats.registry import open_contents
from .labels import LENGTHS_AND_ANGLES, Label, LabelSource, LabelTables, as_known, label_of, label_source, needed
from .long_table import widened
from .mapping import EXTRA, LABELS, PLANE, TapMap, option
from .patterns import compiled_pattern, filled, is_pattern, natural
from .rows import among_kept, check_labels, check_numbers, condition, kept, tap_columns, tap_starts
from .signal import Signal, arranged, side_by_side, split_frames

_UNITS = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "µs": 1e-6, "usec": 1e-6}
_UNITS |= {"ns": 1e-9, "nsec": 1e-9}


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


def pieces(files: Sequence[SourceFile], how: TapMap, tables: LabelTables, missing: Missing) -> Iterator[Piece]:
    """The pieces of all files, in their order; their samples are floats, which `missing` allows to be NaN.

    Raises:
        InputError: A file cannot be read as the map says; the message names it.
    """
    first: dict[str, FirstColumns] = {}
    for file in files:
        contents = open_contents(file.path, how.text_table, how.format)
        with naming(file.path):
            alone = _only_array(contents) if how.taps is None else None
            if how.taps is None and alone is None:
                columns = first.setdefault(file.fields.get("taxel", ""), {})
                yield _piece(_of_columns(file, contents, how, tables, columns), tables, missing)
            else:
                for names, fields in _arrays(how.taps or alone or "", file, contents):
                    whose = replace(file, fields=file.fields | fields)
                    yield _piece(_of_arrays(whose, names, contents, how, tables), tables, missing)


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
        with naming(option("taps")):
            return [([contents.named(filled(name, file.fields)) for name in pattern], {})]
    if pattern in contents.variables or not is_pattern(pattern):
        with naming(option("taps")):
            return [([contents.named(pattern)], {})]
    compiled = compiled_pattern(pattern, option("taps"))
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
        elif key == "where" and (axes := [axis for axis in PLANE if axis in fields]):
            if axes[:2] != list(PLANE[:2]):
                raise InputError(
                    f"the field {{{axes[0]}}} of a name needs {{x}} and {{y}}, both of a place in a plane."
                )
            found |= {axis: LabelSource(axis, "field", axis) for axis in axes}
    if how.what_value is not None and how.what_value != "names":
        found["what_value"] = label_source("what_value", how.what_value)
    for name in how.extra:
        found[EXTRA + name] = label_source(EXTRA + name, name)
    return found


@dataclass(frozen=True, eq=False)
class _Read:
    """What was read of a file for a piece.

    Attributes:
        file: The file.
        contents: What it holds.
        how: The map.
        signal: The samples.
        names: Their columns or arrays.
        values: The variables beside them.
        at: Rows of each taxel, shape (K, rows), of a long table.
    """

    file: SourceFile
    contents: Contents
    how: TapMap
    signal: Signal
    names: Sequence[str]
    values: Mapping[str, Values]
    at: NDArray[np.intp] | None = None

    def of(self, name: str) -> Values:
        """The variable that a key of the map names."""
        return self.values[self.contents.named(filled(name, self.file.fields))]

    @property
    def unit(self) -> str:
        """Unit of the samples, if the file states one for all."""
        units = {self.contents.variables[name].unit for name in self.names}
        return units.pop() if len(units) == 1 else ""

    def place(self, row: int) -> str:
        """Where a row or tap stands."""
        return self.contents.place(row if self.at is None else int(self.at[0, row]))

    def place_of_sample(self, which: NDArray[np.intp]) -> Callable[[tuple[int, ...]], str]:
        """Where a sample stands, by its index among those rows or taps of the file."""
        axes = self.how.axis_names or ("sample",)

        def place(index: tuple[int, ...]) -> str:
            row, *inside = int(which[index[0]]), *index[1:]
            if self.at is not None:
                return f"{self.contents.place(int(self.at[inside[0], row]))}, column {self.names[0]}"
            if self.contents.table and self.how.taps is None and axes[0] in ("sample", "tap"):
                return f"{self.place(row)}, column {self.names[max(inside)]}"
            called = ("tap", "sample", "taxel") if len(index) > 2 else ("frame", "taxel")
            whose = f" of {self.names[0]}" if len(self.names) == 1 else ""
            return ", ".join(f"{name} {n}" for name, n in zip(called, (row, *inside), strict=True)) + whose

        return place


@dataclass(frozen=True, eq=False)
class _Rows:
    """Samples, and what belongs to each of their rows, or of their taps where they have an axis of taps.

    Attributes:
        signal: The samples.
        which: Numbers of the rows in their file, shape (rows,).
        labels: Of each row, or the same for all.
        time_s: Times, if known.
        rises: Signal that rises at each press, if any.
        numbers: Of the tap of each row, or of the row within it, as columns tell.
    """

    signal: Signal
    which: NDArray[np.intp]
    labels: Mapping[str, Label]
    time_s: NDArray[np.float64] | None
    rises: NDArray[Any] | None
    numbers: tuple[NDArray[Any], ...]

    def select(self, rows: NDArray[Any], signal: Signal) -> "_Rows":
        """Some rows alone, with their samples."""

        def some(of: Any) -> Any:
            return of[rows] if isinstance(of, np.ndarray) and len(of) == len(self.which) else of

        labels = {key: some(of) for key, of in self.labels.items()}
        numbers = tuple(map(some, self.numbers))
        return _Rows(signal, self.which[rows], labels, some(self.time_s), some(self.rises), numbers)


def _of_columns(file: SourceFile, contents: Contents, how: TapMap, tables: LabelTables, first: FirstColumns) -> _Read:
    """Samples whose taxels are columns; those of further files agree with the first ones."""
    sources = sources_of(how, file.fields)
    labels = needed(list(sources.values()), file, contents, tables)
    further = _further(how, sources, file, contents, tables)
    own = [of for key, of in sources.items() if not key.startswith(EXTRA)]
    also = (*tap_columns(how), *filter(None, (how.time, how.taxel)))
    also = [contents.named(filled(name, file.fields)) for name in also]
    chosen = taxel_columns(how, contents, {*needed(own, file, contents, tables), *also})
    columns = chosen if how.taxel is not None else agreeing(chosen, contents, how, first)
    numbers = [name for name in further if name not in labels and contents.variables[name].dtype == np.float64]
    beside = [*columns, *(name for name in numbers if contents.variables[name].shape[1:] == ())]
    values, frames = contents.read([name for name in further if name not in beside[len(columns) :]], beside)
    if frames is None:
        raise InputError("no taxels: say which columns they are with taxels (--taxels).")
    values |= {name: frames[:, len(columns) + n] for n, name in enumerate(beside[len(columns) :])}
    axes, frames = how.axis_names, frames[:, : len(columns)]
    if axes is not None and len(axes) != 2:
        raise InputError(f"axes (--axes) {how.axes!r}: rows and columns are two axes.")
    if how.taxel is None:
        return _Read(file, contents, how, arranged(frames, axes, "the table", frames=True), columns, values)
    return _of_long_table(_Read(file, contents, how, Signal(frames), columns, values), first)


def _of_long_table(read: _Read, first: FirstColumns) -> _Read:
    """Samples of a table with a row for each of a taxel."""
    how, frames = read.how, np.asarray(read.signal.samples)
    key, column = option("taxel"), read.contents.named(filled(how.taxel or "", read.file.fields))
    if len(read.names) != 1 or how.axes is not None:
        what = "no axes (--axes)" if how.axes is not None else f"one column in taxels (--taxels), not {len(read.names)}"
        raise InputError(f"{key}: a table with a row for each sample of each taxel has {what}.")
    columns = {name: of for name, of in read.values.items() if isinstance(of, np.ndarray) and len(of) == len(frames)}
    taxel = columns.pop(column)
    names, at = widened(taxel, columns, read.contents.place, key)
    first |= {} if first else dict.fromkeys(names, "")
    if set(first) != set(names):
        raise InputError(f"{key}: taxels are {', '.join(names)[:100]}, of the first file {', '.join(first)[:100]}.")
    samples = np.ascontiguousarray(frames[:, 0][at].T)
    values = {**read.values, **{name: of[at[0]] for name, of in columns.items()}}
    return replace(read, signal=Signal(samples), values=values, at=at)


def _of_arrays(file: SourceFile, names: Sequence[str], contents: Contents, how: TapMap, tables: LabelTables) -> _Read:
    """Samples of one array, or of several side by side."""
    further = _further(how, sources_of(how, file.fields), file, contents, tables)
    values, _ = contents.read([*dict.fromkeys([*names, *further])])
    frames = how.tap is not None or how.trigger is not None
    signal = side_by_side([arranged(values[name], how.axis_names, name, frames) for name in names], names)
    if how.taxels is not None:
        signal = signal.with_taxels(taxel_slice(how))
    return _Read(file, contents, how, signal, names, values)


def _further(
    how: TapMap, sources: Mapping[str, LabelSource], file: SourceFile, contents: Contents, tables: LabelTables
) -> list[str]:
    """Variables that are needed beside the samples."""
    found = needed(list(sources.values()), file, contents, tables)
    named = {"time": how.time, "taxel": how.taxel, "keep": condition(how)[0], "signal": how.signal} | _tables(how)
    for key, name in [*named.items(), *(("tap", name) for name in tap_columns(how))]:
        if name:
            with naming(option(key)):
                found.append(contents.named(filled(name, file.fields)))
    return [*dict.fromkeys(found)]


def _piece(read: _Read, tables: LabelTables, missing: Missing) -> Piece:
    """The piece, its frames divided into taps where the map says how."""
    file, contents, how = read.file, read.contents, read.how
    whole, sources = len(read.signal.samples), sources_of(how, file.fields)
    rows = _rows(read, sources, tables)
    starts = None if read.signal.cut else _starts(read, rows)
    if how.keep is not None:
        mask = kept(how, np.asarray(read.of(condition(how)[0])), whole)
        rows = rows.select(mask, rows.signal.select(mask))
        starts = None if starts is None else among_kept(starts, rows.which, whole)
    rows = replace(rows, signal=_checked(read, rows, missing))
    _check_rows(read, rows, starts)
    rate = None if rows.time_s is None else _rate(rows.time_s, rows.signal, starts)
    if starts is not None:
        rows = rows.select(starts, Signal(split_frames(np.asanyarray(rows.signal.samples), starts)))
    listed = {key: np.asarray(read.of(name)) for key, name in _tables(how).items()}
    units = _label_units(sources, file, contents)
    return Piece(
        file, rows.signal, rows.labels, rate, read.unit, listed, rows.time_s, units, rows.rises, rows.which, whole
    )


def _rows(read: _Read, sources: Mapping[str, LabelSource], tables: LabelTables) -> _Rows:
    """All rows or taps of a file."""
    how, whole = read.how, len(read.signal.samples)
    labels: dict[str, Label] = {}
    for key, source in sources.items():
        label = label_of(source, read.file, read.contents, read.values, tables, whole)
        labels[key] = as_known(label) if key.startswith(EXTRA) and isinstance(label, np.ndarray | str) else label
    numbers = () if _has_ends(how) else tuple(np.asarray(read.of(column)) for column in tap_columns(how))
    rises = None if how.signal is None else np.asarray(read.of(how.signal))
    return _Rows(read.signal, np.arange(whole), labels, _times(read), rises, numbers)


def _has_ends(how: TapMap) -> bool:
    return isinstance(how.tap, str) and how.tap.startswith("ends:")


def _starts(read: _Read, rows: _Rows) -> NDArray[np.intp] | None:
    """First row of each tap, kept or not; `None` for a stream."""
    ends = np.asarray(read.of(tap_columns(read.how)[0])) if _has_ends(read.how) else None
    return tap_starts(len(rows.which), read.how, rows.numbers, ends)


def _checked(read: _Read, rows: _Rows, missing: Missing) -> Signal:
    """The samples as floats."""
    samples, name, place = rows.signal.samples, read.names[0], read.place_of_sample(rows.which)
    if not isinstance(samples, list):
        return replace(rows.signal, samples=as_samples(name, samples, missing, place))
    places = (lambda index, row=row: place((row, *index)) for row in range(len(samples)))
    taps = [as_samples(name, tap, missing, each) for tap, each in zip(samples, places, strict=True)]
    return replace(rows.signal, samples=taps)


def _check_rows(read: _Read, rows: _Rows, starts: NDArray[np.intp] | None) -> None:
    """Checks the rows that are kept, and that they are divided into taps once at most."""
    how = read.how
    if rows.signal.cut:
        if how.tap is not None:
            raise InputError(f"tap (--tap) {how.tap!r} divides rows into taps, but {how.taps} has an axis of taps.")
        return

    def place(row: int) -> str:
        return read.place(int(rows.which[row]))

    if starts is not None and rows.numbers:
        check_numbers(how, rows.numbers, starts, rows.labels, place)
    check_labels(how, rows.labels, len(rows.which), starts, place)


def _label_units(sources: Mapping[str, LabelSource], file: SourceFile, contents: Contents) -> dict[str, str]:
    """Units of labels that are columns or arrays, as they or their names state them."""
    names = {key: filled(of.name, file.fields) for key, of in sources.items() if of.kind == "column"}
    full = {key: contents.named(name) for key, name in names.items() if name not in contents.attributes}
    return {key: contents.variables[name].unit or unit_at_end(name, LENGTHS_AND_ANGLES) for key, name in full.items()}


def _tables(how: TapMap) -> dict[str, str]:
    named = {"what_names": how.what_names, "where_values": how.where_values}
    texts = {key: name for key, name in named.items() if isinstance(name, str)}
    return {key: name for key, name in texts.items() if label_source(key, name).kind == "column"}


def _times(read: _Read) -> NDArray[np.float64] | None:
    """Times in seconds."""
    how = read.how
    if how.time is None:
        return None
    found = read.of(how.time)
    if isinstance(found, list):
        raise InputError(f"time (--time): {how.time} has elements of different lengths; give the rate with --rate.")
    try:
        numbers = found.astype(np.float64)
    except ValueError:
        return _clock(found, how.time)
    named = read.contents.named(filled(how.time, read.file.fields))
    rows, samples = len(read.signal.samples), {len(tap) for tap in read.signal.samples if read.signal.cut}
    if numbers.shape not in {(rows,), *((J,) for J in samples), *((rows, J) for J in samples)}:
        raise InputError(f"time (--time): {named} has shape {numbers.shape}, expected one value for each row or tap.")
    unit = how.time_unit or read.contents.variables[named].unit or unit_at_end(named, _UNITS) or "s"
    if unit not in _UNITS:
        raise InputError(f"time (--time): {named} is in {unit!r}; say its unit with --time-unit s, ms, us or ns.")
    return numbers * _UNITS[unit]


def _clock(texts: NDArray[Any], name: str) -> NDArray[np.float64]:
    """Seconds since 1970 from dates with times."""
    try:
        times = texts.astype("datetime64[ns]")
    except ValueError:
        wanted = "numbers or times such as 2026-11-26 10:00:00.25"
        raise InputError(f"time (--time): {name} holds texts such as {texts.flat[0]!s:.40}, not {wanted}.") from None
    return np.where(np.isnat(times), np.nan, times.astype(np.int64) / 1e9)


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
