"""Figures of a comparison of strategies: curves, differences at equal taps, stopping rules and trajectories.

Data are those of `strategies_summary.summarise`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..models.classes import ClassGrid
from .figure_episodes import plot_trajectories
from .figure_style import (
    ACTIVE,
    OTHERS,
    PASSIVE,
    TWO_COLUMNS,
    axis_label,
    colours,
    label_panel,
    new_figure,
    styled,
)
from .strategies_findings import FIXED, PAPER, TAPS
from .strategies_study import BASE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BLUE, _ORANGE, _GREEN, _PURPLE = "#0072b2", "#d55e00", "#009e73", "#aa4499"
_DASHED, _DOTTED = (0, (4, 1.5)), (0, (1, 1.2))
_LOOKS: dict[str, dict[str, Any]] = {
    "passive": {"color": PASSIVE, "marker": "v"},
    "random": {"color": OTHERS, "marker": "x"},
    "step": {"color": OTHERS, "marker": "+", "linestyle": _DASHED},
    BASE: {"color": ACTIVE, "marker": "o", "linewidth": 1.6},
    "fixation:0.8": {"color": ACTIVE, "marker": "o", "markerfacecolor": "white", "linestyle": _DASHED},
    "info-what": {"color": _BLUE, "marker": "s"},
    "info-where": {"color": _ORANGE, "marker": "D"},
    "info-joint": {"color": _GREEN, "marker": "^"},
    "info-what-per-mm": {"color": _BLUE, "marker": "s", "markerfacecolor": "white", "linestyle": _DASHED},
    "info-what-per-s": {"color": _BLUE, "marker": "s", "markerfacecolor": "white", "linestyle": _DOTTED},
    "two-taps": {"color": _PURPLE, "marker": "P"},
    "table": {"color": _PURPLE, "marker": "p", "markerfacecolor": "white", "linestyle": _DASHED},
}
"""Strategies, told apart by colour, line and mark."""
_ROW = 0.19  # inches
_COLUMNS = 4


@styled
def curves(source: Mapping[str, Any]) -> Figure:
    """Object (A, B) and position errors (C, D) against mean taps and way, along the paper's thresholds."""
    figure, axes = new_figure(TWO_COLUMNS, 4.6, 2, 2, sharey="row", sharex="col")
    drawn = source["powers"][0]["curves"][PAPER]
    rows = (
        ("what_error", "object error", source["what_unit"]),
        ("where_error", "position error", source["where_unit"]),
    )
    for panels, letters, (quantity, words, unit) in zip(axes, ("AB", "CD"), rows, strict=True):
        for panel, letter, across in zip(panels, letters, ("taps", "way"), strict=True):
            for name, points in drawn.items():
                plot_curve(panel, points, across, quantity, _look(name))
            label_panel(panel, letter)
        panels[0].set_ylabel(axis_label(words, unit))
    axes[0, 0].set_xscale("log")
    most = max(point["taps"] for points in drawn.values() for point in points)
    ticks = [tick for tick in (1, 2, 3, 5, 10, 20, 50, 100) if tick <= 1.02 * most]
    axes[0, 0].set_xticks(ticks, [str(tick) for tick in ticks])
    axes[0, 0].minorticks_off()
    _way_axis(axes[1, 1], drawn)
    for panels, (quantity, *_) in zip(axes, rows, strict=True):
        most = max(p[quantity] for points in drawn.values() for p in points if p[quantity] is not None)
        panels[0].set_ylim(0, 1.1 * most or 1.0)
    axes[1, 0].set_xlabel("mean number of taps")
    axes[1, 1].set_xlabel(axis_label("mean way of the sensor", source["where_unit"]))
    _key(figure, list(drawn))
    return figure


def _way_axis(axes: Axes, drawn: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
    """Linear up to where most strategies begin and logarithmic beyond, with round numbers."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator  # noqa: PLC0415

    most = max(point["way"] for points in drawn.values() for point in points) or 1.0
    unit = 10.0 ** np.floor(np.log10(most)) / 10
    axes.set_xscale("symlog", linthresh=unit)
    axes.xaxis.set_major_locator(FixedLocator([0, *(unit * np.array([1, 3, 10, 30])).tolist()]))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_xlim(-0.1 * unit, 1.3 * most)


def plot_curve(
    axes: Axes, points: Sequence[Mapping[str, Any]], across: str, quantity: str, look: Mapping[str, Any]
) -> Axes:
    """Draws one curve over the levels of a rule, with the 95 % interval of its last point."""
    known = [point for point in points if point[quantity] is not None]
    x, y = ([point[name] for point in known] for name in (across, quantity))
    axes.plot(x, y, **look)
    if known and known[-1][f"{quantity}_low"] is not None:
        axes.vlines(
            x[-1],
            max(known[-1][f"{quantity}_low"], 0),
            known[-1][f"{quantity}_high"],
            color=look["color"],
            linewidth=0.6,
        )
    return axes


@styled
def equal_taps(source: Mapping[str, Any]) -> Figure:
    """Object error less that of the fixation point at equal taps, by threshold (A to D) and by number (E to H)."""
    first = source["powers"][0]
    names = [name for name in first["strategies"] if name != BASE]
    figure, axes = new_figure(TWO_COLUMNS, 1.2 + 2 * _ROW * len(names), 2, len(TAPS), sharey=True, sharex=True)
    ends = []
    for panels, letters, family in zip(axes, ("ABCD", "EFGH"), (PAPER, FIXED), strict=True):
        for axis, letter, taps in zip(panels, letters, TAPS, strict=True):
            found = {row["strategy"]: row for row in first["equal"][family] if row["taps"] == taps}
            axis.axvline(0, color="black", linewidth=0.6)
            for y, name in enumerate(names):
                plot_interval(axis, found[name], "what_error_difference", y, _look(name))
                ends += [found[name][f"what_error_difference{end}"] for end in ("", "_low", "_high")]
            label_panel(axis, letter, f"mean {taps} taps" if family == PAPER else f"{taps} taps each")
    known = [end for end in ends if end is not None]
    axes[0, 0].set_xlim(1.25 * min([0, *known]) - 0.05, 1.25 * max([0, *known]) + 0.05)
    axes[0, 0].set_yticks(range(len(names)), names)
    axes[0, 0].set_ylim(len(names) - 0.4, -0.6)
    figure.supxlabel(axis_label("object error less that of the fixation point", source["what_unit"]), fontsize=8)
    return figure


def plot_interval(axes: Axes, row: Mapping[str, Any], name: str, y: float, look: Mapping[str, Any]) -> Axes:
    """Draws an estimate with both intervals in a row of its own; what is not known is left out."""
    if row[name] is None:
        axes.text(0, y, " not reached", fontsize=6, color="#555555", va="center")
        return axes
    for ends, width in ((("_least", "_most"), 0.5), (("_low", "_high"), 1.6)):
        known = [row[name + end] for end in ends]
        if None not in known:
            axes.plot(known, [y, y], color=look["color"], linewidth=width, zorder=2)
    axes.plot([row[name]], [y], **{**look, "linestyle": "none", "markersize": 3.6, "zorder": 3})
    return axes


@styled
def stopping(source: Mapping[str, Any]) -> Figure:
    """Stopping rules with the fixation point: object error (A) and null decisions (B) against mean taps."""
    figure, axes = new_figure(TWO_COLUMNS, 2.9, 1, 2, sharex=True)
    drawn = source["powers"][0]["curves"]
    palette = colours(len(drawn))
    for (rule, by_strategy), colour, marker in zip(drawn.items(), palette, "osD^vP<>", strict=False):
        look: dict[str, Any] = {"color": ACTIVE if rule == PAPER else colour, "marker": marker, "label": rule}
        plot_curve(axes[0, 0], by_strategy[BASE], "taps", "what_error", look)
        plot_curve(axes[0, 1], by_strategy[BASE], "taps", "given_up", look)
    for panel, letter in zip(axes[0], "AB", strict=True):
        label_panel(panel, letter)
        panel.set_ylim(bottom=0)
        panel.set_xlabel("mean number of taps")
    axes[0, 0].set_ylabel(axis_label("object error of the answers", source["what_unit"]))
    axes[0, 1].set_ylabel("share of null decisions")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", handlelength=2.2)
    return figure


@styled
def trajectories(source: Mapping[str, Any]) -> Figure:
    """Where the sensor stood in trials of one data set under each strategy, up to their decisions; Fig. 6."""
    names = list(source["paths"])
    rows = -(-len(names) // _COLUMNS)
    figure, axes = new_figure(TWO_COLUMNS, 1.55 * rows + 0.3, rows, _COLUMNS, sharex=True, sharey=True)
    grid = ClassGrid(np.array(source["grid"]["where_value"]), source["grid"]["where_unit"], None, (("object",),))
    for panel, name in zip(axes.flat, names, strict=False):
        plot_trajectories(panel, np.array(source["paths"][name]), grid)
        if name.startswith(BASE):
            panel.axhline(
                grid.where_value[source["fixation"]], color=PASSIVE, linewidth=0.8, linestyle=(0, (4, 2)), zorder=0
            )
        panel.set_title(name)
        panel.set_xlabel("")
    for panel in axes.flat[len(names) :]:
        panel.set_visible(False)
    figure.supxlabel("tap", fontsize=8)
    figure.supylabel(axis_label("position", source["where_unit"]), fontsize=8)
    return figure


def _look(name: str) -> dict[str, Any]:
    own: dict[str, Any] = _LOOKS.get(name, {"color": "#882255", "marker": "*"})
    return {"linewidth": 1.0, "markersize": 3.2} | own


def _key(figure: Figure, names: Sequence[str]) -> None:
    from matplotlib.lines import Line2D  # noqa: PLC0415

    lines = [Line2D([], [], **_look(name), label=name) for name in names]
    figure.legend(handles=lines, loc="outside right upper", handlelength=2.6)
