"""Errors that a user can fix, checks of numbers, and text that can be printed."""

import unicodedata
from hashlib import blake2b
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    from numpy.typing import ArrayLike, NDArray

_JOINERS = "\u200c\u200d"  # of letters and of emoji
_LONGEST_NAME = 80


class InputError(ValueError):
    """Invalid data, option or file.

    The message is one sentence that names the file, array or argument and the place in it. Commands print it
    without a traceback and exit with code 2.
    """


class NotConvergedError(InputError):
    """A fit did not converge, and `unconverged` was not set."""


def check_path(path: "str | PathLike[str]") -> Path:
    """The path of a file or folder, there or not.

    Raises:
        InputError: The system cannot look at it, for example as its name is too long.
    """
    path = Path(path)
    try:
        path.stat()  # from Python 3.14 on exists() tells no reasons
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return path
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}.") from error
    return path


def check_format(written: object, what: str, reads: int, older: int | None = None) -> None:
    """Checks the number of a file's format, where it has one.

    >>> check_format(9, "model.nc: a fitted model", 2, older=1)
    Traceback (most recent call last):
    solidtouch.models.errors.InputError: model.nc: a fitted model of format 9; this version reads formats 2 and 1.

    Raises:
        InputError: It is another number than those that are read.
    """
    if isinstance(written, Integral) and written not in (reads, older):
        known = f"format {reads}" if older is None else f"formats {reads} and {older}"
        raise InputError(f"{what} of format {written}; this version reads {known}.")


def check_count(value: object, name: str, least: int = 1) -> int:
    """An integer of at least `least`, as a Python integer.

    Raises:
        InputError: It is none.
    """
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise InputError(f"{name} must be an integer of at least {least}, got {value!r}.")
    return int(value)


def check_counts(least: int = 1, **values: object) -> None:
    """Checks options that are integers of at least `least`, or `None` for their default.

    Raises:
        InputError: One is none; the message names the option.
    """
    for name, value in values.items():
        if value is not None:
            check_count(value, f"--{name.replace('_', '-')}", least)


def check_probability(value: object, name: str) -> float:
    """A number from 0 to 1, as a Python number.

    Raises:
        InputError: It is none.
    """
    if not isinstance(value, Real) or isinstance(value, bool) or not 0 <= float(value) <= 1:
        raise InputError(f"{name} must be a number from 0 to 1, got {value!r}.")
    return float(value)


def check_numbers(values: "ArrayLike", name: str) -> "NDArray[Any]":
    """Real numbers as an array, with their type.

    Raises:
        InputError: They are none, or rows differ in length.
    """
    import numpy as np  # noqa: PLC0415 - commands begin without it

    try:
        array = np.asarray(values)
    except ValueError:
        raise InputError(f"{name}: rows differ in length.") from None
    if array.dtype.kind not in "fiub":
        raise InputError(f"{name} must hold numbers, got {array.dtype}.")
    return array


def counted(number: int, what: str) -> str:
    """A number of things.

    >>> counted(1, "tap"), counted(0, "taxel"), counted(2, "press")
    ('1 tap', '0 taxels', '2 presses')
    """
    plural = "es" if what.endswith("s") else "s"
    return f"{number} {what}{plural * (number != 1)}"


def shortened(texts: "Sequence[str]", most: int = 6) -> str:
    """The first of some texts, and how many more there are.

    >>> shortened(["a", "b"]), shortened(["a", "b", "c", "d"], most=2)
    ('a, b', 'a, b and 2 more')
    """
    more = len(texts) - most
    return ", ".join(texts[:most]) + (f" and {more} more" if more > 0 else "")


def printable(text: str) -> str:
    r"""Text with escapes for characters that control a terminal or the direction of what follows.

    >>> print(printable("6 mm\n\x1b[31m rod"))
    6 mm\n\x1b[31m rod
    """
    if text.isprintable():
        return text
    return "".join(_escaped(letter) for letter in text)


def printable_name(name: object) -> str:
    """A name that can be printed; one of more than 80 characters is cut and ends in a number of its own.

    >>> printable_name("rod " * 100)
    'rod rod rod rod rod rod rod rod rod rod rod rod rod rod rod rod rod ro… 03318369'
    """
    text = printable(str(name))
    if len(text) <= _LONGEST_NAME:
        return text
    return f"{text[: _LONGEST_NAME - 10].rstrip()}… {blake2b(text.encode(), digest_size=4).hexdigest()}"


def _escaped(letter: str) -> str:
    if letter.isprintable() or unicodedata.category(letter) == "Zs" or letter in _JOINERS:
        return letter
    return letter.encode("unicode_escape").decode("ascii")
