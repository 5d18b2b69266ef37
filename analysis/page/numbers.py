"""Numbers as text: rounded, in per cent, with intervals, as factors."""

import math
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, TypeGuard

from .page import Table

if TYPE_CHECKING:
    from ..experiment.crosscheck import CrossCheck

_MISSING = "–"
_MOST_FACTOR = 99.0
_MOST_DECIMALS = 5


def number(value: Any, digits: int = 3) -> str:
    """A number rounded to so many significant digits; other values as they print, a dash for a missing one.

    >>> number(0.43218), number(-26.31), number(1234.5), number(None)
    ('0.432', '−26.3', '1234', '–')
    """
    if not _is_number(value):
        return _MISSING if value is None or isinstance(value, float) else str(value)
    if isinstance(value, Integral):
        return _signed(str(value))
    return _signed(f"{value:.0f}" if 1000 <= abs(value) < 1e6 else f"{value:.{digits}g}")


def in_taps(value: Any) -> str:
    """A number of taps, which may be a mean.

    >>> in_taps(3.891), in_taps(1.0)
    ('3.89 taps', '1 tap')
    """
    text = number(value)
    return f"{text} tap{'s' * (text != '1')}"


def percent(value: Any) -> str:
    """A fraction in per cent; a dash where it is missing.

    >>> percent(0.0481), percent(1.0)
    ('4.8%', '100%')
    """
    return f"{number(round(100 * value, 1))}%" if _is_number(value) else _MISSING


def interval(row: Mapping[str, Any], name: str) -> str:
    """A quantity with its bounds, to the digit that the width of the interval supports.

    >>> interval({"taps": 26.314, "taps_low": 25.2, "taps_high": 27.41}, "taps")
    '26.3 [25.2, 27.4]'
    """
    return bounded(*(row.get(name + suffix) for suffix in ("", "_low", "_high")))


def bounded(value: float | None = None, low: float | None = None, high: float | None = None) -> str:
    """A value with its bounds in brackets, to the digit that the width of the interval supports.

    >>> bounded(0.77, 0.0, 4.55), bounded(-0.7, -3.2, 5.2), bounded(0.5), bounded()
    ('0.8 [0.0, 4.5]', '−1 [−3, 5]', '0.5', '–')
    """
    if not (_is_number(value) and _is_number(low) and _is_number(high)):
        return number(value)
    value_text, low_text, high_text = rounded(value, low, high)
    return f"{value_text} [{low_text}, {high_text}]"


def spanned(value: float | None = None, low: float | None = None, high: float | None = None, unit: str = "") -> str:
    """The same for a sentence.

    >>> spanned(26.314, 25.2, 27.41), spanned(31.2, 18.9, 41.3, "%"), spanned(0.5)
    ('26.3 (25.2 to 27.4)', '31% (19% to 41%)', '0.5')
    """
    if not (_is_number(value) and _is_number(low) and _is_number(high)):
        return number(value) + unit
    value_text, low_text, high_text = rounded(value, low, high)
    return f"{value_text}{unit} ({low_text}{unit} to {high_text}{unit})"


def rounded(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A value and its bounds with the same decimals: the last one counts at most a third of the interval's half width.

    >>> rounded(0.43217, 0.401, 0.463), rounded(1240.2, 1010.7, 1500.1), rounded(1.0, 1.0, 1.0)
    (('0.43', '0.40', '0.46'), ('1240', '1011', '1500'), ('1', '1', '1'))
    """
    half = (high - low) / 2
    if not math.isfinite(half) or not half > 1e-9 * max(abs(low), abs(high)):
        return number(value), number(low), number(high)
    places = decimals(half)
    return fixed(value, places), fixed(low, places), fixed(high, places)


def decimals(half_width: float) -> int:
    """Decimals of a number whose interval has this half width.

    >>> [decimals(half) for half in (40.0, 2.3, 0.31, 0.25)]
    [0, 1, 1, 2]
    """
    return min(max(math.ceil(-math.log10(half_width / 3)), 0), _MOST_DECIMALS)


def fixed(value: float, places: int) -> str:
    """A number with so many decimals, without a negative zero.

    >>> fixed(-1.25, 1), fixed(-0.001, 2)
    ('−1.2', '0.00')
    """
    return _signed(f"{round(value, places) + 0.0:.{places}f}")


def factor(values: Sequence[float | None] | None, unbounded: bool = False) -> str:
    """A factor with its interval, with one decimal at least; sizes above 99 are not shown.

    >>> factor((1.234, 0.5, 4.1)), factor((0.77, 0.0, 14461493.0)), factor((1.0, None, None)), factor((None,) * 3)
    ('1.2 [0.5, 4.1]', '0.8 [0.0, >99]', '1', '–')
    >>> factor((None, None, None), unbounded=True)
    'infinite'
    """
    if unbounded:
        return "infinite"
    if not values or not _is_number(values[0]):
        return _MISSING
    value, low, high = factor_ends(values)
    return f"{value} [{low}, {high}]" if low else value


def factor_of(row: Mapping[str, Any], name: str) -> str:
    """A factor of a row with its bounds.

    >>> factor_of({"ratio": 1.23, "ratio_low": 0.5, "ratio_high": 4.1}, "ratio")
    '1.2 [0.5, 4.1]'
    """
    return factor([row.get(name + suffix) for suffix in ("", "_low", "_high")])


def factor_ends(values: Sequence[float | None]) -> tuple[str, str, str]:
    """A factor and the ends of its interval, which are empty without one.

    >>> factor_ends((7.1, 1.46, 41.3)), factor_ends((1.0, 0.5, None)), factor_ends((1.0, None, None))
    (('7.1', '1.5', '41.3'), ('1.0', '0.5', '>99'), ('1', '', ''))
    """
    if not _is_number(values[1]):
        return number(values[0], 2), "", ""
    width = (values[2] - values[1]) / 2 if _is_number(values[2]) else math.inf
    places = max(decimals(width), 1) if 0 < width < math.inf else 1
    value, low, high = (
        f">{_MOST_FACTOR:.0f}" if not _is_number(v) or v > _MOST_FACTOR else fixed(v, places) for v in values
    )
    return value, low, high


def in_brackets(unit: str) -> str:
    """A unit as it stands behind a quantity, nothing for none.

    >>> in_brackets("mm"), in_brackets("")
    (' (mm)', '')
    """
    return f" ({unit})" if unit else ""


def _signed(text: str) -> str:
    return text.replace("-", "−", 1) if text.startswith("-") else text


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


STORED = (
    "Stored taps: test taps are drawn with replacement up to the deadline, as in the paper, so long trials repeat taps."
)
"""What trials that draw with replacement estimate."""
STORED_ONLY = f"{STORED} Errors on fresh taps (each drawn at most once per trial) differ."
"""The same where fresh taps are not played."""


def listed(names: Sequence[str]) -> str:
    """Names with commas and an "and"."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def versions(packages: Sequence[str]) -> dict[str, str]:
    """Of Python and these packages, by name."""
    return {"python": platform.python_version()} | {name: version(name) for name in packages}


def crosscheck_table(check: "CrossCheck") -> Table:
    """The largest differences between independent ways of computing the same."""
    rows = [
        [row.quantity, row.routes, number(row.largest), number(row.allowed), "passed" if row.passed else "FAILED"]
        for row in check.rows
    ]
    return Table(["quantity", "routes", "largest difference", "allowed", "result"], rows, words={1, 4})
