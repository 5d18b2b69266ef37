"""Passive and active perception at one threshold: errors on stored and on fresh taps, and how they differ."""

import math
from collections.abc import Iterable
from typing import Any

import xarray as xr

from ..page.words import STORED
from ..stats import metrics
from .record import ErrorRow, HeadlineRecord, PolicyRow
from .results import Results

STILL = 1.1
"""Mean taps to a decision below which passive and active perception are reported as not comparable."""

_FRESH = (
    "Fresh taps: each test tap is drawn at most once per trial. A trial that uses up the test taps of a class decides "
    "there; intervals cover any outcome of further taps."
)

_ENOUGH = "Threshold {:g} is the highest of those played at which the fresh test taps suffice."

_QUANTITIES = [name for name in metrics.QUANTITIES for name in (name, f"{name}_low", f"{name}_high")]


def curve_rows(policy: str, curve: xr.Dataset) -> list[PolicyRow]:
    """A row per threshold with quantities, their intervals and fractions; `None` where a number is missing."""
    names = (*_QUANTITIES, *metrics.FRACTIONS)
    return [PolicyRow(policy=policy, **_at(curve, h, names)) for h in range(curve.sizes["theta"])]


def difference_rows(curve: xr.Dataset | None) -> list[ErrorRow]:
    """Passive minus active, a row per threshold with intervals; none where nothing can be acted on."""
    if curve is None:
        return []
    return [ErrorRow(policy="passive - active", **_at(curve, h, _QUANTITIES)) for h in range(curve.sizes["theta"])]


def _at(curve: xr.Dataset, h: int, names: Iterable[str]) -> dict[str, Any]:
    """The threshold of an index and the numbers there."""
    return {"theta": float(curve["theta"][h])} | {name: finite(curve[name][h]) for name in names}


def headline(results: Results, shown: int) -> HeadlineRecord:
    """What is said of both policies at the shown threshold.

    Args:
        results: What came out.
        shown: Index of the threshold.

    Returns:
        `theta`; `stored` and `fresh`, each a sentence on its `meaning` and `rows` of policies and their difference;
        `enough`, the same as `fresh` at the highest threshold at which the test taps suffice, or `None` where that is
        `theta` or there is none; `used_up`, the share of fresh decisions made for want of test taps; `few`, whether
        there are too few test taps, and `still`, whether the finger has hardly moved, sentences or `None`.
    """
    stored = {name: curve.isel(theta=[shown]) for name, curve in results.curves.items()}
    theta = float(stored["passive"]["theta"][0])

    def fresh(at: float) -> list[ErrorRow]:
        curves = results.fresh_curves  # of equal thresholds the first
        return _side({name: one.isel(theta=[list(one["theta"].values).index(at)]) for name, one in curves.items()})

    enough = results.enough
    return {
        "theta": theta,
        "stored": {"meaning": STORED, "rows": _side(stored)},
        "fresh": {"meaning": _FRESH, "rows": fresh(theta)},
        "enough": None if enough is None else {"meaning": _ENOUGH.format(enough), "rows": fresh(enough)},
        "used_up": results.used_up,
        "few": results.few or None,
        "still": still(stored),
    }


def still(curves: dict[str, xr.Dataset]) -> str | None:
    """A sentence where both policies decide after fewer than `STILL` taps on average, at the only threshold."""
    if "active" not in curves:
        return None
    taps = max(float(curves[policy]["taps"][0]) for policy in ("passive", "active"))
    if not taps < STILL:
        return None
    return (
        f"Decisions take {taps:.2f} taps on average, so the finger hardly moves and passive and active perception "
        f"{'cannot' if taps == 1 else 'can hardly'} differ."
    )


def _side(curves: dict[str, xr.Dataset]) -> list[ErrorRow]:
    rows = [row for policy in ("passive", "active") if policy in curves for row in curve_rows(policy, curves[policy])]
    return [*rows, *difference_rows(curves.get("difference"))]


def finite(value: Any) -> float | None:
    """A number, or `None` where it is missing."""
    return None if not math.isfinite(value) else value if isinstance(value, int) else float(value)
