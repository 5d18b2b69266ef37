"""The root in Eq. 1 of the paper: how much the samples of one tap count."""

import numpy as np

from .errors import InputError


def likelihood_exponent(power: str | float, J: int, K: int) -> float:
    """The exponent of the product in Eq. 1: 1/J as printed, 1/(J K), 1, or a number.

    Raises:
        InputError: The power is none of these.
    """
    named = {"J": 1.0 / J, "JK": 1.0 / (J * K), "none": 1.0}
    value = named.get(power) if isinstance(power, str) else float(power)
    if value is None or not (np.isfinite(value) and value > 0):
        raise InputError(f"The power must be J, JK, none or a positive number, got {power!r}.")
    return value


def parse_power(text: str) -> str | float:
    """A power as written on a command line.

    Raises:
        InputError: It is neither J, JK, none nor a positive number.
    """
    if text in ("J", "JK", "none"):
        return text
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not (np.isfinite(number) and number > 0):
        raise InputError(f"The power must be J, JK, none or a positive number, got {text!r}.")
    return number
