"""Errors that a user can fix, and checks of single numbers."""

from numbers import Integral, Real


class InputError(ValueError):
    """Invalid data, option or file.

    The message is one sentence that names the file, array or argument and the place in it. Commands print it
    without a traceback and exit with code 2.
    """


def check_count(value: object, name: str, least: int = 1) -> int:
    """An integer of at least `least`, as a Python integer.

    Raises:
        InputError: It is none.
    """
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise InputError(f"{name} must be an integer of at least {least}, got {value!r}.")
    return int(value)


def check_probability(value: object, name: str) -> float:
    """A number from 0 to 1, as a Python number.

    Raises:
        InputError: It is none.
    """
    if not isinstance(value, Real) or isinstance(value, bool) or not 0 <= float(value) <= 1:
        raise InputError(f"{name} must be a number from 0 to 1, got {value!r}.")
    return float(value)
