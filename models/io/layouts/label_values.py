"""Labels as texts and as numbers with their units."""

import re
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..recording import runs
from .formats.text_header import MISSING
from .mapping import option
from .patterns import number_in, unclear_comma

LENGTHS_AND_ANGLES = {"m", "cm", "mm", "um", "µm", "nm", "in", "deg", "rad", "°"}
PLAIN = re.compile(r"[-+\u2212]?[\d.,]+(?:[eE][-+]?\d+)? ?(?:°|[^\W\d_]{1,3})?")
"""A number alone or with a unit."""


def as_known(values: NDArray[Any] | str) -> Any:
    """Texts as numbers where all are; a single text likewise."""
    if isinstance(values, str):
        return as_known(np.array([values]))[0].item()
    if values.dtype.kind != "U":
        return values
    try:
        return values.astype(np.float64)
    except ValueError:
        return values


def is_missing(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether labels or numbers are not there: NaN, or texts for that."""
    return np.isin(values, MISSING) if values.dtype.kind == "U" else values != values  # noqa: PLR0124 - NaN


def as_texts(values: NDArray[Any]) -> list[str]:
    """Labels as texts, whole numbers without a point."""
    if values.dtype.kind == "f":
        return [f"{value:.15g}" for value in values.tolist()]
    if values.dtype.kind == "S":
        return [value.decode("utf-8", "replace") for value in values.tolist()]
    return [str(value).strip() for value in values.tolist()]


def distinct(values: NDArray[Any]) -> tuple[list[str], NDArray[np.intp], NDArray[np.intp]]:
    """Labels as texts, each once, in the order of appearance; first row of each, and which one each row has.

    Rows that follow one another mostly have the same, so that few of them are made texts.
    """
    starts = runs(values)
    texts, first, which = np.unique(as_texts(values[starts]), return_index=True, return_inverse=True)
    order = np.argsort(first)
    lengths = np.diff(starts, append=len(values))
    return texts[order].tolist(), starts[first[order]], np.repeat(np.argsort(order)[which], lengths)


@cache
def _as_number(text: str) -> tuple[float, str] | None:
    """A finite number and its unit; `None` for another text."""
    try:
        number = float(text) if "_" not in text else np.nan  # Python takes 1_000 for a number
    except ValueError:
        return number_in(text)
    return (number, "") if np.isfinite(number) else number_in(text)


def are_names(listed: NDArray[Any]) -> bool:
    """Whether a list of objects or positions holds names, not numbers with or without a unit."""
    return listed.dtype.kind in "US" and not all(map(PLAIN.fullmatch, as_texts(listed)))


def by_name(
    key: str, values: NDArray[Any], listed: NDArray[Any], place: Callable[[int], str]
) -> NDArray[np.intp] | None:
    """Number of each label in a list of names; `None` where labels are numbers of its entries.

    Args:
        key: Which label.
        values: Labels, shape (n,).
        listed: The names.
        place: Where one of the labels stands.

    Raises:
        InputError: A name is not in the list, or is there twice.
    """
    number = {name: n for n, name in enumerate(as_texts(listed))}
    list_of = option("what_names" if key == "what" else "where_values")
    if are_names(listed) and len(number) < len(listed):
        raise InputError(f"{list_of} has a name twice: {', '.join(as_texts(listed))[:200]}.")
    texts, first, which = distinct(values)
    if not are_names(listed) or all(map(PLAIN.fullmatch, texts)):
        return None
    for text, row in zip(texts, first.tolist(), strict=True):
        if text not in number:
            raise InputError(f"{option(key)}: {text!r} of {place(row)} is not in {list_of}: {', '.join(number)[:200]}.")
    return np.array([number[text] for text in texts], dtype=np.intp)[which]


_AFTER_LETTERS = re.compile(r"[^\W\d_](-?)\d")


def _unclear_sign(texts: Sequence[str]) -> str | None:
    """A text such as `pos-2` beside others such as `pos2`, if there are any."""
    called = (text for text in texts if not PLAIN.fullmatch(text))  # an exponent has a sign of its own
    signs = {text: found[1] for text in called if (found := _AFTER_LETTERS.search(text))}
    with_sign = [text for text, sign in signs.items() if sign]
    return with_sign[0] if with_sign and len(with_sign) < len(signs) else None


def _no_number(key: str, text: str) -> str:
    """Why a text is none, and what to do."""
    if unclear_comma(text):
        return "has a comma that may be a decimal mark or separate thousands; write a point, or no comma"
    if key == "where" and text.lower() not in ("", "nan", "inf", "-inf") and not any(map(str.isdecimal, text)):
        return f"is not one number; list the names of positions in their order in {option('where_values')}"
    return "is not one number"


def as_numbers(
    key: str, values: NDArray[Any], place: Callable[[int], str] = "tap {}".format
) -> tuple[NDArray[np.float64], str]:
    """Labels as numbers, and the unit that all texts state.

    Args:
        key: Which label.
        values: Numbers or texts.
        place: Where one of them stands.

    Raises:
        InputError: One holds no number, or more than one, or one with a comma that may mean two things, or they have
            different units of length or angle.
    """
    if values.dtype.kind in "fiub" and np.isfinite(values).all():
        return values.astype(np.float64), ""
    texts, first, which = distinct(values)
    if (unclear := _unclear_sign(texts)) is not None:
        raise InputError(f"{option(key)}: the sign in {unclear!r} may be a minus or a hyphen, as others have none.")
    numbers, units = np.empty(len(texts)), set[str]()
    for number, text in enumerate(texts):
        found = _as_number(text)
        if found is None:
            raise InputError(f"{option(key)}: {text!r} of {place(int(first[number]))} {_no_number(key, text)}.")
        numbers[number] = found[0]
        units.add(found[1])
    if len(known := sorted(units & LENGTHS_AND_ANGLES)) > 1:
        raise InputError(f"{option(key)}: units differ, {' and '.join(known)}.")
    return numbers[which], units.pop() if len(units) == 1 else ""
