"""Ratio of two sampling rates in whole numbers."""

import math
from fractions import Fraction

from ..errors import InputError

MOST = 1000
"""Largest numerator and denominator of a ratio of rates."""
HALF_WIDTH = 10
"""Samples of the slower rate on either side of a resampled one that it depends on, see `resampling.Resampler`."""
_SAME = 1e-9  # relative difference of ratios that are equal but for rounding


def sampling_ratio(sensor_hz: float, rate_hz: float) -> Fraction:
    """Samples of the new rate per sample of the old one.

    >>> sampling_ratio(1000.0, 50.0), sampling_ratio(44.1, 48.0)
    (Fraction(1, 20), Fraction(160, 147))

    Args:
        sensor_hz: Old rate.
        rate_hz: New rate.

    Raises:
        InputError: It is no ratio of whole numbers up to 1000.
    """
    exact = Fraction(rate_hz) / Fraction(sensor_hz)
    inverted = exact > 1
    ratio = (1 / exact if inverted else exact).limit_denominator(MOST)
    ratio = 1 / ratio if inverted and ratio else ratio
    if not ratio or abs(ratio - exact) > _SAME * exact:
        raise InputError(
            f"Cannot resample from {sensor_hz:.10g} Hz to {rate_hz:.10g} Hz: the rates must be as two whole numbers up "
            f"to {MOST}; a measured rate may be rounded to the sensor's nominal one."
        )
    return ratio


def frames_behind(ratio: Fraction) -> int:
    """Frames after its own that a resampled one waits for, at so many results per frame."""
    return math.ceil(HALF_WIDTH * max(ratio, Fraction(1)) / ratio)
