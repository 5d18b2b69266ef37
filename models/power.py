"""Exponent of the likelihood in Eq. 1, and the cap on an episode's evidence."""

import math
import re

from .errors import InputError

LEARNED = "learned"
"""Power to be learned from training sessions; `learned:N` maximises beliefs after N taps."""
TAPS = 20
"""Default number of taps for a learned power."""


def likelihood_exponent(power: str | float, J: int, K: int) -> float:
    """The exponent of the product in Eq. 1: 1/J as printed, 1/(J K), 1, or a number.

    Raises:
        InputError: The power is none of these.
    """
    named = {"J": 1.0 / J, "JK": 1.0 / (J * K), "none": 1.0}
    value = named.get(power) if isinstance(power, str) else float(power)
    if value is None or not (math.isfinite(value) and value > 0):
        raise InputError(f"The power must be J, JK, none or a positive number, got {power!r}.")
    return value


def check_saturation(saturation: float) -> None:
    """Checks that a saturation is a positive number of taps.

    Raises:
        InputError: It is NaN or not above 0; infinity stands for no limit.
    """
    if not saturation > 0:
        raise InputError(f"The saturation must be a positive number of taps, got {saturation}.")


def parse_power(text: str) -> str | float:
    """Power from its text on a command line.

    Raises:
        InputError: It is neither J, JK, none nor a positive number.
    """
    if text in ("J", "JK", "none"):
        return text
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not (math.isfinite(number) and number > 0):
        raise InputError(f"The power must be J, JK, none or a positive number, got {text!r}.")
    return number


def parse_power_choice(text: str) -> str | float:
    """Power from its text on a command line, including `learned` and `learned:N`.

    Raises:
        InputError: It is none of these.
    """
    try:
        return text if learned_taps(text) else parse_power(text)
    except InputError as error:
        if text.startswith(LEARNED):
            raise
        raise InputError(f"{str(error).rstrip('.')}; {LEARNED} estimates it.") from None


def learned_taps(power: str | float) -> int | None:
    """Number of taps N of a learned power; `None` for other powers.

    Raises:
        InputError: It begins with `learned` and ends in no number of taps.
    """
    if not isinstance(power, str) or not power.startswith(LEARNED):
        return None
    matched = re.fullmatch(f"{LEARNED}(?::([0-9]{{1,6}}))?", power)
    taps = int(matched[1] or TAPS) if matched else 0
    if not taps:
        raise InputError(f"The power must be {LEARNED}, or {LEARNED}:N with a number of taps N, got {power!r}.")
    return taps
