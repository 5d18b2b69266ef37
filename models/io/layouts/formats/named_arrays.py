"""Files of named arrays: their variables, each with what reads it, and what of their types is numbers or texts."""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .... import storage
from ....blocks import BLOCK
from ....errors import InputError
from ...untrusted import check_size
from .contents import Contents, Values, Variable

COMPLEX = "it holds complex numbers; save the real and the imaginary part as arrays of their own"
RAW = "it holds raw bytes, which are neither numbers nor texts"
PICKLED = (
    "it holds pickled objects, which are refused; save its elements as plain arrays, such as "
    "np.savez(path, **{f'taps_{n}': tap for n, tap in enumerate(taps)})"
)
TEXT = np.dtype(np.str_)


@dataclass(frozen=True)
class Stored:
    """A variable, and what reads it.

    Attributes:
        variable: What the file says of it.
        nbytes: Of all that is read for it, unpacked.
        load: Reads it from the open file; variables with the same one are parts of the same array.
        part: Takes it from that array.
        mapped: Whether a large array stays in the file or in a temporary one.
    """

    variable: Variable
    nbytes: int
    load: Callable[[Any], Values]
    part: Callable[[Any], Values] | None = None
    mapped: bool = True

    @property
    def in_memory(self) -> int:
        """Bytes of memory that it takes."""
        return 0 if self.mapped and self.nbytes > storage.ON_DISK else self.nbytes


class NamedArrays(Contents):
    """Arrays of a file, of which those that are asked for are read."""

    def __init__(
        self,
        path: Path,
        stored: Mapping[str, Stored],
        unreadable: Mapping[str, str],
        attributes: Mapping[str, str | float] | None = None,
        opened: Callable[[], AbstractContextManager[Any]] = nullcontext,
    ) -> None:
        """Contents of a file.

        Args:
            path: The file or folder.
            stored: Its arrays by name.
            unreadable: As of `Contents`.
            attributes: As of `Contents`.
            opened: Opens the file; what it gives is passed to what loads the arrays.
        """
        self.path, self.unreadable, self.attributes = path, unreadable, attributes or {}
        self.variables = {name: each.variable for name, each in stored.items()}
        self._stored, self._opened = stored, opened

    def read(self, names: Sequence[str], columns: Sequence[str] = ()) -> tuple[dict[str, Values], NDArray[Any] | None]:
        """As `Contents.read`."""
        wanted = [*dict.fromkeys([*names, *columns])]
        for name in wanted:
            if name in self.unreadable:
                raise InputError(f"array {name} cannot be read: {self.unreadable[name]}.")
            if name not in self._stored:
                raise InputError(f"no array {name}; the file holds: {', '.join(self._stored) or 'none'}.")
        _check_columns({name: self.variables[name] for name in columns})
        stored = {self._stored[name].load: self._stored[name] for name in wanted}.values()
        check_size(self.path, sum(each.nbytes for each in stored), sum(each.in_memory for each in stored))
        values = self._values(wanted)
        side_by_side = _side_by_side([values[name] for name in columns]) if columns else None
        return {name: values[name] for name in names}, side_by_side

    def _values(self, names: Sequence[str]) -> dict[str, Values]:
        found: dict[str, Values] = {}
        whole: dict[Callable[[Any], Values], Values] = {}
        name = ""
        try:
            with warnings.catch_warnings(action="ignore"), self._opened() as source:
                for name in names:
                    each = self._stored[name]
                    if each.part is None:
                        found[name] = each.load(source)
                        continue
                    if each.load not in whole:
                        whole[each.load] = each.load(source)
                    found[name] = each.part(whole[each.load])
        except InputError:
            raise
        except Exception as error:  # on damaged bytes these libraries raise almost any exception
            raise InputError(f"array {name} is damaged or cannot be read ({error}).") from error
        return found


def _check_columns(columns: Mapping[str, Variable]) -> None:
    for name, each in columns.items():
        if len(each.shape) != 1:
            raise InputError(f"array {name} has shape {each.shape}; a column has one axis.")
        if each.dtype.kind not in "fiub":
            raise InputError(f"array {name} holds texts, not numbers.")
    lengths = {each.shape[0]: name for name, each in columns.items()}
    if len(lengths) > 1:
        (one, first), (other, second), *_ = lengths.items()
        raise InputError(f"columns differ in length: {first} has {one} rows, {second} {other}.")


def _side_by_side(columns: Sequence[Values]) -> NDArray[np.float64]:
    """Columns as floats, shape (R, number of columns); in a temporary file if they are many."""
    arrays = list(map(np.asarray, columns))
    rows, width = len(arrays[0]), len(arrays)
    step = max(1, BLOCK // (8 * width))

    def part(start: int) -> NDArray[np.float64]:
        return np.stack([each[start : start + step].astype(np.float64) for each in arrays], axis=1)

    found = None
    if 8 * rows * width > storage.ON_DISK:
        blocks = (part(start).data for start in range(0, rows, step))
        found = storage.spooled(blocks, (rows, width), np.float64)
    return np.concatenate([part(start) for start in range(0, max(rows, 1), step)]) if found is None else found


def fields_of(
    name: str, shape: tuple[int, ...], dtype: np.dtype[Any], at: tuple[int, ...] = ()
) -> Iterator[tuple[str, tuple[int, ...], np.dtype[Any], tuple[int, ...]]]:
    """Fields of a structured type, also of those inside others: name, shape, type, and the way to it by numbers.

    The array itself, if its type has no fields.
    """
    if dtype.subdtype is not None:
        dtype, inner = dtype.subdtype
        shape = (*shape, *inner)
    if dtype.names is None:
        yield name, shape, dtype, at
        return
    for i, field in enumerate(dtype.names):
        yield from fields_of(f"{name}.{field}", shape, dtype[i], (*at, i))


def field_at(values: NDArray[Any], at: Sequence[int]) -> NDArray[Any]:
    """A field by the way to it."""
    for i in at:
        values = values[values.dtype.names[i]]  # pyright: ignore[reportOptionalSubscript]
    return values


def refusal(dtype: np.dtype[Any]) -> str:
    """Why no array of a type can be read, empty if one can."""
    return {"c": COMPLEX, "V": RAW, "O": PICKLED}.get(dtype.kind, "")


def stored(
    name: str, shape: tuple[int, ...], dtype: np.dtype[Any], load: Callable[[Any], Any], unit: str = ""
) -> tuple[dict[str, Stored], dict[str, str]]:
    """An array of plain numbers or texts, or each field of a structured one, and the fields that cannot be read.

    Times are seconds, since 1970 if they are dates.
    """
    found, unreadable = {}, {}
    nbytes = prod(shape) * dtype.itemsize
    for each, axes, kind, at in fields_of(name, shape, dtype):
        if why := refusal(kind):
            unreadable[each] = why
        else:
            variable = Variable(axes, plain_dtype(kind), "s" if kind.kind in "mM" else unit)
            found[each] = Stored(variable, nbytes, load, lambda values, at=at: plain(field_at(values, at)))
    return found, unreadable


def plain_dtype(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Type of numbers or texts as `plain` returns them."""
    return TEXT if dtype.kind in "SUT" else np.dtype(np.float64) if dtype.kind in "mM" else dtype


def plain(values: NDArray[Any]) -> NDArray[Any]:
    """Bytes and texts as `U`, times in seconds; other values as they are."""
    if values.dtype.kind in "mM":
        kind = np.dtype(f"{values.dtype.kind}8[ns]")
        if np.datetime_data(values.dtype)[0] == "generic":
            return np.where(np.isnat(values), np.nan, values.astype(np.int64))
        fine = values.astype(kind).astype(np.int64)
        return np.where(np.isnat(values), np.nan, fine / 1e9)
    return texts(values) if values.dtype.kind in "SOT" else values


def texts(values: NDArray[Any]) -> NDArray[np.str_]:
    """Bytes or objects as `U`, of the same shape."""
    decoded = [
        each.decode("utf-8", "replace") if isinstance(each, bytes) else str(each)
        for each in values.reshape(-1).tolist()
    ]
    return np.array(decoded, dtype=np.str_).reshape(values.shape)


def joined_letters(values: NDArray[Any]) -> NDArray[Any]:
    """Texts whose letters are along the last axis."""
    width = values.shape[-1]
    if not width or not values.size:
        return np.zeros(values.shape[:-1], "S1")
    return np.ascontiguousarray(values).view(f"S{width}")[..., 0]


def in_blocks(part: Callable[[slice], NDArray[Any]], length: int, nbytes: int, chunk: int = 1) -> Iterator[Any]:
    """Bytes of an array, read some rows of its first axis at a time.

    Args:
        part: Reads rows.
        length: How many rows there are.
        nbytes: Of all.
        chunk: Rows of a chunk of the file, to which the blocks are rounded.
    """
    step = -(-max(1, BLOCK * length // max(1, nbytes)) // chunk) * chunk
    for start in range(0, length, step):
        yield np.ascontiguousarray(part(slice(start, start + step))).data


def read_rows(
    part: Callable[[slice], NDArray[Any]], shape: tuple[int, ...], dtype: np.dtype[Any], chunk: int = 1
) -> NDArray[Any]:
    """An array of a file that is read by rows of its first axis; a large one in a temporary file.

    Args:
        part: Reads rows as this type.
        shape: Of the array, of at least one axis.
        dtype: Of the array.
        chunk: As of `in_blocks`.
    """
    nbytes = prod(shape) * dtype.itemsize
    if nbytes > storage.ON_DISK and not dtype.hasobject and dtype.kind != "T":
        found = storage.spooled(in_blocks(part, shape[0], nbytes, chunk), shape, dtype)
        if found is not None:
            return found
    return part(slice(None))
