"""How much data a verdict needs: interval of an accuracy, and miscalibration that a number of decisions can show.

Closed forms, for a first look without a simulation. Counts of wrong decisions are taken as Poisson counts, whose square
root has a standard deviation of about a half whatever their mean (Bartlett 1936).
"""

import numpy as np

LEVEL = 0.05
"""Of a verdict on beliefs in either direction, both sides together."""
POWER = 0.8
"""Wanted of it."""
_Z = 1.96  # of both sides at `LEVEL`
_Z_POWER = 0.84


def half_width(taps: int, accuracy: float = 0.5) -> float:
    """Half the width of a 95% interval of an accuracy from independent taps; widest at an accuracy of 0.5.

    >>> round(half_width(100), 2), round(half_width(400), 3)
    (0.1, 0.049)
    """
    z = _Z**2 / taps
    return float(_Z / (1 + z) * np.sqrt(accuracy * (1 - accuracy) / taps + z / (4 * taps)))


def detectable_factor_of(wrong: float) -> float:
    """The smallest factor by which decisions err more often than beliefs imply that is detected with `POWER`.

    Of a test that rejects in `LEVEL` / 2 of the data sets of a correct model.

    >>> [round(detectable_factor_of(wrong), 1) for wrong in (2, 11.5, 40)]
    [4.0, 2.0, 1.5]

    Args:
        wrong: Independent wrong decisions that beliefs imply; without any the factor is infinite.
    """
    return float((1 + (_Z + _Z_POWER) / (2 * np.sqrt(wrong))) ** 2) if wrong > 0 else np.inf


def wrong_decisions_for(factor: float) -> float:
    """The inverse of `detectable_factor_of`, of a factor above 1."""
    return float(((_Z + _Z_POWER) / (2 * (np.sqrt(factor) - 1))) ** 2)
