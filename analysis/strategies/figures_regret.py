"""Figure of the cost of strategies above that of the exact rule or a bound.

Data are those of `regret_summary.summarise_regret`.
"""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..page.figure_sizes import TWO_COLUMNS, key, new_figure
from ..page.figure_style import ACTIVE, OTHERS, label_panel, styled
from ..page.page import Row
from .regret_cases import KINDS, LOOKAHEAD, NUMBER, TEST, THRESHOLD
from .run import BASE

_LOOKS: dict[str, dict[str, Any]] = {
    THRESHOLD: {"color": ACTIVE, "marker": "o"},
    NUMBER: {"color": "#0072b2", "marker": "s"},
    LOOKAHEAD: {"color": "#d55e00", "marker": "^"},
    TEST: {"color": "#009e73", "marker": "D"},
}
"""Kinds of rules, told apart by colour, mark and height in their row."""
_BEST, _WORST = f"{BASE}, best position", f"{BASE}, worst position"
_ROW = 0.2  # inches
_APART = 0.2  # kinds in a row
_LEAST, _MOST = 4e-4, 3.0  # mm, the ends of the axis


@styled
def regret(summary: Row) -> Figure:
    """Cost above the minimum: a column for each case, a row for each cost of taps, on a common log axis.

    Of the fixation points only the best and the worst by the best threshold are shown.
    """
    cases = summary["cases"]
    costs = list(dict.fromkeys(case["tap_cost"] for case in cases))
    rows = [[case for case in cases if case["tap_cost"] == cost] for cost in costs]
    names = list(shown(cases[0]))
    height = 0.9 + len(costs) * (_ROW * len(names) + 0.4)
    figure, axes = new_figure(
        TWO_COLUMNS, height, len(costs), len(rows[0]), sharex=True, sharey=True, of_text=True, whole=True
    )
    letters = iter("ABCDEFGHIJKL")
    for panels, of in zip(axes, rows, strict=True):
        for panel, case in zip(panels, of, strict=True):
            for y, prices in enumerate(shown(case).values()):
                plot_prices(panel, prices, y)
            _rows(panel, len(names))
            label_panel(panel, next(letters), f"{case['name']},\n{case['tap_cost']:g} mm per tap")
    _axes(axes[0, 0], names)
    figure.supxlabel("cost above the exact rule; last column: above a bound (mm)", fontsize="medium")
    _key(figure)
    return figure


def shown(case: Row) -> dict[str, list[Row]]:
    """Prices by strategy, of the fixation points those of the best and the worst."""
    found: dict[str, list[Row]] = {}
    for price in case["prices"]:
        found.setdefault(price["strategy"], []).append(price)
    fixed = sorted((name for name in found if name.startswith(f"{BASE} at ")), key=lambda name: _by_theta(found[name]))
    kept: dict[str, list[Row]] = {}
    for name, prices in found.items():
        if name not in fixed:
            kept[name] = prices
        elif _BEST not in kept:
            kept |= {_BEST: found[fixed[0]], _WORST: found[fixed[-1]]}
    return kept


def plot_prices(axes: Axes, prices: Sequence[Row], y: float) -> Axes:
    """Draws one strategy under all kinds of rules, with 95% intervals where costs are drawn, in a row of its own."""
    for price in prices:
        number = KINDS.index(price["kind"])
        at, look = y + (number - (len(KINDS) - 1) / 2) * _APART, _LOOKS[price["kind"]]
        low, high = price["regret_low"], price["regret_high"]
        if low is not None and high is not None:
            axes.plot([max(low, _LEAST), max(high, _LEAST)], [at, at], color=look["color"], linewidth=0.8)
        axes.plot([max(price["regret"], _LEAST)], [at], markersize=3, linestyle="none", clip_on=False, **look)
    return axes


def _by_theta(prices: Sequence[Row]) -> float:
    return next(price["regret"] for price in prices if price["kind"] == THRESHOLD)


def _rows(axes: Axes, count: int) -> None:
    """Thin lines between strategies."""
    for y in range(count - 1):
        axes.axhline(y + 0.5, color=OTHERS, linewidth=0.3, zorder=0)


def _axes(axes: Axes, names: Sequence[str]) -> None:
    axes.set_xscale("log")
    axes.set_xlim(_LEAST, _MOST)
    axes.set_xticks([0.001, 0.01, 0.1, 1], ["0.001", "0.01", "0.1", "1"])
    axes.minorticks_off()
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)


def _key(figure: Figure) -> None:
    marks = [Line2D([], [], linestyle="none", label=kind, **_LOOKS[kind]) for kind in KINDS]
    key(figure, marks, above=True)
