"""Numbers as text: rounded, in per cent, with their intervals, as factors."""

import math
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from typing import Any, TypeGuard

_MISSING = "–"
_MOST_FACTOR = 99.0


def number(value: Any, digits: int = 3) -> str:
    """A number rounded to so many significant digits, other things as they print, a dash for what is missing.

    >>> number(0.43218), number(26.31), number(1234.5), number(None)
    ('0.432', '26.3', '1234', '–')
    """
    if not _is_number(value):
        return _MISSING if value is None or isinstance(value, float) else str(value)
    if isinstance(value, Integral):
        return str(value)
    return f"{value:.0f}" if 1000 <= abs(value) < 1e6 else f"{value:.{digits}g}"


def percent(value: Any) -> str:
    """A fraction in per cent; a dash where it is missing.

    >>> percent(0.0481), percent(1.0)
    ('4.8 %', '100 %')
    """
    return f"{number(round(100 * value, 1))} %" if _is_number(value) else _MISSING


def interval(row: Mapping[str, Any], name: str) -> str:
    """A quantity with its bounds, to the digit that the width of the interval supports.

    >>> interval({"taps": 26.314, "taps_low": 25.2, "taps_high": 27.41}, "taps")
    '26.31 [25.20, 27.41]'
    """
    return bounded(*(row.get(name + suffix) for suffix in ("", "_low", "_high")))


def bounded(value: float | None = None, low: float | None = None, high: float | None = None) -> str:
    """The same of a value and its bounds.

    >>> bounded(26.314, 25.2, 27.41), bounded(0.5), bounded()
    ('26.31 [25.20, 27.41]', '0.5', '–')
    """
    if not (_is_number(value) and _is_number(low) and _is_number(high)):
        return number(value)
    half = (high - low) / 2
    digits = min(max(-math.floor(math.log10(half / 30)), 0), 4) if half > 0 else 3
    value, low, high = (round(number, digits) + 0.0 for number in (value, low, high))  # no negative zero
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def factor(values: Sequence[float | None] | None, unbounded: bool = False) -> str:
    """A factor with the ends of its interval, capped where size says nothing.

    >>> factor((1.234, 0.5, 14461493.0)), factor((1.0, 0.5, None)), factor((1.0, None, None)), factor((None,) * 3)
    ('1.2 [0.5, >99]', '1 [0.5, >99]', '1', '–')
    >>> factor((None, None, None), unbounded=True)
    'infinite'
    """
    if unbounded:
        return "infinite"
    if not values or not _is_number(values[0]):
        return _MISSING
    if not _is_number(values[1]):
        return number(values[0], 2)
    value, low, high = (">99" if not _is_number(v) or v > _MOST_FACTOR else number(v, 2) for v in values)
    return f"{value} [{low}, {high}]"


def in_brackets(unit: str) -> str:
    """A unit as it stands behind a quantity, nothing for none.

    >>> in_brackets("mm"), in_brackets("")
    (' (mm)', '')
    """
    return f" ({unit})" if unit else ""


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
