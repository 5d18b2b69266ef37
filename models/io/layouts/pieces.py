"""Pieces of a recording: the taps or frames of one file or array, with their labels as they stand there."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cutting.sampling_rate import Pace
from ...errors import InputError
from ...settings import Missing
from ..recording import as_samples, naming
from .columns import FirstColumns
from .files import SourceFile
from .formats.contents import Contents, in_step, unit_at_end
from .formats.registry import open_contents
from .label_tables import LabelTables
from .label_values import LENGTHS_AND_ANGLES, as_known
from .labels import Label, LabelSource
from .mapping import EXTRA, TapMap, option
from .patterns import compiled_pattern, filled, is_pattern, natural
from .reading import FileRead, label_of, name_of, of_arrays, of_columns, sources_of, tables_of
from .rows import among_kept, check_labels, check_numbers, condition, holds, signal_at, tap_columns, tap_starts
from .signal import Signal, split_frames
from .times import pace_of, times_of


@dataclass(frozen=True, eq=False)
class Piece:
    """Taps or frames of one file or array.

    Attributes:
        file: Where they come from; its fields include those of the array's name.
        signal: The samples.
        labels: Values of each tap or row, or the same for all.
        pace: Of its samples by their times, `None` without.
        unit: Of its samples, as the file states it.
        tables: Names, positions and presses that are in the file, by key of the map.
        time_s: Times of its rows or taps, if known.
        time_unit: Unit in which these are written.
        label_units: Units of its labels and presses, as the file states them.
        rises: Signal that rises at each press, shape (rows,).
        row: Number of the row or tap of the file that each one begins with, shape (rows,).
        numbers: Of the tap of each, as columns tell.
        whole: Number of rows or taps of the file, kept or not.
        among: Number of each tap among all those of the file, kept or not, where rows are divided into taps.
        every: How many these are.
        told: What of the file is left out, and how labels were found, one sentence each.
    """

    file: SourceFile
    signal: Signal
    labels: Mapping[str, Label]
    pace: Pace | None = None
    unit: str = ""
    tables: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    time_s: NDArray[np.float64] | None = None
    time_unit: str = ""
    label_units: Mapping[str, str] = field(default_factory=dict)
    rises: NDArray[Any] | None = None
    row: NDArray[np.intp] = field(default_factory=lambda: np.arange(0))
    numbers: tuple[NDArray[Any], ...] = ()
    whole: int = 0
    among: NDArray[np.intp] = field(default_factory=lambda: np.arange(0))
    every: int = 0
    told: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        """Number of taps or frames."""
        return len(self.signal.samples)

    def labels_at(self, rows: NDArray[np.intp], **labels: Label) -> "Piece":
        """Some of its taps or frames without their samples, with other labels where they are given."""
        if not labels:
            own = self.labels.items()
            labels = {key: of[rows] if isinstance(of, np.ndarray) and len(of) == self.rows else of for key, of in own}
        index = {key: of[rows] for key, of in self.signal.axis_index.items()}
        times = self.time_s[rows] if self.time_s is not None and len(self.time_s) == self.rows else None
        nothing = Signal(np.empty((len(rows), 1, 1)), index)
        return replace(self, signal=nothing, labels=labels, time_s=times, row=self.row[rows])


def pieces(files: Sequence[SourceFile], how: TapMap, tables: LabelTables, missing: Missing) -> Iterator[Piece]:
    """The pieces of all files, in their order; their samples are floats, which `missing` allows to be NaN.

    Raises:
        InputError: A file cannot be read as the map says; the message names it.
    """
    first: dict[str, FirstColumns] = {}
    for file in files:
        contents = open_contents(file.path, how.text_table, how.format)
        contents.without_cut = True
        with naming(file.path):
            alone = _only_array(contents) if how.taps is None else None
            if how.taps is None and alone is None:
                columns = first.setdefault(file.fields.get("taxel", ""), {})
                yield _piece(of_columns(file, contents, how, tables, columns), tables, missing)
            else:
                arrays = _arrays(how.taps or alone or "", file, contents)
                for names, fields in arrays:
                    whose = replace(file, fields=file.fields | fields, array=names[0])
                    yield _piece(of_arrays(whose, names, contents, how, tables, len(arrays)), tables, missing)


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
        time_unit: Unit in which times are written.
    """

    signal: Signal
    which: NDArray[np.intp]
    labels: Mapping[str, Label]
    time_s: NDArray[np.float64] | None
    rises: NDArray[Any] | None
    numbers: tuple[NDArray[Any], ...]
    time_unit: str

    def places(self, read: FileRead) -> Callable[[int], str]:
        """Where each of the rows stands."""
        return lambda row: read.place(int(self.which[row]))

    def select(self, rows: NDArray[Any], signal: Signal) -> "_Rows":
        """Some rows alone, with their samples."""

        def some(of: Any) -> Any:
            return of[rows] if isinstance(of, np.ndarray) and len(of) == len(self.which) else of

        labels = {key: some(of) for key, of in self.labels.items()}
        numbers = tuple(map(some, self.numbers))
        return _Rows(signal, self.which[rows], labels, some(self.time_s), some(self.rises), numbers, self.time_unit)


def _piece(read: FileRead, tables: LabelTables, missing: Missing) -> Piece:
    """The piece, its frames divided into taps where the map says how."""
    file, contents, how = read.file, read.contents, read.how
    whole, sources = len(read.signal.samples), sources_of(how, file.fields)
    stepped = in_step(read.values, read.of_rows, read.names[0], contents, whole)
    read = replace(read, values=stepped.values)
    rows = _rows(read, sources, tables)
    starts = every = None if read.signal.cut else _starts(read, rows)
    if starts is not None:
        rows = replace(rows, labels=_of_rows(rows.labels, starts, whole))
    if how.keep is not None or stepped.known is not None:
        mask = (
            np.ones(whole, dtype=bool)
            if how.keep is None
            else holds(how, "keep", read.column(condition(how.keep)[0]), whole)
        )
        mask = mask if stepped.known is None else mask & stepped.known
        rows = rows.select(mask, rows.signal.select(mask))
        starts = None if starts is None else among_kept(starts, rows.which, whole)
    rows = replace(rows, signal=_checked(read, rows, missing))
    _check_rows(read, rows, starts)
    found = None if rows.time_s is None else pace_of(rows.time_s, rows.signal, starts, rows.places(read))
    if starts is not None:
        rows = rows.select(starts, Signal(split_frames(np.asanyarray(rows.signal.samples), starts)))
    listed = {key: read.listed(name) for key, name in tables_of(how).items()}
    units = _label_units(sources, file, contents, tables)
    if "events" in listed:
        units["events"] = contents.variables[contents.named(filled(how.events or "", file.fields))].unit
    return Piece(
        file,
        rows.signal,
        rows.labels,
        found,
        read.unit,
        listed,
        rows.time_s,
        rows.time_unit,
        units,
        rows.rises,
        rows.which,
        rows.numbers,
        whole,
        np.arange(0) if every is None else np.searchsorted(every, rows.which, "right") - 1,
        0 if every is None else len(every),
        (*([f"{file.path}: {contents.damage}"] if contents.damage else []), *contents.told, *stepped.told),
    )


def _rows(read: FileRead, sources: Mapping[str, LabelSource], tables: LabelTables) -> _Rows:
    """All rows or taps of a file."""
    how, whole = read.how, len(read.signal.samples)
    labels: dict[str, Label] = {}
    for key, source in sources.items():
        label = label_of(source, read, tables)
        labels[key] = as_known(label) if key.startswith(EXTRA) and isinstance(label, np.ndarray | str) else label
    numbers = () if _has_ends(how) else tuple(read.column(column) for column in tap_columns(how))
    rises = None
    if how.signal is not None:
        rises = signal_at(how, read.column(condition(how.signal)[0]), whole)
    times, unit = times_of(read)
    return _Rows(read.signal, np.arange(whole), labels, times, rises, numbers, unit)


def _has_ends(how: TapMap) -> bool:
    return isinstance(how.tap, str) and how.tap.startswith("ends:")


def _starts(read: FileRead, rows: _Rows) -> NDArray[np.intp] | None:
    """First row of each tap, kept or not; `None` for a stream."""
    ends = read.column(tap_columns(read.how)[0]) if _has_ends(read.how) else None
    return tap_starts(len(rows.which), read.how, rows.numbers, ends)


def _of_rows(labels: Mapping[str, Label], starts: NDArray[np.intp], rows: int) -> dict[str, Label]:
    """Labels of each row, where there is one for each tap."""
    lengths = np.diff(starts, append=rows)
    by_tap = {key for key, of in labels.items() if isinstance(of, np.ndarray) and len(starts) == len(of) < rows}
    return {key: np.repeat(np.asarray(of), lengths) if key in by_tap else of for key, of in labels.items()}


def _checked(read: FileRead, rows: _Rows, missing: Missing) -> Signal:
    """The samples as floats."""
    samples, name, place = rows.signal.samples, read.names[0], read.place_of_sample(rows.which)
    if not isinstance(samples, list):
        return replace(rows.signal, samples=as_samples(name, samples, missing, place))
    places = (lambda index, row=row: place((row, *index)) for row in range(len(samples)))
    taps = [as_samples(name, tap, missing, each) for tap, each in zip(samples, places, strict=True)]
    return replace(rows.signal, samples=taps)


def _check_rows(read: FileRead, rows: _Rows, starts: NDArray[np.intp] | None) -> None:
    """Checks the rows that are kept, and that they are divided into taps once at most."""
    how = read.how
    if rows.signal.cut:
        if how.tap is not None and not (how.tap == "row" and read.contents.table):
            cut = how.taps or how.taxels
            raise InputError(
                f"tap (--tap) {how.tap!r} divides rows into taps, but {cut} has an axis of taps; leave it out."
            )
        return

    place = rows.places(read)
    if starts is not None and rows.numbers:
        check_numbers(how, rows.numbers, starts, rows.labels, place)
    check_labels(how, rows.labels, len(rows.which), starts, place)


def _label_units(
    sources: Mapping[str, LabelSource], file: SourceFile, contents: Contents, tables: LabelTables
) -> dict[str, str]:
    """Units of labels that are columns or arrays, of files or of tables, as they or their names state them."""
    found: dict[str, str] = {}
    for key, source in sources.items():
        if source.kind == "table":
            name, _, stated, *_ = tables.column(source, file)
        elif source.kind == "column" and (name := name_of(source.name, file, contents)) not in contents.attributes:
            name = contents.named(name)
            stated = contents.variables[name].unit
        else:
            continue
        found[key] = stated or unit_at_end(name, LENGTHS_AND_ANGLES)
    return found
