"""What is read of a file: its samples, and the variables that hold labels."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..recording import naming
from .columns import FirstColumns, agreeing, column_grid, taxel_columns, taxel_slice
from .files import SourceFile
from .formats.contents import Contents, Several, Values, with_clocks
from .label_tables import LabelTables
from .label_values import as_texts
from .labels import ByOrder, Label, LabelSource, label_source
from .long_table import widened
from .mapping import EXTRA, LABELS, PLANE, TapMap, option
from .patterns import compiled_pattern, filled, is_pattern
from .rows import condition, tap_columns
from .signal import Signal, arranged, from_texts, side_by_side


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


def needed(sources: Sequence[LabelSource], file: SourceFile, contents: Contents, tables: LabelTables) -> list[str]:
    """Variables of a file that hold labels, or that a table of labels has as well."""
    found = []
    for source in sources:
        with naming(option(source.key)):
            if source.kind == "column":
                name = name_of(source.name, file, contents)
                found += [] if name in contents.attributes else [contents.named(name)]
            elif source.kind == "table":
                found += tables.needed(source, file, contents)
    return found


def label_of(source: LabelSource, read: "FileRead", tables: LabelTables) -> Label:
    """A label of the taps or rows of a file.

    Raises:
        InputError: It is nowhere, or differs in shape between rows; the message names the key.
    """
    with naming(option(source.key)):
        match source.kind:
            case "constant":
                return source.name
            case "field":
                if source.name not in read.file.fields:
                    raise InputError(f"no pattern gives the name of this file a field {{{source.name}}}.")
                return read.file.fields[source.name]
            case "table":
                return tables.label(source, read.file, len(read.signal.samples), read.contents, read.values)
            case "file":
                return tables.numbers[read.file.path]
            case "gap":
                return ""
            case _:
                return _in_file(name_of(source.name, read.file, read.contents), read, source.key)


def name_of(template: str, file: SourceFile, contents: Contents) -> str:
    """A name with the fields put in; a pattern stands for what is at the array of the piece or in a group around it."""
    name = filled(template, file.fields)
    if not is_pattern(name) or name in contents.variables or not file.array:
        return name
    pattern = compiled_pattern(name, template)
    there = (each for each in (*contents.attributes, *contents.variables) if pattern.fullmatch(each))
    near = [each for each in there if f"{file.array}/".startswith(f"{_node(each)}/")]
    return near[0] if len(near) == 1 else name


def _node(name: str) -> str:
    """The array or group that an attribute belongs to, or the group that an array is in."""
    return name.partition("@")[0] if "@" in name else name.rpartition("/")[0]


def _in_file(name: str, read: "FileRead", key: str) -> Label:
    """An attribute, or the values of a column or array, which may have the axes of the taps, or be one-hot."""
    contents = read.contents
    if name in contents.attributes and name not in contents.variables:
        value = contents.attributes[name]
        if not isinstance(value, Several):
            return value
        found: Values = np.array(value.values)
    else:
        found = read.values[contents.named(name)]
    if key in ("what", "where") and (index := _one_hot(found, (len(read.signal.samples), read.arrays))) is not None:
        found = index + read.how.one_based
    found = _of_taps(found, name, read.signal)
    if found.ndim > 1:
        raise InputError(f"{name} has shape {found.shape}, expected one value for each tap.")
    if len(found) == read.arrays > 1 and (read.how.tap == "file" or len(found) != len(read.signal.samples)):
        return ByOrder(found, f"{read.file.path}: {name}", (str(read.file.path), name))
    return found if found.size != 1 else found.reshape(-1)[0].item()


def _of_taps(found: Values, name: str, signal: Signal) -> NDArray[Any]:
    """Values that have the axes or the elements of the taps as one for each tap, shape (n,); others as they are."""
    if isinstance(found, list):
        if [each.size for each in found] != list(signal.counts):
            raise InputError(f"{name} has elements of different shapes, so it has no value for each tap.")
        return np.concatenate([each.reshape(-1) for each in found])
    if found.size == max(found.shape, default=1) or found.shape == signal.lengths:
        found = found.reshape(-1)
    one_each = found.ndim == 1 and len(found) == len(signal.counts) < len(signal.samples)
    return np.repeat(found, signal.counts) if one_each else found


def _one_hot(found: Values, counts: Sequence[int]) -> NDArray[np.intp] | None:
    """Which entry of each row is 1 and all others 0; `None` for other values, or another number of rows."""
    if (
        isinstance(found, list)
        or found.ndim != 2
        or found.shape[1] < 2
        or len(found) not in counts
        or found.dtype.kind not in "fiub"
    ):
        return None
    ones = found == 1
    return ones.argmax(axis=1) if (ones | (found == 0)).all() and (ones.sum(axis=1) == 1).all() else None


@dataclass(frozen=True, eq=False)
class FileRead:
    """What was read of a file for a piece.

    Attributes:
        file: The file.
        contents: What it holds.
        how: The map.
        signal: The samples.
        names: Their columns or arrays.
        values: The variables beside them.
        at: Rows of each taxel, shape (K, rows), of a long table.
        table_axes: Axes of the rows of a table, and of its columns; of the latter those of taxels change first.
        arrays: How many arrays of the file are read, one after the other.
    """

    file: SourceFile
    contents: Contents
    how: TapMap
    signal: Signal
    names: Sequence[str]
    values: Mapping[str, Values]
    at: NDArray[np.intp] | None = None
    table_axes: tuple[str, ...] = ()
    arrays: int = 1

    def of(self, name: str) -> Values:
        """The variable that a key of the map names."""
        return self.values[self.contents.named(name_of(name, self.file, self.contents))]

    def column(self, name: str) -> NDArray[Any]:
        """The variable that a key of the map names, one value for each row or tap where it has their axes.

        Raises:
            InputError: Its elements differ in shape, and otherwise than those of the samples.
        """
        full = name_of(name, self.file, self.contents)
        if full in self.contents.attributes and full not in self.contents.variables:
            value = self.contents.attributes[full]
            rows = len(self.signal.samples)
            return np.array(value.values) if isinstance(value, Several) else np.repeat(np.array(value), rows)
        return _of_taps(self.of(name), name, self.signal)

    def listed(self, name: str) -> NDArray[Any]:
        """Names or positions in the file, of an attribute too; those of one text are between its commas."""
        name = name_of(name, self.file, self.contents)
        value = self.contents.attributes.get(name)
        if value is None or name in self.contents.variables:
            return np.asarray(self.of(name))
        if isinstance(value, Several):
            return np.array(value.values)
        return np.array([part.strip() for part in value.split(",")] if isinstance(value, str) else [value])

    @property
    def unit(self) -> str:
        """Unit of the samples, if the file states one for all."""
        units = {self.contents.variables[name].unit for name in self.names}
        return units.pop() if len(units) == 1 else ""

    @property
    def of_rows(self) -> list[str]:
        """Variables that have a value for each row, so far as they are no list or clock."""
        how = self.how
        ends = tap_columns(how) if isinstance(how.tap, str) and how.tap.startswith("ends:") else ()
        others = filter(None, (how.time, *how.taxel_columns, *ends, *tables_of(how).values()))
        full = [name_of(name, self.file, self.contents) for name in others]
        apart = {*self.names, *(self.contents.named(name) for name in full if name not in self.contents.attributes)}
        return [name for name in self.values if name not in apart and self.contents.clock(name) != name]

    def place(self, row: int) -> str:
        """Where a row or tap stands."""
        return self.contents.place(row if self.at is None else int(self.at[0, row]))

    def place_of_sample(self, which: NDArray[np.intp]) -> Callable[[tuple[int, ...]], str]:
        """Where a sample stands, by its index among those rows or taps of the file."""

        def place(index: tuple[int, ...]) -> str:
            row, *inside = int(which[index[0]]), *index[1:]
            if self.at is not None:
                return f"{self.contents.place(int(self.at[inside[0], row]))}, column {self.names[0]}"
            if self.table_axes:
                roles = ("tap", "sample", "taxel") if len(index) > 2 else ("sample", "taxel")
                number = dict[str, int](zip(roles, (row, *inside), strict=True))
                along = [number[axis if axis in roles else "tap"] for axis in self.table_axes]
                taxels = self.signal.samples[0].shape[-1] if "taxel" in self.table_axes[2:] else 1
                column = along[1] * taxels + sum(along[2:])
                return f"{self.place(along[0])}, column {self.names[column]}"
            called = ("tap", "sample", "taxel") if len(index) > 2 else ("frame", "taxel")
            whose = f" of {self.names[0]}" if len(self.names) == 1 else ""
            return ", ".join(f"{name} {n}" for name, n in zip(called, (row, *inside), strict=True)) + whose

        return place


def of_columns(file: SourceFile, contents: Contents, how: TapMap, tables: LabelTables, first: FirstColumns) -> FileRead:
    """Samples whose taxels are columns; those of further files agree with the first ones."""
    sources = sources_of(how, file.fields)
    labels = needed(list(sources.values()), file, contents, tables)
    further = _further(how, sources, file, contents, tables)
    own = [of for key, of in sources.items() if not key.startswith(EXTRA)]
    also = (*tap_columns(how), *filter(None, (how.time, *how.taxel_columns)))
    also = [contents.named(name_of(name, file, contents)) for name in also]
    others = {*needed(own, file, contents, tables), *also}
    grid = column_grid(how, contents, others)
    columns = taxel_columns(how, contents, others) if grid is None else grid.names
    if how.taxel is None and (grid is None or grid.along == "sample"):
        columns = agreeing(columns, contents, how, first)
    further = with_clocks(further, columns[:1], contents)
    numbers = [name for name in further if name not in labels and contents.variables[name].dtype == np.float64]
    numbers = [name for name in numbers if contents.clock(name) in map(contents.clock, columns[:1])]
    beside = [*columns, *(name for name in numbers if contents.variables[name].shape[1:] == ())]
    values, frames = contents.read([name for name in further if name not in beside[len(columns) :]], beside)
    if frames is None:
        raise InputError("no taxels: say which columns they are with taxels (--taxels).")
    values |= {name: frames[:, len(columns) + n] for n, name in enumerate(beside[len(columns) :])}
    axes, frames = how.axis_names, frames[:, : len(columns)]
    if axes is not None and len(axes) != 2:
        raise InputError(f"axes (--axes) {how.axes!r}: rows and columns are two axes.")
    if grid is not None:
        axes = ("tap", "sample", "taxel") if grid.along == "sample" else ("sample", "tap", "taxel")
        return FileRead(file, contents, how, grid.taps(frames), columns, values, table_axes=axes)
    if how.taxel is None:
        taps = arranged(frames, axes, "the table", frames=True)
        return FileRead(file, contents, how, taps, columns, values, table_axes=axes or ("sample", "taxel"))
    return _of_long_table(FileRead(file, contents, how, Signal(frames), columns, values), first)


def _of_long_table(read: FileRead, first: FirstColumns) -> FileRead:
    """Samples of a table with a row for each of a taxel."""
    how, frames = read.how, np.asarray(read.signal.samples)
    key = option("taxel")
    if len(read.names) != 1 or how.axes is not None:
        what = "no axes (--axes)" if how.axes is not None else f"one column in taxels (--taxels), not {len(read.names)}"
        raise InputError(f"{key}: a table with a row for each sample of each taxel has {what}.")
    columns = {name: of for name, of in read.values.items() if isinstance(of, np.ndarray) and len(of) == len(frames)}
    told = [columns.pop(read.contents.named(name_of(name, read.file, read.contents))) for name in how.taxel_columns]
    taxel = told[0] if len(told) == 1 else np.array(list(map(" ".join, zip(*map(as_texts, told), strict=True))))
    names, at = widened(taxel, columns, read.contents.place, key)
    first |= {} if first else dict.fromkeys(names, "")
    if set(first) != set(names):
        raise InputError(f"{key}: taxels are {', '.join(names)[:100]}, of the first file {', '.join(first)[:100]}.")
    samples = np.ascontiguousarray(frames[:, 0][at].T)
    values = {**read.values, **{name: of[at[0]] for name, of in columns.items()}}
    return replace(read, signal=Signal(samples), values=values, at=at)


def of_arrays(
    file: SourceFile, names: Sequence[str], contents: Contents, how: TapMap, tables: LabelTables, arrays: int
) -> FileRead:
    """Samples of one of some arrays of a file, or of several side by side."""
    further = with_clocks(_further(how, sources_of(how, file.fields), file, contents, tables), names[:1], contents)
    values, _ = contents.read([*dict.fromkeys([*names, *further])])
    frames = how.tap is not None or how.trigger is not None
    shapes = {name: contents.variables[name].shape for name in names}
    if contents.table:
        values |= {name: from_texts(values[name], name, contents.place) for name in names}
    signals = [arranged(values[name], how.axis_names, name, frames, shapes[name]) for name in names]
    signal = side_by_side(signals, names)
    if how.taxels is not None:
        signal = signal.with_taxels(taxel_slice(how))
    return FileRead(file, contents, how, signal, names, values, arrays=arrays)


def _further(
    how: TapMap, sources: Mapping[str, LabelSource], file: SourceFile, contents: Contents, tables: LabelTables
) -> list[str]:
    """Variables that are needed beside the samples."""
    found = needed(list(sources.values()), file, contents, tables)
    named = {
        "time": how.time,
        "keep": condition(how.keep)[0],
        "signal": condition(how.signal)[0],
    } | tables_of(how)
    several = [*(("tap", name) for name in tap_columns(how)), *(("taxel", name) for name in how.taxel_columns)]
    for key, name in [*named.items(), *several]:
        if name:
            with naming(option(key)):
                full = name_of(name, file, contents)
                if key not in ("what_names", "where_values", "keep") or full not in contents.attributes:
                    found.append(contents.named(full))
    return [*dict.fromkeys(found)]


def tables_of(how: TapMap) -> dict[str, str]:
    """Arrays of the file that hold names or positions which labels index, or presses, by key of the map."""
    named = {"what_names": how.what_names, "where_values": how.where_values, "events": how.events}
    texts = {key: name for key, name in named.items() if isinstance(name, str)}
    return {key: name for key, name in texts.items() if label_source(key, name).kind == "column"}
