"""Parquet, Arrow and Feather files by pyarrow, which not every installation has."""

from collections.abc import Iterator, Sequence
from math import prod
from pathlib import Path
from typing import Any, override

import numpy as np
from numpy.typing import NDArray

from ....blocks import BLOCK
from ....errors import InputError
from ....extras import extra
from ...untrusted import read_first
from .columns import Part, gathered, stacked
from .contents import Contents, TextTable, Values, Variable, name_and_unit

_PARQUET, _IPC, _OLD = b"PAR1", b"ARROW1", b"FEA1"
_ROWS = 1 << 16
_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def open_columnar(path: Path, how: TextTable) -> Contents:  # noqa: ARG001 - as the other readers
    """A Parquet file, an Arrow file or stream, or a Feather file of version 2.

    Times are seconds, those of a day since 1970 in UTC, and dates are texts such as `2026-01-31`.

    Raises:
        InputError: pyarrow is not installed, or the file is damaged or of another format.
    """
    with extra("pyarrow"):
        import pyarrow  # noqa: F401, ICN001, PLC0415
    try:
        with path.open("rb") as file:
            begin = file.read(len(_IPC))
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}.") from error
    if begin.startswith(_OLD):
        raise InputError("a Feather file of version 1, which is not read; write it again as version 2.")
    if not read_first("columnar", path):
        raise InputError("not a Parquet, Arrow or Feather file, or damaged.")
    return ColumnarContents(path, begin)


class ColumnarContents(Contents):
    """Columns of a Parquet or Arrow table; fields of structs, also of those in lists, are columns of their own."""

    table = True

    def __init__(self, path: Path, begin: bytes) -> None:
        import pyarrow as pa  # noqa: PLC0415

        self.path, self.attributes = path, {}
        self._parquet, self._stream = begin.startswith(_PARQUET), begin != _IPC
        try:
            schema, length = self._schema()
        except (pa.ArrowException, OSError) as error:
            raise InputError(f"damaged: {_said(error)}.") from error
        self.variables, self.unreadable, self._paths = {}, {}, {}
        for field in schema:
            for path_, dims, kind in _leaves(field.type, (field.name,)):
                name, dtype = ".".join(path_), _dtype(kind)
                if name in self.variables or schema.names.count(field.name) > 1:
                    self.unreadable[name] = "several columns have this name"
                elif dtype is None:
                    self.unreadable[name] = f"values of type {kind}"
                else:
                    self._paths[name] = path_
                    self.variables[name] = Variable((length, *dims), dtype, _unit(name, kind))

    @override
    def read(self, names: Sequence[str], columns: Sequence[str] = ()) -> tuple[dict[str, Values], NDArray[Any] | None]:
        import pyarrow as pa  # noqa: PLC0415

        asked, numbers = [[self.named(name) for name in some] for some in (names, columns)]
        for name in numbers:
            if len(self.variables[name].shape) > 1 or self.variables[name].dtype.kind == "U":
                raise InputError(f"column {name} does not hold one number in each row.")

        def parts() -> Iterator[Part]:
            row = 0
            for batch in self._batches([self._paths[name][0] for name in (*asked, *numbers)]):
                table = np.empty((len(batch), len(numbers)))
                for j, name in enumerate(numbers):
                    table[:, j] = _values(batch, self._paths[name], row)
                yield Part([_values(batch, self._paths[name], row) for name in asked], table)
                row += len(batch)

        try:
            return gathered(parts, list(names), len(columns), self.most)
        except (pa.ArrowException, OSError) as error:
            raise InputError(f"damaged: {_said(error)}.") from error

    def _schema(self) -> tuple[Any, int | None]:
        """Schema, and the number of rows if it is known."""
        import pyarrow as pa  # noqa: PLC0415
        import pyarrow.parquet as pq  # noqa: PLC0415

        if self._parquet:
            with pq.ParquetFile(self.path) as table:
                return table.schema_arrow, table.metadata.num_rows
        with pa.OSFile(str(self.path)) as source:
            return (pa.ipc.open_stream if self._stream else pa.ipc.open_file)(source).schema, None

    def _batches(self, columns: list[str]) -> Iterator[Any]:
        """Record batches of these columns, of about 16 MiB."""
        import pyarrow as pa  # noqa: PLC0415
        import pyarrow.parquet as pq  # noqa: PLC0415

        columns = list(dict.fromkeys(columns))
        if self._parquet:
            with pq.ParquetFile(self.path, pre_buffer=False) as table:
                groups = [table.metadata.row_group(i) for i in range(table.metadata.num_row_groups)]
                size = sum(group.total_byte_size for group in groups) // max(1, table.metadata.num_rows)
                step = max(1, min(_ROWS, BLOCK // max(1, size)))
                yield from table.iter_batches(step, columns=columns)
            return
        with pa.memory_map(str(self.path)) as source:
            schema = self._schema()[0]
            how = pa.ipc.IpcReadOptions(included_fields=[schema.get_field_index(name) for name in columns])
            if self._stream:
                found: Any = pa.ipc.open_stream(source, options=how)
            else:
                table = pa.ipc.open_file(source, options=how)
                found = map(table.get_batch, range(table.num_record_batches))
            for batch in found:
                step = max(1, BLOCK * len(batch) // max(1, batch.nbytes))
                yield from (batch.slice(start, step) for start in range(0, len(batch), step))


def _leaves(kind: Any, path: tuple[str, ...], dims: tuple[int | None, ...] = ()) -> Iterator[tuple[Any, Any, Any]]:
    """Path, axes of an element, and type of all columns that are no structs."""
    from pyarrow import types  # noqa: PLC0415

    if types.is_struct(kind):
        for field in kind:
            yield from _leaves(field.type, (*path, field.name), dims)
    elif types.is_fixed_size_list(kind):
        yield from _leaves(kind.value_type, path, (*dims, kind.list_size))
    elif _is_list(kind):
        yield from _leaves(kind.value_type, path, (*dims, None))
    else:
        yield path, dims, kind.value_type if types.is_dictionary(kind) else kind


def _is_list(kind: Any) -> bool:
    from pyarrow import types  # noqa: PLC0415

    return (
        types.is_list(kind) or types.is_large_list(kind) or types.is_list_view(kind) or types.is_large_list_view(kind)
    )


def _dtype(kind: Any) -> np.dtype[Any] | None:
    """Type of the values that are read; `None` for what is not."""
    from pyarrow import types  # noqa: PLC0415

    if _is_text(kind) or types.is_date(kind):
        return np.dtype(np.str_)
    if types.is_integer(kind) or types.is_floating(kind):
        return np.dtype(kind.to_pandas_dtype())
    numbers = types.is_boolean(kind) or types.is_decimal(kind) or types.is_null(kind) or _is_time(kind)
    return np.dtype(np.float64) if numbers else None


def _is_text(kind: Any) -> bool:
    from pyarrow import types  # noqa: PLC0415

    return types.is_string(kind) or types.is_large_string(kind) or types.is_string_view(kind)


def _is_time(kind: Any) -> bool:
    from pyarrow import types  # noqa: PLC0415

    return types.is_timestamp(kind) or types.is_time(kind) or types.is_duration(kind)


def _unit(name: str, kind: Any) -> str:
    return "s" if _is_time(kind) else name_and_unit(name)[1]


def _values(batch: Any, path: tuple[str, ...], row: int) -> Values:
    """Values of a column of a batch, which begins at this row."""
    import pyarrow.compute as pc  # noqa: PLC0415
    from pyarrow import types  # noqa: PLC0415

    array, rest, lengths = batch.column(batch.schema.get_field_index(path[0])), path[1:], []
    array.validate(full=True)
    rows = np.arange(row, row + len(batch))
    while (nested := types.is_struct(array.type)) or _is_list(array.type) or types.is_fixed_size_list(array.type):
        if nested:
            array, rest = pc.struct_field(array, [array.type.get_field_index(rest[0])]), rest[1:]  # pyright: ignore[reportAttributeAccessIssue]
            continue
        _check_there(array, rows, path)
        lengths.append(pc.list_value_length(array).to_numpy(zero_copy_only=False))  # pyright: ignore[reportAttributeAccessIssue]
        rows, array = np.repeat(rows, lengths[-1]), array.flatten()
    flat = _flat(array, rows, path)
    return _elements(flat, lengths, row, path) if lengths else flat


def _check_there(array: Any, rows: NDArray[np.int64], path: tuple[str, ...]) -> None:
    if array.null_count:
        missing = np.flatnonzero(array.is_null().to_numpy(zero_copy_only=False))[0]
        raise InputError(f"row {rows[missing] + 1}, column {'.'.join(path)}: missing.")


def _flat(array: Any, rows: NDArray[np.int64], path: tuple[str, ...]) -> NDArray[Any]:
    """Numbers and texts of an array without lists."""
    from pyarrow import types  # noqa: PLC0415

    if types.is_dictionary(array.type):
        array = array.dictionary_decode()
    if types.is_date(array.type):
        array = array.cast("string")
    kind = array.type
    if _is_text(kind):
        _check_there(array, rows, path)
        return np.array(array.to_pylist(), np.str_)
    if _is_time(kind):
        bits = "int32" if types.is_time32(kind) else "int64"
        return array.cast(bits).cast("float64", safe=False).to_numpy(zero_copy_only=False) / _PER_SECOND[kind.unit]
    if array.null_count or not (types.is_integer(kind) or types.is_floating(kind)):
        array = array.cast("float64", safe=False)
    return array.to_numpy(zero_copy_only=False)


def _elements(flat: NDArray[Any], lengths: list[NDArray[Any]], row: int, path: tuple[str, ...]) -> Values:
    """Elements of lists of these lengths at each depth."""
    if all(len(each) and (each == each[0]).all() for each in lengths):
        return flat.reshape(len(lengths[0]), *(each[0] for each in lengths))
    ends = [np.concatenate(([0], np.cumsum(each))) for each in lengths]
    found = []
    for i in range(len(lengths[0])):
        first, last, shape = i, i + 1, []
        for each, end in zip(lengths, ends, strict=True):
            own = each[first:last]
            if len(own) and (own != own[0]).any():
                raise InputError(f"row {row + i + 1}, column {'.'.join(path)}: its inner lists differ in length.")
            shape.append(int(own[0]) if len(own) else 0)
            first, last = end[first], end[last]
        found.append(flat[first:last].reshape(shape) if prod(shape) else np.empty(shape, flat.dtype))
    return stacked(found) if found else flat


def _said(error: BaseException) -> str:
    return str(error).split("\n", 1)[0].rstrip(".")
