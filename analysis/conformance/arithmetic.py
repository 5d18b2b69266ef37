"""Arithmetic of the exact answers: 60 decimal digits, and no smallest number."""

from functools import lru_cache
from typing import Any

import mpmath

DIGITS = 60
MP: Any = mpmath.MPContext()  # mpmath has types for some things only
MP.dps = DIGITS

type Number = Any
type Matrix = list[list[Number]]


@lru_cache(maxsize=1 << 14)
def log(probability: Number) -> Number:
    """The logarithm; histograms of counts hold few different probabilities, each many times."""
    return MP.log(probability) if probability > 0 else MP.ninf
