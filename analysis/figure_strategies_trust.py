"""What is left of the gain of information where the model is too sure, as a figure.

Data are those of `strategies_summary.summarise`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .figure_style import ACTIVE, OTHERS, TWO_COLUMNS, colours, label_panel, new_figure, styled
from .strategies_findings import INFORMED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PALETTE = (ACTIVE, "#0072b2", "#d55e00", "#009e73", "#aa4499", "#e69f00", "#56b4e9")
_MOST = 1e4  # miscalibration is shown; beyond, beliefs are one but for rounding
_POWERS = {"J": "o", "learned": "^", "none": "s"}
"""Marks of the roots of the likelihood."""


@styled
def trust(sources: Sequence[Mapping[str, Any]]) -> Figure:
    """How far the fixation point and information gain are misled by the model, and what is left of the gain.

    A: gain over the fixation point against the miscalibration there; B: miscalibration of both; C: information that was
    promised beyond what was told, of both. On the dashed lines both are misled alike. Intervals are cut at the ends.
    """
    figure, axes = new_figure(TWO_COLUMNS, 3.1, 1, 3)
    pairs = (("base_factor", "gain"), ("base_factor", "factor"), ("base_excess", "excess"))
    for panel, letter, (across, up) in zip(axes[0], "ABC", pairs, strict=True):
        shown = []
        for source, colour in zip(sources, _sources(len(sources)), strict=True):
            for power in source["powers"]:
                row = next((one for one in power["trust"] if one["strategy"] == INFORMED[0]), None)
                if row is not None and (row["base_factor"] or 0.0) < _MOST:
                    plot_cross(panel, row, across, up, {"color": colour, "marker": _POWERS[power["power"]]})
                    shown.append((row[across], row[up]))
        _zoom(panel, [pair for pair in shown if None not in pair], same=up != "gain", factor=up == "factor")
        label_panel(panel, letter)
    gain, factor, excess = axes[0]
    gain.axhline(0, color="black", linewidth=0.6, zorder=0)
    gain.set_xscale("log")
    gain.set(xlabel="miscalibration of fixation", ylabel="P(wrong): fixation less info-what")
    factor.set(xlabel="miscalibration of fixation", ylabel="miscalibration of info-what")
    excess.set(xlabel="promised less told, fixation (nats)", ylabel="promised less told, info-what (nats)")
    _trust_key(figure, sources)
    return figure


def _zoom(axes: Axes, points: Sequence[tuple[float, float]], *, same: bool, factor: bool) -> None:
    """Shows all points, not all intervals; where both axes are of the same thing they are alike, with a diagonal."""
    if not points:
        return
    if not same:
        across = [x for x, _ in points]
        axes.set_xlim(min(across) / 2, 2 * max(across))
        return
    low, high = np.min(points), np.max(points)
    if factor:
        axes.set(xscale="log", yscale="log")
        ends = low / 2, 2 * high
    else:
        axes.set_xscale("symlog", linthresh=1)
        axes.set_yscale("symlog", linthresh=1)
        ends = min(2 * low, -0.5), max(2 * high, 1.0)
        ticks = [tick for tick in (-100, -10, -1, 0, 1, 10, 100, 1000) if ends[0] <= tick <= ends[1]]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
    axes.plot(ends, ends, color=OTHERS, linestyle=(0, (4, 1.5)), zorder=0)
    axes.set(xlim=ends, ylim=ends)


def _sources(n: int) -> list[Any]:
    """Colours of kinds of data."""
    return list(_PALETTE[:n]) if n <= len(_PALETTE) else colours(n)


def plot_cross(axes: Axes, row: Mapping[str, Any], across: str, up: str, look: Mapping[str, Any]) -> Axes:
    """Draws a point with its 95 % intervals in both directions, if it is known."""
    x, y = row[across], row[up]
    if x is None or y is None:
        return axes
    for name, draw, at in ((across, axes.hlines, y), (up, axes.vlines, x)):
        low, high = row[f"{name}_low"], row[f"{name}_high"]
        if low is not None and high is not None:
            draw(at, low, high, color=look["color"], linewidth=0.6)
    axes.plot([x], [y], linestyle="none", markersize=4.5, **look)
    return axes


def _trust_key(figure: Figure, sources: Sequence[Mapping[str, Any]]) -> None:
    from matplotlib.lines import Line2D  # noqa: PLC0415

    palette = _sources(len(sources))
    lines = [Line2D([], [], color=c, linewidth=3, label=one["name"]) for one, c in zip(sources, palette, strict=True)]
    shown = dict.fromkeys(power["power"] for source in sources for power in source["powers"])
    marks = [
        Line2D([], [], color="black", linestyle="none", marker=_POWERS[power], label=f"power {power}")
        for power in shown
    ]
    figure.legend(handles=lines + marks, loc="outside upper center", ncols=5, columnspacing=1.2)
