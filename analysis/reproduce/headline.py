"""Passive and active perception at one threshold, compared with the numbers of the paper."""

import xarray as xr

from ..page.figure_style import unit_name
from ..page.numbers import STORED
from .answer import answer
from .record import ErrorRow, HeadlineRecord, PaperRow
from .results import Results, curve_rows, difference_rows, finite

_HEADLINES = (
    # quantity, curve, variable, the paper's number in mm, where it stands
    ("rod diameter error, passive, mean over positions, best", "passive", "what_error", 2.0, "Sec. 3.2, 3.3"),
    ("rod diameter error, active, best", "active", "what_error", 0.4, "Sec. 3.3"),
    ("position error, passive, mean over positions, best", "passive", "where_error", 0.2, "Sec. 3.2, 3.3"),
    ("position error, active, best", "active", "where_error", 0.01, "Sec. 3.3"),
    ("rod diameter error, passive, at the centre, largest thresholds", "centre", "what_error", 0.4, "Sec. 3.2"),
    ("position error, passive, at the centre, largest thresholds", "centre", "where_error", 0.1, "Sec. 3.2"),
)

STILL = 1.1
"""Mean taps to a decision below which passive and active perception are reported as not comparable."""

_FRESH = (
    "Fresh taps: each test tap is drawn at most once per trial. A trial that uses up the test taps of a class decides "
    "there; intervals cover any outcome of further taps."
)

_ENOUGH = "Threshold {:g} is the highest of those played at which the fresh test taps suffice."


def headline(results: Results, shown: int) -> HeadlineRecord:
    """Headline numbers of both policies at the shown threshold.

    Args:
        results: What came out.
        shown: Index of the threshold.

    Returns:
        `answer`, sentences; `theta`; `stored` and `fresh`, each a sentence on its `meaning` and `rows` of policies and
        their difference; `enough`, the same as `fresh` at the highest threshold at which the test taps suffice, or
        `None` where that is `theta` or there is none; `used_up`, the share of fresh decisions made for want of test
        taps; `few`, whether there are too few test taps, and `still`, whether the finger has hardly moved, sentences
        or `None`.
    """
    stored = {name: curve.isel(theta=[shown]) for name, curve in results.curves.items()}
    theta = float(stored["passive"]["theta"][0])

    def fresh(at: float) -> list[ErrorRow]:
        curves = results.fresh_curves  # of equal thresholds the first
        return _side({name: one.isel(theta=[list(one["theta"].values).index(at)]) for name, one in curves.items()})

    enough = results.enough
    sides = _side(stored), fresh(theta)
    return {
        "answer": answer(theta, *sides, _units(results)),
        "theta": theta,
        "stored": {"meaning": STORED, "rows": sides[0]},
        "fresh": {"meaning": _FRESH, "rows": sides[1]},
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


def _units(results: Results) -> dict[str, str]:
    """Of the quantities that are not the same for all classes."""
    grid = results.grid
    errors = {"what_error": (grid.M, grid.what_error_unit), "where_error": (grid.L, unit_name(grid.where_unit))}
    return {name: unit for name, (classes, unit) in errors.items() if classes > 1} | {"taps": "taps"}


def _side(curves: dict[str, xr.Dataset]) -> list[ErrorRow]:
    rows = [row for policy in ("passive", "active") if policy in curves for row in curve_rows(policy, curves[policy])]
    return [*rows, *difference_rows(curves.get("difference"))]


def compare(curves: dict[str, xr.Dataset], centre: xr.Dataset) -> list[PaperRow]:
    """The numbers in the text of the paper, each with ours at the largest threshold.

    Args:
        curves: Outcomes over theta by policy.
        centre: Passive outcomes over theta at the default fixation point.
    """
    curves = curves | {"centre": centre}
    rows: list[PaperRow] = []
    for quantity, curve, name, value, source in _HEADLINES:
        if curve not in curves:
            continue
        ours = curves[curve].sortby("theta").isel(theta=-1)
        rows.append(
            {
                "quantity": quantity,
                "curve": curve,
                "error": name,
                "paper": value,
                "ours": finite(ours[name]),
                "ours_low": finite(ours[f"{name}_low"]),
                "ours_high": finite(ours[f"{name}_high"]),
                "unit": "mm",
                "source": f"{source}; ours at threshold {float(ours['theta']):g}",
            }
        )
    return rows
