"""Which rows are kept, and where taps begin among them."""

import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cutting.presses import numbers_or_truths
from ...errors import InputError
from ..recording import runs
from .formats.text_header import MISSING
from .labels import Label, as_known, as_numbers, as_texts
from .mapping import LABELS, TapMap, option

_CONDITION = re.compile(r"(.+?)(!=|==|<=|>=|=|<|>)(.*)")
_EQUAL = {"=": operator.eq, "==": operator.eq, "!=": operator.ne}
_COMPARED = _EQUAL | {"<": operator.lt, ">": operator.gt, "<=": operator.le, ">=": operator.ge}


def tap_column(how: TapMap) -> str | None:
    """Column or array that says which rows are a tap."""
    if how.tap is None or how.tap in ("file", "row"):
        return None
    return how.tap.removeprefix("restart:").removeprefix("ends:").removeprefix("column:")


def condition(how: TapMap) -> tuple[str, str, str]:
    """Column, comparison and value of `keep`; without a comparison the column holds truth values."""
    found = _CONDITION.fullmatch(how.keep or "")
    return (found[1].strip(), found[2], found[3].strip()) if found else (how.keep or "", "", "")


def kept(how: TapMap, column: NDArray[Any], rows: int) -> NDArray[np.bool_]:
    """Which rows or taps the condition of a map keeps, shape (rows,).

    Args:
        how: The map.
        column: What its condition is about.
        rows: How many there are.

    Raises:
        InputError: The column has another length, or cannot be compared.
    """
    name, comparison, wanted = condition(how)
    if column.shape != (rows,):
        raise InputError(f"keep (--keep): {name} has shape {column.shape}, expected one value for each of {rows} rows.")
    column = as_known(column)
    if not comparison:
        truths = numbers_or_truths(column, f"keep (--keep) {name}")
        return (truths != 0) & ~np.isnan(truths)
    if column.dtype.kind == "U":
        if comparison not in _EQUAL:
            raise InputError(f"keep (--keep): {name} holds texts such as {str(column[0])!r}, which have no order.")
        return _EQUAL[comparison](column, wanted)
    try:
        number = float(wanted)
    except ValueError:
        raise InputError(f"keep (--keep): {name} holds numbers, but {wanted!r} is none.") from None
    return _COMPARED[comparison](column, number)


def tap_starts(
    rows: int,
    how: TapMap,
    number: NDArray[Any] | None,
    ends: NDArray[Any] | None,
    labels: Mapping[str, Label],
) -> NDArray[np.intp] | None:
    """First row of each tap, `None` for a stream.

    Args:
        rows: How many there are, kept or not.
        how: The map.
        number: Number of each row's tap, shape (rows,), or of the row within it, if a column tells.
        ends: Ends of the taps, if an array tells.
        labels: A tap ends where one of these changes.

    Raises:
        InputError: The column or array does not fit.
    """
    if how.tap is None:
        return None
    if not rows or how.tap == "row":
        return np.arange(rows)
    if how.tap == "file":
        return np.zeros(1, dtype=np.intp)
    if ends is not None:
        return _before(ends, rows, how.tap)
    if number is None or number.shape != (rows,):
        raise InputError(f"tap (--tap) {how.tap!r}: expected one number for each of {rows} rows.")
    if how.tap.startswith("restart:"):
        known = np.flatnonzero(~_missing(number))
        count, _ = as_numbers("tap", number[known])
        return np.concatenate([[0], known[1:][np.diff(count) <= 0]]).astype(np.intp)
    return runs(number, *_changing(labels, rows))


def among_kept(starts: NDArray[np.intp], kept_rows: NDArray[np.intp], rows: int) -> NDArray[np.intp]:
    """First rows of the taps among the rows that are kept; taps of which none is kept are gone.

    Args:
        starts: First row of each tap among all rows.
        kept_rows: Numbers of the rows that are kept.
        rows: How many there are in all.
    """
    return starts if len(kept_rows) == rows else runs(np.searchsorted(starts, kept_rows, "right"))


def check_numbers(
    how: TapMap,
    number: NDArray[Any],
    starts: NDArray[np.intp],
    labels: Mapping[str, Label],
    place: Callable[[int], str],
) -> None:
    """Checks that each row has a number, and that the rows of a tap follow one another.

    Args:
        how: The map.
        number: As for `tap_starts`, of the rows that are kept.
        starts: First row of each tap among these.
        labels: Of these rows.
        place: Where one of them stands.

    Raises:
        InputError: A number is missing or a tap is in two places; the message names the row.
    """
    missing = np.flatnonzero(_missing(number))
    if len(missing):
        raise InputError(
            f"{place(int(missing[0]))}: tap (--tap) {how.tap!r} has no number; leave such rows out with keep (--keep)."
        )
    if how.tap is None or how.tap.startswith("restart:"):
        return
    seen: set[tuple[Any, ...]] = set()
    changing = [of[starts].tolist() for of in (number, *_changing(labels, len(number)))]
    for start, *each in zip(starts.tolist(), *changing, strict=True):
        key = tuple(each)
        if key in seen:
            again = as_texts(number[start : start + 1])[0]
            raise InputError(
                f"{place(start)}: tap (--tap) {how.tap!r} is {again} again after another tap; rows of a tap must "
                "follow one another; of a column that counts within taps say restart:COLUMN."
            )
        seen.add(key)


def _missing(number: NDArray[Any]) -> NDArray[np.bool_]:
    return np.isin(number, MISSING) if number.dtype.kind == "U" else number != number  # noqa: PLR0124 - NaN


def _changing(labels: Mapping[str, Label], rows: int) -> list[NDArray[Any]]:
    return [of for key, of in labels.items() if key in LABELS and isinstance(of, np.ndarray) and len(of) == rows]


def _before(ends: NDArray[Any], rows: int, tap: str) -> NDArray[np.intp]:
    """First rows from ends, which are not part of their taps."""
    bounds = np.append(0, as_numbers("tap", ends.reshape(-1), "entry {}".format)[0])
    if (bounds != np.round(bounds)).any() or (np.diff(bounds) <= 0).any() or bounds[-1] != rows:
        raise InputError(f"tap (--tap) {tap!r}: its whole numbers must rise to the {rows} rows, and end there.")
    return bounds[:-1].astype(np.intp)


def check_labels(
    labels: Mapping[str, Label], rows: int, starts: NDArray[np.intp] | None, place: Callable[[int], str]
) -> None:
    """Checks that labels of rows are as many, and do not change within a tap.

    Raises:
        InputError: They are not, or one does; the message names the row.
    """
    for key, values in labels.items():
        if not isinstance(values, np.ndarray):
            continue
        if len(values) != rows:
            raise InputError(f"{option(key)} has {len(values)} values for {rows} rows.")
        if starts is not None:
            changes = np.setdiff1d(np.flatnonzero(values[1:] != values[:-1]) + 1, starts)
            missing = (values[changes] != values[changes]) & (values[changes - 1] != values[changes - 1])
            bad = changes[~missing]
            if len(bad):
                before, after = as_texts(values[bad[0] - 1 : bad[0] + 1])
                raise InputError(f"{place(int(bad[0]))}: {option(key)} changes within a tap from {before} to {after}.")
