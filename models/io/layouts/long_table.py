"""Long tables: one row for each sample of each taxel."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .label_values import as_known, as_texts, distinct
from .patterns import natural


class Widened(NamedTuple):
    """A long table with a column for each taxel.

    Attributes:
        names: Of the taxels, in natural order.
        at: Rows of each taxel in the long table, shape (K, R).
    """

    names: tuple[str, ...]
    at: NDArray[np.intp]


def widened(
    taxel: NDArray[Any], others: Mapping[str, NDArray[Any]], place: Callable[[int], str], key: str = "taxel"
) -> Widened:
    """Finds the rows of each taxel.

    Args:
        taxel: Which taxel each row is of, shape (rows,).
        others: Further columns, each of shape (rows,), which say the same for all taxels of a sample.
        place: Where a row stands, for messages.
        key: Of the column of taxels, for messages.

    Raises:
        InputError: Taxels differ in their numbers of rows, or in what further columns say of the same sample.
    """
    texts, _, which = distinct(as_known(taxel))
    order = sorted(range(len(texts)), key=lambda number: natural(texts[number]))
    counts = np.bincount(which, minlength=len(texts))[order]
    names = tuple(texts[number] for number in order)
    if len(set(counts.tolist())) > 1:
        few, most = int(counts.argmin()), int(counts.argmax())
        raise InputError(
            f"{key}: {names[few]} has {counts[few]} rows, {names[most]} {counts[most]}; each needs one for each sample."
        )
    at = np.argsort(np.argsort(order)[which], kind="stable").reshape(len(names), -1)
    for name, of in others.items():
        told = of[at]
        apart = told != told[:1]
        if told.dtype.kind == "f":
            apart &= ~(np.isnan(told) & np.isnan(told[:1]))
        if apart.any():
            k, row = np.argwhere(apart)[0].tolist()
            one, other = as_texts(told[[0, k], row])
            raise InputError(
                f"{place(int(at[k, row]))}: {key} {names[k]} has {name} {other}, {names[0]} {one}, in row {row + 1} of "
                "each; samples of all taxels must be in the same order."
            )
    return Widened(names, at)
