"""Columns that are read part by part: numbers side by side, texts, and elements of several numbers."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .... import storage
from ....errors import InputError
from .contents import Values


class Part(NamedTuple):
    """Some rows of a table.

    Attributes:
        values: The variables that are read as they are, each an array or a list of elements.
        numbers: The columns that are read side by side, shape (rows, columns).
    """

    values: Sequence[Values]
    numbers: NDArray[np.float64]


def gathered(
    parts: Callable[[], Iterable[Part]], names: Sequence[str], width: int
) -> tuple[dict[str, Values], NDArray[Any] | None]:
    """All rows, as `Contents.read` returns them.

    Args:
        parts: Reads them; again where the folder for temporary files has no room.
        names: Of the variables that are read as they are.
        width: Number of columns that are read side by side.
    """
    kept: list[Sequence[Values]] = []

    def blocks() -> Iterator[NDArray[np.float64]]:
        kept.clear()
        for part in parts():
            kept.append(part.values)
            yield np.ascontiguousarray(part.numbers, np.float64)

    numbers = _side_by_side(blocks, width)
    values = {name: joined([part[i] for part in kept]) for i, name in enumerate(names)}
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


def joined(parts: Sequence[Values]) -> Values:
    """Elements one after the other: an array, or a list of arrays where their shapes differ."""
    if not parts:
        return np.empty(0)
    if all(isinstance(part, np.ndarray) for part in parts) and len({part[0:0].shape[1:] for part in parts}) == 1:  # pyright: ignore[reportAttributeAccessIssue]
        return np.concatenate(parts)
    return [element for part in parts for element in part]


def stacked(elements: list[NDArray[Any]]) -> Values:
    """Elements as one array if their shapes are equal and those of texts or numbers do not mix."""
    alike = len({each.shape for each in elements}) == 1
    return np.stack(elements) if alike else elements


def number(value: object) -> float:
    """A number of a cell of JSON or of a message; NaN where it is missing.

    Raises:
        InputError: It is something else.
    """
    if value is None:
        return np.nan
    if isinstance(value, int | float):
        return float(value)
    raise InputError(f"{str(value)[:40]!r} is not a number.")
