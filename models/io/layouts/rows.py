"""Which rows are kept, and where taps begin among them."""

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cutting.presses import numbers_or_truths
from ...cutting.sessions import number_by_date
from ...errors import InputError
from ..recording import naming, runs
from .label_values import as_known, as_numbers, as_texts, is_missing
from .labels import Label, label_source
from .mapping import LABELS, PLANE, TapMap, option

_CONDITION = re.compile(r"(.+?)(!=|==|<=|>=|=|<|>)(.*)")
_EQUAL = {"=": operator.eq, "==": operator.eq, "!=": operator.ne}
_COMPARED = _EQUAL | {"<": operator.lt, ">": operator.gt, "<=": operator.le, ">=": operator.ge}


def tap_columns(how: TapMap) -> tuple[str, ...]:
    """Columns that say which rows are a tap, or the array."""
    if how.tap is None or how.tap in ("file", "row"):
        return ()
    names = (how.tap,) if isinstance(how.tap, str) else how.tap
    return tuple(name.removeprefix("restart:").removeprefix("ends:").removeprefix("column:") for name in names)


def counts_in_taps(how: TapMap) -> bool:
    """Whether the column of a map counts the rows of each tap anew."""
    return isinstance(how.tap, str) and how.tap.startswith("restart:")


def condition(text: str | None) -> tuple[str, str, str]:
    """Column, comparison and value of `keep` or `signal`; without a comparison the column holds truth values."""
    found = _CONDITION.fullmatch(text or "")
    return (found[1].strip(), found[2], found[3].strip()) if found else (text or "", "", "")


def holds(how: TapMap, key: str, column: NDArray[Any], rows: int) -> NDArray[np.bool_]:
    """Where the condition of a map holds, shape (rows,); it never does of a missing number.

    Args:
        how: The map.
        key: That of the condition, `keep` or `signal`.
        column: What it is about.
        rows: How many rows or taps there are.

    Raises:
        InputError: The column has another length, or cannot be compared.
    """
    name, comparison, wanted = condition(getattr(how, key))
    if column.shape != (rows,):
        raise InputError(f"{option(key)}: {name} has shape {column.shape}, expected one value for each of {rows} rows.")
    column = as_known(column)
    if not comparison:
        truths = _truths(key, name, column)
        return (truths != 0) & ~np.isnan(truths)
    number = as_known(wanted)
    if column.dtype.kind == "U" and isinstance(number, float):
        column = as_known(np.where(is_missing(column), "nan", column))
    if column.dtype.kind == "U":
        if comparison not in _EQUAL:
            raise InputError(f"{option(key)}: {name} holds texts such as {str(column[0])!r}, which have no order.")
        return _EQUAL[comparison](column, wanted)
    if not isinstance(number, float):
        raise InputError(f"{option(key)}: {name} holds numbers, but {wanted!r} is none.")
    return _COMPARED[comparison](column, number) & ~is_missing(column)


def signal_at(how: TapMap, column: NDArray[Any], rows: int) -> NDArray[Any]:
    """The signal that rises at each press, or whether its condition holds.

    Args:
        how: The map.
        column: What its `signal` is about.
        rows: How many rows there are.

    Raises:
        InputError: As for `holds`, or without a condition the column holds texts other than truth values.
    """
    name, comparison, _ = condition(how.signal)
    if comparison:
        return holds(how, "signal", column, rows)
    return _truths("signal", name, column) if column.dtype.kind == "U" and len(column) else column


def _truths(key: str, name: str, column: NDArray[Any]) -> NDArray[np.float64]:
    try:
        return numbers_or_truths(column, f"{option(key)} {name}")
    except InputError as error:
        raise InputError(f"{str(error).rstrip('.')}; texts are compared, as in {name}=TEXT.") from error


def tap_starts(
    rows: int,
    how: TapMap,
    numbers: Sequence[NDArray[Any]],
    ends: NDArray[Any] | None,
) -> NDArray[np.intp] | None:
    """First row of each tap, `None` for a stream.

    Args:
        rows: How many there are, kept or not.
        how: The map.
        numbers: Columns that tell: numbers of each row's tap, each of shape (rows,), or of the row within it.
        ends: Ends of the taps, if an array tells.

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
        return _before(ends, rows, tap_columns(how)[0])
    for number, name in zip(numbers, tap_columns(how), strict=True):
        if number.shape != (rows,):
            raise InputError(f"tap (--tap) {name}: expected one number for each of {rows} rows, got {number.shape}.")
    if counts_in_taps(how):
        known = np.flatnonzero(~is_missing(numbers[0]))
        count, _ = as_numbers("tap", numbers[0][known])
        return np.concatenate([[0], known[1:][np.diff(count) <= 0]]).astype(np.intp)
    return runs(*numbers)


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
    numbers: Sequence[NDArray[Any]],
    starts: NDArray[np.intp],
    labels: Mapping[str, Label],
    place: Callable[[int], str],
) -> None:
    """Checks that each row has a number, and that the rows of a tap follow one another.

    Numbers may come again with other labels, as where they count the taps of each object.

    Args:
        how: The map.
        numbers: As for `tap_starts`, of the rows that are kept.
        starts: First row of each tap among these.
        labels: Of these rows.
        place: Where one of them stands.

    Raises:
        InputError: A number is missing or a tap is in two places; the message names the row.
    """
    for number, name in zip(numbers, tap_columns(how), strict=True):
        missing = np.flatnonzero(is_missing(number))
        if len(missing):
            raise InputError(
                f"{place(int(missing[0]))}: tap (--tap) {name} has no number; leave such rows out with keep (--keep)."
            )
    if counts_in_taps(how) or _kept_alone(how, numbers):
        return
    seen: set[tuple[Any, ...]] = set()
    changing = [of[starts].tolist() for of in (*numbers, *_changing(labels, len(numbers[0])))]
    for start, *each in zip(starts.tolist(), *changing, strict=True):
        key = tuple(each)
        if key in seen:
            again = ", ".join(as_texts(number[start : start + 1])[0] for number in numbers)
            names = ", ".join(tap_columns(how))
            raise InputError(
                f"{place(start)}: tap (--tap) {names} is {again} again after another tap; rows of a tap must follow "
                f"one another. {_apart(how)}; of a column that counts within taps say restart:COLUMN."
            )
        seen.add(key)


def _kept_alone(how: TapMap, numbers: Sequence[NDArray[Any]]) -> bool:
    """Whether a column is that of the condition and has one value where this holds, so that each stretch is a tap."""
    name = condition(how.keep)[0]
    return any(name == each and len(set(as_texts(of))) == 1 for each, of in zip(tap_columns(how), numbers, strict=True))


def _apart(how: TapMap) -> str:
    """What to do where a number comes again."""
    if how.keep is None:
        return "Leave rows between taps out with keep (--keep)"
    name = condition(how.keep)[0]
    if name in tap_columns(how):
        return f"Where keep (--keep) keeps one value of {name} alone, each stretch of rows is a tap"
    return f"If each stretch of rows that keep (--keep) keeps is a tap, name {name} in tap (--tap) as well"


def _changing(labels: Mapping[str, Label], rows: int) -> list[NDArray[Any]]:
    return [of for key, of in labels.items() if key in LABELS and isinstance(of, np.ndarray) and len(of) == rows]


def _before(ends: NDArray[Any], rows: int, tap: str) -> NDArray[np.intp]:
    """First rows from ends, which are not part of their taps."""
    bounds = np.append(0, as_numbers("tap", ends.reshape(-1), "entry {}".format)[0])
    if (bounds != np.round(bounds)).any() or (np.diff(bounds) <= 0).any() or bounds[-1] != rows:
        raise InputError(f"tap (--tap) {tap!r}: its whole numbers must rise to the {rows} rows, and end there.")
    return bounds[:-1].astype(np.intp)


def check_labels(
    how: TapMap,
    labels: Mapping[str, Label],
    rows: int,
    starts: NDArray[np.intp] | None,
    place: Callable[[int], str],
) -> None:
    """Checks that labels of rows are as many, and do not change within a tap.

    Raises:
        InputError: They are not, or one does; the message names the row.
    """
    for key, values in labels.items():
        if not isinstance(values, np.ndarray):
            continue
        if len(values) != rows:
            if how.trigger is not None and starts is None:
                continue  # labels of the taps that are cut, see `stream_labels`
            raise InputError(f"{option(key)} has {len(values)} values for {rows} rows.")
        if starts is not None:
            told = _compared(key, values, how)
            changes = np.setdiff1d(np.flatnonzero(told[1:] != told[:-1]) + 1, starts)
            missing = (told[changes] != told[changes]) & (told[changes - 1] != told[changes - 1])
            bad = changes[~missing]
            if len(bad):
                before, after = as_texts(values[bad[0] - 1 : bad[0] + 1])
                raise InputError(
                    f"{place(int(bad[0]))}: {option(key)} changes within a tap from {before} to {after}"
                    f"{_way_out(key, how)}."
                )


def _compared(key: str, values: NDArray[Any], how: TapMap) -> NDArray[Any]:
    """Labels as a tap has them: positions rounded, dates without times."""
    with naming(option(key)):
        if how.where_round is not None and key in ("where", *PLANE):
            return np.round(as_numbers(key, values)[0] * how.where_scale / how.where_round)
        if key == "session" and how.session is not None and label_source(key, how.session).dated:
            return number_by_date(values)
    return values


def _way_out(key: str, how: TapMap) -> str:
    if key in ("where", *PLANE) and how.where_round is None:
        return "; round it with where_round (--where-round) if it is measured"
    if tap_columns(how) and not counts_in_taps(how):
        return "; if another tap begins there, tap (--tap) must name a column that tells, beside the first"
    return ""
