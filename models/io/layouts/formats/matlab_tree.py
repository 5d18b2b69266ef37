"""A MATLAB workspace, whichever version of its files holds it, as named arrays.

Arrays have their axes in the order in which MATLAB's `size` shows them; row and column vectors have one. Fields of a
struct are joined by a point. Cells and struct arrays have their own axes before those of their elements. Elements that
differ in shape are a list, in the order of the rows of a cell, then of its columns.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .... import storage
from .contents import Values, Variable
from .named_arrays import COMPLEX, TEXT, Stored

type Size = tuple[int, ...]
"""Of an array in MATLAB, of at least two axes."""

MOST_NODES, BYTES_PER_NODE = 20_000, 64
"""Elements of cells and structs that a file may hold, and bytes of a larger one for each further element."""
DEEPEST = 24
"""Structs and cells inside each other."""
_WAYS_OUT = {
    "sparse": "it is a sparse matrix; save full(x)",
    "string": "it is a string; save cellstr(x) or char(x)",
    "table": "it is a table; save table2struct(x, 'ToScalar', true)",
    "timetable": "it is a timetable; save table2struct(timetable2table(x), 'ToScalar', true)",
    "categorical": "it is categorical; save cellstr(x)",
    "datetime": "it is a datetime; save posixtime(x)",
    "duration": "it is a duration; save seconds(x)",
    "function_handle": "it is a function handle; save func2str(x)",
    "containers.Map": "it is a map; save x.keys and x.values",
}


@dataclass(frozen=True)
class Leaf:
    """A numeric or logical array, or a matrix of characters as a column of texts.

    Attributes:
        size: In MATLAB.
        dtype: Of its numbers, or kind `U`.
        load: Reads it from the open file, with these axes.
    """

    size: Size
    dtype: np.dtype[Any]
    load: Callable[[Any], NDArray[Any]]

    @property
    def is_text(self) -> bool:
        """Whether it holds texts."""
        return self.dtype.kind == "U"

    @property
    def is_blank(self) -> bool:
        """Whether it is `[]`, which says that there is nothing."""
        return self.size == (0, 0) and not self.is_text

    @property
    def nbytes(self) -> int:
        """Bytes of its numbers."""
        return prod(self.size) * self.dtype.itemsize


@dataclass(frozen=True)
class CellArray:
    """A cell array and its elements in MATLAB's order, by column."""

    size: Size
    elements: "Sequence[Node]"


@dataclass(frozen=True)
class StructArray:
    """A struct array, of size 1 x 1 if it is one struct, and the elements of each field by column."""

    size: Size
    fields: "Mapping[str, Sequence[Node]]"


@dataclass(frozen=True)
class Unreadable:
    """What cannot be read, and why."""

    why: str


type Node = Leaf | CellArray | StructArray | Unreadable
_BLANK = Leaf((0, 0), np.dtype(np.float64), lambda _: np.empty((0, 0)))


def way_out(kind: str) -> str:
    """Why an array of a class of MATLAB cannot be read, and what to save instead."""
    if kind == "complex":
        return COMPLEX
    return _WAYS_OUT.get(kind, f"it is an object{f' ({kind})' if kind else ''}; save its properties as plain arrays")


@dataclass
class Workspace:
    """Arrays by name, and what cannot be read."""

    found: dict[str, Stored] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, node: Node) -> None:
        """Adds the arrays of a variable."""
        if isinstance(node, StructArray) and prod(node.size) == 1:
            for key, (value,) in node.fields.items():
                self.add(f"{name}.{key}", value)
        elif isinstance(node, StructArray):
            for key, values in node.fields.items():
                self._add_elements(f"{name}.{key}", _axes(node.size), _by_row(node.size, values))
        elif isinstance(node, CellArray):
            self._add_elements(name, _axes(node.size), _by_row(node.size, node.elements))
        elif isinstance(node, Unreadable):
            self.unreadable[name] = node.why
        else:
            axes = _axes(node.size)
            load = partial(_reshaped, node.load, axes)
            self.found[name] = Stored(Variable(axes, node.dtype), node.nbytes, load)

    def _add_elements(self, name: str, axes: Size, nodes: Sequence[Node]) -> None:
        """Adds elements of the same field or cell array, in the order of rows."""
        told = [node for node in nodes if not (isinstance(node, Leaf) and node.is_blank)]
        if (bad := next((node for node in told if isinstance(node, Unreadable)), None)) is not None:
            self.unreadable[name] = f"of one of its elements, {bad.why}"
        elif told and all(isinstance(node, StructArray) for node in told):
            self._add_structs(name, axes, nodes)
        elif told and all(isinstance(node, CellArray) for node in told):
            self._add_nested(name, axes, nodes)
        elif all(isinstance(node, Leaf) for node in told):
            leaves = [node for node in nodes if isinstance(node, Leaf)]
            if len({leaf.is_text for leaf in leaves if not leaf.is_blank}) > 1:
                self.unreadable[name] = "it mixes numbers and texts; save them as arrays of their own"
            else:
                self.found[name] = _elements(axes, leaves)
        else:
            self.unreadable[name] = "it mixes structs, cells and plain arrays; save them as arrays of their own"

    def _add_structs(self, name: str, axes: Size, nodes: Sequence[Node]) -> None:
        structs = [node if isinstance(node, StructArray) else None for node in nodes]
        keys = dict.fromkeys(key for each in structs if each is not None for key in each.fields)
        single = all(each is None or prod(each.size) == 1 for each in structs)
        for key in keys:
            values: list[Node] = []
            for each in structs:
                if each is None or key not in each.fields:
                    values.append(_BLANK)
                else:
                    values.append(each.fields[key][0] if single else CellArray(each.size, each.fields[key]))
            self._add_elements(f"{name}.{key}", axes, values)

    def _add_nested(self, name: str, axes: Size, nodes: Sequence[Node]) -> None:
        """Adds cells inside cells; rows that have fewer elements than others end in blank ones."""
        cells = [node if isinstance(node, CellArray) else CellArray((0, 0), ()) for node in nodes]
        sizes = {_axes(cell.size) for cell in cells}
        if len(sizes) > 1 and any(len(size) != 1 for size in sizes):
            self.unreadable[name] = (
                "its elements hold matrices of cells or structs that differ in size; save rows of cells, such as x(:)'"
            )
            return
        most = max(sizes)
        flat: list[Node] = []
        for cell in cells:
            flat += [*_by_row(cell.size, cell.elements), *[_BLANK] * (prod(most) - len(cell.elements))]
        self._add_elements(name, (*axes, *most), flat)


def _axes(size: Size) -> Size:
    """Axes of an array: one for row and column vectors and for `[]`."""
    if len(size) > 2:
        return size
    return (prod(size),) if 1 in size else (0,) if size == (0, 0) else size


def _reshaped(load: Callable[[Any], NDArray[Any]], axes: Size, source: Any) -> NDArray[Any]:
    return load(source).reshape(axes)


def _by_row(size: Size, nodes: Sequence[Node]) -> Sequence[Node]:
    """Elements in the order of rows, given in that of columns."""
    if len(_axes(size)) == 1:
        return nodes
    order = np.arange(len(nodes)).reshape(size, order="F").reshape(-1)
    return [nodes[i] for i in order.tolist()]


def _elements(axes: Size, leaves: Sequence[Leaf]) -> Stored:
    """Elements that hold numbers or texts alike, as one array if they have the same shape."""
    shapes = _element_shapes(leaves)
    told = [leaf for leaf in leaves if not leaf.is_blank] or [_BLANK]
    dtype = TEXT if told[0].is_text else np.result_type(*{leaf.dtype for leaf in told})
    scalar = shapes is None
    if scalar and len(told) < len(leaves) and dtype.kind != "U":
        dtype = np.result_type(dtype, np.float32 if dtype.itemsize < 4 else np.float64)
    each = [() for _ in leaves] if shapes is None else shapes
    nbytes = sum(leaf.nbytes for leaf in leaves)
    if len(set(each)) > 1:
        common = tuple(n[0] if len(set(n)) == 1 else None for n in zip(*each, strict=True))
        load = partial(_list, leaves, each, dtype)
        return Stored(Variable((*axes, *common), dtype), nbytes, load, mapped=False)
    shape = (*axes, *(each[0] if each else ()))
    return Stored(Variable(shape, dtype), prod(shape) * dtype.itemsize, partial(_stacked, leaves, shape, dtype))


def _element_shapes(leaves: Sequence[Leaf]) -> list[Size] | None:
    """Shape of each element, of as many axes each; `None` if they are single values or there are none.

    All are vectors, or all have the axes of the one with most, as MATLAB drops trailing ones. Blanks have no rows.
    """
    sizes = [leaf.size for leaf in leaves if not leaf.is_blank]
    if not sizes:
        return [(0,) for _ in leaves] if leaves else None
    if all(prod(size) == 1 for size in sizes):
        return None
    if all(len(size) == 2 and 1 in size for size in sizes):
        return [(prod(leaf.size),) for leaf in leaves]
    most = max(map(len, sizes))
    rest = (*sizes[0], *[1] * most)[1:most]
    return [(0, *rest) if leaf.is_blank else (*leaf.size, *[1] * (most - len(leaf.size))) for leaf in leaves]


def _list(leaves: Sequence[Leaf], shapes: Sequence[Size], dtype: np.dtype[Any], source: Any) -> Values:
    parts = _parts(leaves, dtype, source)
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]


def _parts(leaves: Sequence[Leaf], dtype: np.dtype[Any], source: Any) -> Iterator[NDArray[Any]]:
    for leaf in leaves:
        if leaf.is_blank and dtype.kind == "U":
            yield np.array([""])
        else:
            values = leaf.load(source)
            yield values if dtype.kind == "U" else values.astype(dtype, copy=False)


def _stacked(leaves: Sequence[Leaf], shape: Size, dtype: np.dtype[Any], source: Any) -> NDArray[Any]:
    """Elements of the same shape as one array; a large one in a temporary file. Blanks among single values are NaN."""
    parts = _parts(leaves, dtype, source)
    if dtype.kind == "U":
        return np.array([text for part in parts for text in part.reshape(-1).tolist()], dtype=np.str_).reshape(shape)
    size = prod(shape) // max(len(leaves), 1)
    filled = (part if part.size == size else np.full(size, np.nan, dtype) for part in parts)
    if prod(shape) * dtype.itemsize > storage.ON_DISK:
        found = storage.spooled((np.ascontiguousarray(part).data for part in filled), shape, dtype)
        if found is not None:
            return found
        filled = _parts(leaves, dtype, source)
    array = np.empty((len(leaves), size), dtype)
    for row, part in zip(array, filled, strict=True):
        row[:] = part.reshape(-1)
    return array.reshape(shape)
