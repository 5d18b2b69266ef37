"""Figures of a comparison of strategies: curves, differences at equal taps, stopping rules and trajectories.

Data are those of `summary.summarise`. A strategy has one colour in all of them, and the fixation point is
black. Intervals of curves stand right of a panel, in the order of its key, so that none hides another.
"""

from collections.abc import Iterable, Mapping, Sequence
from string import ascii_uppercase
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ...models.grid import ClassGrid
from ..page.figure_curves import read_off
from ..page.figure_episodes import plot_trajectories
from ..page.figure_sizes import TWO_COLUMNS, key, new_figure
from ..page.figure_style import ACTIVE, FIXATION, OTHERS, PASSIVE, axis_label, label_panel, styled
from ..page.page import Row
from .findings import FIXED, LOOK, PAPER, TAPS
from .run import BASE

type Points = Sequence[Row]
"""A curve over the levels of a rule."""

_BLUE, _ORANGE, _GREEN, _PURPLE = "#0072b2", "#d55e00", "#009e73", "#aa4499"
_DASHED, _DOTTED, _BROKEN = (0, (4, 1.5)), (0, (1, 1.2)), (0, (5, 1.2, 1, 1.2))
_LOOKS: dict[str, dict[str, Any]] = {
    BASE: {"color": ACTIVE, "marker": "o", "linewidth": 1.6},
    "passive": {"color": PASSIVE, "marker": "v"},
    "random": {"color": _BLUE, "marker": "x", "linestyle": _DASHED},
    "step": {"color": _GREEN, "marker": "+", "linestyle": _BROKEN},
    "fixation:0.8": {"color": _PURPLE, "marker": "h", "linestyle": _DOTTED},
    "info-what": {"color": _BLUE, "marker": "s"},
    "info-where": {"color": _ORANGE, "marker": "D", "linestyle": _DASHED},
    "info-joint": {"color": _GREEN, "marker": "^", "linestyle": _BROKEN},
    "info-what-per-mm": {"color": _BLUE, "marker": "<"},
    "info-what-per-s": {"color": _ORANGE, "marker": ">", "linestyle": _DASHED},
    "table": {"color": _PURPLE, "marker": "p", "linestyle": _DOTTED},
}
"""Strategies: each mark is used once, each colour and line once in a group."""
_GROUPS = {
    "no look-ahead": ("passive", "random", "step", "fixation:0.8"),
    "one tap ahead": ("info-what", "info-where", "info-joint"),
    "travel-aware, table": ("info-what-per-mm", "info-what-per-s", "table"),
}
_PANELS = (("what_error", "taps"), ("where_error", "taps"), ("what_error", "way"), ("where_error", "way"))
"""Rows of `curves`: what is shown and what it is shown against."""
_RULES = tuple(zip((_BLUE, _ORANGE, _GREEN, _PURPLE), ("s", "D", "^", "P"), strict=True))
_FEW_TICKS = (1, 1.2, 1.5, 2, 2.5)
_TICKS = (1, 2, 3, 5, 10, 20, 50, 100, 200, 500, 1000)
_ROW = 0.19  # inches
_COLUMNS = 4
_STRIP, _APART = 0.05, 0.05  # where intervals begin right of a panel, and steps between them, in its widths
_LONG = 4.0  # the largest point so often is as far as a panel goes for intervals
_NOTE: dict[str, Any] = {"fontsize": "small", "color": "#555555"}


@styled
def curves(source: Row) -> Figure:
    """Object and position errors against mean taps and distance, along the thresholds: a column for each group."""
    drawn = source["powers"][0]["curves"][PAPER]
    groups = grouped(drawn)
    figure, axes = new_figure(TWO_COLUMNS, 7.4, len(_PANELS), len(groups), sharey="row", whole=True)
    letters = iter(ascii_uppercase)
    for panels, (quantity, across) in zip(axes, _PANELS, strict=True):
        panels[0].set_ylim(0, _top(drawn.values(), quantity))
        for panel, names in zip(panels, groups.values(), strict=True):
            for place, name in enumerate((BASE, *names)):
                plot_curve(panel, drawn[name], across, quantity, _look(name), "threshold")
                plot_end(panel, drawn[name], quantity, place, _look(name))
            label_panel(panel, next(letters))
            _across(panel, drawn.values(), across)
        words = "object error" if quantity == "what_error" else "position error"
        panels[0].set_ylabel(axis_label(words, source[quantity.replace("error", "unit")]).replace(" (", "\n("))
    most = max(map(len, groups.values()))
    for panel, (title, names) in zip(axes[0], groups.items(), strict=True):
        _group_key(panel, title, (BASE, *names), 1 + most)
    key(figure, [_strip_key("largest threshold")])
    for row, label in ((1, "mean number of taps"), (3, axis_label("mean travel of the sensor", source["where_unit"]))):
        axes[row, (len(groups) - 1) // 2].set_xlabel(label)
        for above in axes[row - 1]:
            above.tick_params(labelbottom=False)
    return figure


def grouped(names: Iterable[str]) -> dict[str, list[str]]:
    """Strategies other than the fixation point by group, without empty groups; the last has those of none."""
    *_, last = _GROUPS
    group_of = {name: title for title, members in _GROUPS.items() for name in members}
    found: dict[str, list[str]] = {title: [] for title in _GROUPS}
    for name in names:
        if name != BASE:
            found[group_of.get(name, last)].append(name)
    return {title: members for title, members in found.items() if members} or {"": []}


def plot_curve(
    axes: Axes, points: Points, across: str, quantity: str, look: Mapping[str, Any], level: str = "level"
) -> Axes:
    """Draws one curve over the levels of a rule, which are called so where they are read off."""
    known = [point for point in points if point[quantity] is not None]
    (line,) = axes.plot([point[across] for point in known], [point[quantity] for point in known], **look)
    low, high = (np.array([point.get(f"{quantity}{end}") for point in known], float) for end in ("_low", "_high"))
    read_off(line, [f"{level} {point['level']:g}" for point in known], low=low, high=high)
    return axes


def plot_end(axes: Axes, points: Points, quantity: str, place: int, look: Mapping[str, Any]) -> Axes:
    """Draws the last known point of a curve with its 95% interval, if there is one, in a strip right of the panel.

    What the panel cuts off has an arrowhead.
    """
    known = [point for point in points if point[quantity] is not None]
    if not known or known[-1][f"{quantity}_low"] is None:
        return axes
    last, at = known[-1], 1 + _STRIP + place * _APART
    strip: dict[str, Any] = {"transform": axes.get_yaxis_transform(), "clip_on": False}
    low, high, top = max(last[f"{quantity}_low"], 0), last[f"{quantity}_high"], axes.get_ylim()[1]
    axes.plot([at, at], [low, min(high, top)], color=look["color"], linewidth=0.8, **strip)
    if high > top:
        axes.scatter([at], [top], s=9, marker="^", color=look["color"], linewidths=0, **strip)
    axes.plot([at], [last[quantity]], **{**look, "linestyle": "none", "markersize": 2.6}, **strip)
    return axes


def _strip_key(level: str) -> Line2D:
    """Says what stands right of the panels."""
    words = f"right of a panel: the point of the {level} with its 95% interval"
    return Line2D([], [], color="#555555", marker="|", markersize=9, linestyle="none", label=words)


def _top(drawn: Iterable[Points], quantity: str) -> float:
    """The end of an axis that holds all points, and the intervals of the last ones unless they are very long."""
    known = [[point for point in points if point[quantity] is not None] for points in drawn]
    most = max([0.0, *(point[quantity] for points in known for point in points)])
    ends = [point[f"{quantity}_high"] or 0.0 for points in known for point in points[-1:]]
    return 1.06 * max(most, min(_LONG * most, max([0.0, *ends]))) or 1.0


def _across(axes: Axes, drawn: Iterable[Points], across: str) -> None:
    """Sets up the axis of taps or way."""
    most = max(point[across] for points in drawn for point in points)
    if across == "taps":
        _taps_axis(axes, most)
    else:
        _way_axis(axes, most or 1.0)


def _taps_axis(axes: Axes, most: float) -> None:
    """Logarithmic, with round numbers."""
    ticks = [tick for tick in (_FEW_TICKS if most < 3 else _TICKS) if tick <= 1.02 * most]
    axes.set_xscale("log")
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xlim(0.93, max(1.07 * most, 1.3))


def _way_axis(axes: Axes, most: float) -> None:
    """Linear up to its first number and logarithmic beyond."""
    unit = 10.0 ** np.floor(np.log10(most)) / 10
    ticks = [0.0, *(unit * step for step in (1, 3, 10, 30) if unit * step <= 1.2 * most)]
    axes.set_xscale("symlog", linthresh=unit)
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xlim(-0.1 * unit, 1.2 * most)


@styled
def equal_taps(source: Row) -> Figure:
    """Object error minus that of the fixation point at equal taps, by threshold (A to D) and by number (E to H)."""
    first = source["powers"][0]
    names = [name for name in first["strategies"] if name != BASE]
    figure, axes = new_figure(
        TWO_COLUMNS, 1.5 + 2 * _ROW * len(names), 2, len(TAPS), sharey=True, sharex=True, of_text=True, whole=True
    )
    rows = [row for family in (PAPER, FIXED) for row in first["equal"][family] if row["strategy"] != BASE]
    axes[0, 0].set_xlim(*_ends(rows, _DIFFERENCE))
    axes[0, 0].set_yticks(range(len(names)), names)
    axes[0, 0].set_ylim(len(names) - 0.4, -0.6)
    for panels, letters, family in zip(axes, ("ABCD", "EFGH"), (PAPER, FIXED), strict=True):
        for panel, letter, taps in zip(panels, letters, TAPS, strict=True):
            found = {row["strategy"]: row for row in first["equal"][family] if row["taps"] == taps}
            _differences(panel, [found[name] for name in names])
            label_panel(panel, letter, f"mean {taps} taps" if family == PAPER else f"{taps} taps each")
    figure.supxlabel(axis_label("object error − that of the fixation point", source["what_unit"]), fontsize="medium")
    _interval_key(figure, [row for row in rows if row[_DIFFERENCE] is not None])
    return figure


_DIFFERENCE = "what_error_difference"
_TOGETHER, _OWN = ("_least", "_most"), ("_low", "_high")


def _ends(rows: Sequence[Row], name: str) -> tuple[float, float]:
    """Ends of an axis that holds all differences with their own intervals, and most of what holds together."""
    own, together = (
        [row[name + end] for row in rows for end in ends if row[name + end] is not None]
        for ends in (("", *_OWN), _TOGETHER)
    )
    low, high = min([0.0, *own]), max([0.0, *own])
    more = 0.5 * (high - low)
    low, high = max(min([low, *together]), low - more), min(max([high, *together]), high + more)
    pad = 0.06 * (high - low) or 0.1
    return low - pad, high + pad


def _differences(axes: Axes, rows: Sequence[Row]) -> None:
    """Draws a panel of differences, a row for each strategy."""
    axes.axvline(0, color=OTHERS, linewidth=0.8, zorder=0)
    if all(row[_DIFFERENCE] is None for row in rows):
        axes.text(0.5, 0.5, "not reached", transform=axes.transAxes, ha="center", backgroundcolor="white", **_NOTE)
        return
    for y, row in enumerate(rows):
        plot_interval(axes, row, _DIFFERENCE, y, _look(row["strategy"])["color"])


def plot_interval(axes: Axes, row: Row, name: str, y: float, colour: Any) -> Axes:
    """Draws an estimate with both intervals in a row of its own, hollow where it has none.

    Intervals that the panel cuts get an arrowhead there; what is not known is said to be not reached.
    """
    left, right = axes.get_xlim()
    if row[name] is None:
        side = "left" if -left < right else "right"
        axes.text(0, y, " not reached ", ha=side, va="center", **_NOTE)
        return axes
    for ends, width in ((_TOGETHER, 0.5), (_OWN, 1.8)):
        low, high = (row[name + end] for end in ends)
        if low is None or high is None:
            continue
        axes.plot([max(low, left), min(high, right)], [y, y], color=colour, linewidth=width, zorder=2)
        for cut, edge, mark in ((low < left, left, "<"), (high > right, right, ">")):
            if cut:
                axes.scatter([edge], [y], s=9, marker=mark, color=colour, linewidths=0, clip_on=False)
    hollow = row[f"{name}_low"] is None
    axes.plot([row[name]], [y], "o", color=colour, markersize=3.8, markerfacecolor="white" if hollow else colour)
    return axes


def _interval_key(figure: Figure, rows: Sequence[Row]) -> None:
    """Tells of both intervals and of none, if they are there."""
    black: dict[str, Any] = {"color": ACTIVE, "markersize": 3.8}
    shown = [Line2D([], [], marker="o", linewidth=1.8, label="95% interval", **black)]
    if any(row[f"{_DIFFERENCE}_least"] is not None for row in rows):
        shown.append(Line2D([], [], linewidth=0.5, label="95% simultaneous interval", **black))
    if any(row[f"{_DIFFERENCE}_low"] is None for row in rows):
        words = "no interval: too few or identical units"
        shown.append(Line2D([], [], marker="o", linestyle="none", markerfacecolor="white", label=words, **black))
    key(figure, shown, above=True)


@styled
def stopping(source: Row) -> Figure:
    """Each stopping rule beside the paper's, object error against mean taps, and null decisions; fixation point."""
    drawn = {rule: by_strategy[BASE] for rule, by_strategy in source["powers"][0]["curves"].items()}
    others = [rule for rule in drawn if rule != PAPER]
    rows = -(-(len(others) + 1) // _COLUMNS)
    figure, axes = new_figure(TWO_COLUMNS, 0.5 + 1.6 * rows, rows, _COLUMNS, whole=True)
    *panels, last = axes.flat[: len(others) + 1]
    looks = {rule: {"label": rule, **_rule_look(number)} for number, rule in enumerate(others)}
    top = _top(drawn.values(), "what_error")
    for panel, rule in zip(panels, others, strict=True):
        panel.set_ylim(0, top)
        for place, (points, look) in enumerate(((drawn[PAPER], _PAPER_LOOK), (drawn[rule], looks[rule]))):
            plot_curve(panel, points, "taps", "what_error", look)
            plot_end(panel, points, "what_error", place, look)
        panel.tick_params(labelleft=panel in axes[:, 0])
    _null_decisions(last, {rule: drawn[rule] for rule in others}, looks)
    titles = [*others, "null decisions"]
    for panel, letter, title in zip((*panels, last), ascii_uppercase, titles, strict=False):
        label_panel(panel, letter, title)
        _across(panel, drawn.values(), "taps")
    for panel in axes.flat[len(titles) :]:
        panel.set_visible(False)
    for panel in axes[:, 0]:
        panel.set_ylabel(axis_label("object error", source["what_unit"]))
    figure.supxlabel("mean number of taps", fontsize="medium")
    _paper_key(figure)
    return figure


_PAPER_LOOK: dict[str, Any] = {"color": "#9a9a9a", "marker": "o", "linewidth": 2.6, "markersize": 3.2}


def _rule_look(number: int) -> dict[str, Any]:
    colour, marker = _RULES[number % len(_RULES)]
    return {"color": colour, "marker": marker, "linewidth": 1.0, "markersize": 2.6}


def _null_decisions(axes: Axes, drawn: Mapping[str, Points], looks: Mapping[str, Mapping[str, Any]]) -> None:
    """Draws the share of null decisions of the rules that ever give up."""
    giving = {rule: points for rule, points in drawn.items() if any(point["given_up"] for point in points)}
    axes.set_ylim(0, min(_top(giving.values(), "given_up"), 1.02))
    for place, (rule, points) in enumerate(giving.items()):
        plot_curve(axes, points, "taps", "given_up", looks[rule])
        plot_end(axes, points, "given_up", place, looks[rule])
    axes.set_ylabel("fraction of trials")
    if not giving:
        axes.text(0.5, 0.5, "no rule with null decisions", transform=axes.transAxes, ha="center", **_NOTE)


def _paper_key(figure: Figure) -> None:
    handles = [
        Line2D([], [], label="what (the paper's rule)", **_PAPER_LOOK),
        Line2D([], [], color=ACTIVE, label="rule of the panel"),
        _strip_key("last level"),
    ]
    key(figure, handles, above=True, handlelength=2.6)


@styled
def trajectories(source: Row) -> Figure:
    """Where the sensor stood in trials of one data set under each strategy, up to their decisions; Fig. 6."""
    names = list(source["paths"])
    rows = -(-len(names) // _COLUMNS)
    figure, axes = new_figure(TWO_COLUMNS, 1.6 * rows + 0.3, rows, _COLUMNS, sharex=True, sharey=True)
    grid = ClassGrid(np.array(source["grid"]["where_value"]), source["grid"]["where_unit"], None, (("object",),))
    for panel, name in zip(axes.flat, names, strict=False):
        plot_paths(panel, np.array(source["paths"][name]), grid, _look(name)["color"])
        if name.startswith(BASE):
            value = grid.where_value[source["fixation"]]
            panel.axhline(value, color=FIXATION, linewidth=0.8, linestyle=(0, (4, 2)), zorder=0)
        panel.set_title(name)
        panel.set_xlabel("")
    for number in range(len(names), axes.size):
        axes.flat[number].set_visible(False)
        axes.flat[max(number - _COLUMNS, 0)].tick_params(labelbottom=True)
    _taps_axis(axes[0, 0], max(len(path) for paths in source["paths"].values() for path in paths))
    axes[0, 0].set_xlim(left=0.72)
    low, high = grid.where_value.min(), grid.where_value.max()
    reach = high - low or 1.0
    axes[0, 0].set_ylim(low - 0.08 * reach, high + 0.25 * reach)
    figure.supxlabel(
        "tap (grey: fraction of trials that make it; strokes at the left: trials decided at tap 1)", fontsize="medium"
    )
    figure.supylabel(axis_label("position", grid.where_unit), fontsize="medium")
    return figure


def plot_paths(axes: Axes, paths: NDArray[np.integer], grid: ClassGrid, colour: str) -> Axes:
    """Draws trials as lines, those that decide with their first tap as strokes at its left, and how many go on.

    Args:
        axes: Where to draw.
        paths: Where class at each tap, shape (n, T); -1 after the decision.
        grid: What the classes stand for.
        colour: Of the trials.
    """
    made = (paths >= 0).sum(axis=1)
    if (made > 1).any():
        plot_trajectories(axes, paths[made > 1], grid, colour)
    at = grid.where_value[paths[made == 1, 0]]
    axes.hlines(at, 0.76, 0.92, color=colour, linewidth=1.4, alpha=0.25)
    edges = np.arange(paths.shape[1] + 1) + 0.5
    share = (paths >= 0).mean(axis=0)
    axes.stairs(share, edges, fill=True, color="#e4e4e4", transform=axes.get_xaxis_transform(), zorder=-1)
    told = f"decided: {(made == 1).sum()} at tap 1, {(made <= LOOK).sum()} by tap {LOOK}"
    axes.text(0.98, 0.97, told, transform=axes.transAxes, ha="right", va="top", **_NOTE)
    return axes


def _look(name: str) -> dict[str, Any]:
    own: dict[str, Any] = _LOOKS.get(name, {"color": "#882255", "marker": "*"})
    return {"linewidth": 1.0, "markersize": 2.8} | own


def _group_key(axes: Axes, title: str, names: Sequence[str], rows: int) -> None:
    """Lists strategies above a panel, with empty rows up to this many."""
    lines = [Line2D([], [], **_look(name), label=name) for name in names]
    lines += [Line2D([], [], linestyle="none", label=" ") for _ in range(rows - len(names))]
    axes.legend(
        handles=lines,
        title=title,
        alignment="left",
        loc="lower left",
        bbox_to_anchor=(0, 1.12),
        borderaxespad=0,
        handlelength=2.8,
        labelspacing=0.25,
    )
