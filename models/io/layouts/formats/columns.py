"""Columns that are read part by part: numbers side by side, texts, and elements of several numbers."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .... import storage
from .contents import Values


class Part(NamedTuple):
    """Some rows of a table.

    Attributes:
        values: The variables that are read as they are, each an array or a list of elements; `None` for one without any
            in this part.
        numbers: The columns that are read side by side, shape (rows, columns).
    """

    values: Sequence[Values | None]
    numbers: NDArray[np.float64]


def gathered(
    parts: Callable[[], Iterable[Part]], names: Sequence[str], width: int, most: int | None = None
) -> tuple[dict[str, Values], NDArray[Any] | None]:
    """All rows, as `Contents.read` returns them.

    Args:
        parts: Reads them; again where the folder for temporary files has no room.
        names: Of the variables that are read as they are.
        width: Number of columns that are read side by side.
        most: Number of parts that are read; `None` for all.
    """
    kept: list[Sequence[Values | None]] = []

    def blocks() -> Iterator[NDArray[np.float64]]:
        kept.clear()
        for part in islice(parts(), most):
            kept.append(part.values)
            yield np.ascontiguousarray(part.numbers, np.float64)

    numbers = _side_by_side(blocks, width)
    values = {name: _joined([part[i] for part in kept]) for i, name in enumerate(names)}
    return values, numbers if width else None


def _side_by_side(blocks: Callable[[], Iterator[NDArray[np.float64]]], width: int) -> NDArray[np.float64]:
    """Rows of all blocks, shape (R, width), in a temporary file if they are many."""
    rest, first, size = blocks(), [np.empty((0, width))], 0
    for block in rest:
        first.append(block)
        if (size := size + block.nbytes) > storage.ON_DISK:
            break
    else:
        return np.concatenate(first)
    found = storage.spooled((block.data for block in chain(first[1:], rest)), None, np.float64)
    return np.concatenate(list(blocks())) if found is None else found.reshape(-1, width)


def _joined(parts: Sequence[Values | None]) -> Values:
    """Elements one after the other: an array, or a list of arrays where their shapes differ."""
    found = [part for part in parts if part is not None]
    arrays = [part for part in found if isinstance(part, np.ndarray)]
    if len(arrays) == len(found) and len({part.shape[1:] for part in arrays}) <= 1:
        return np.concatenate(arrays) if arrays else np.empty(0)
    return [element for part in found for element in part]


def stacked(elements: list[NDArray[Any]]) -> Values:
    """Elements as one array if their shapes are equal and those of texts or numbers do not mix."""
    alike = len({each.shape for each in elements}) == 1
    return np.stack(elements) if alike else elements
