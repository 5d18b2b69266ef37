"""Figure of the gain of information strategies against the overconfidence of the model.

Data are those of `summary.summarise`.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..page.figure_sizes import TWO_COLUMNS, key, new_figure
from ..page.figure_style import ACTIVE, OTHERS, colours, label_panel, short, styled
from ..page.page import Row
from .findings import INFORMED

_PALETTE = (ACTIVE, "#0072b2", "#d55e00", "#009e73", "#aa4499", "#e69f00", "#56b4e9")
_LEAST, _MOST = 1e-3, 1e4  # miscalibration is shown; beyond, beliefs are one but for rounding
_POWERS = {"J": "o", "learned": "^", "none": "s"}
"""Marks of the roots of the likelihood."""
_PAIRS = (("base_factor", "gain"), ("base_factor", "factor"), ("base_excess", "excess"))
"""What is shown in each panel against what."""
_DASHED: dict[str, Any] = {"color": OTHERS, "linestyle": (0, (4, 1.5)), "zorder": 0}
_ARROWS: dict[str, Any] = {"linewidths": 0, "clip_on": False, "zorder": 4}


@styled
def trust(sources: Sequence[Row]) -> Figure:
    """How far the fixation point and information gain are misled by the model, and what is left of the gain.

    A: gain over the fixation point against the miscalibration there; B: miscalibration of both; C: information that was
    promised beyond what was told, of both. On the dashed lines both are alike. Arrowheads are at what a panel cuts off.
    """
    figure, axes = new_figure(TWO_COLUMNS, 3.2, 1, 3)
    rows = [
        (row, {"color": colour, "marker": _POWERS[power["power"]]})
        for source, colour in zip(sources, _sources(len(sources)), strict=True)
        for power in source["powers"]
        for row in power["trust"]
        if row["strategy"] == INFORMED[0]
    ]
    for panel, letter, (across, up) in zip(axes[0], "ABC", _PAIRS, strict=True):
        shown = [(row, look) for row, look in rows if row[across] is not None and row[up] is not None]
        _set_up(panel, [row for row, _ in shown], across, up)
        for row, look in shown:
            plot_cross(panel, row, across, up, look)
        if len(shown) < len(rows):
            _missing(panel, len(rows) - len(shown))
        label_panel(panel, letter)
    gain, factor, excess = axes[0]
    gain.set(xlabel="miscalibration,\nfixation", ylabel="P(wrong): fixation − info-what")
    factor.set(xlabel="miscalibration,\nfixation", ylabel="miscalibration, info-what")
    excess.set(
        xlabel="expected − gained,\nfixation (nats)",
        ylabel="expected − gained, info-what (nats)",
    )
    _trust_key(figure, sources)
    return figure


def _set_up(axes: Axes, rows: Sequence[Row], across: str, up: str) -> None:
    """Scales, ends and numbers of both axes, and the line on which both strategies are alike."""
    if up == "gain":
        _factor_axis(axes, "x", _factor_ends(rows, [across]))
        gains = [row[f"gain{end}"] or 0.0 for row in rows for end in ("", "_low", "_high")]
        axes.set_ylim(1.1 * min([-0.02, *gains]), 1.1 * max([0.02, *gains]))
        axes.axhline(0, **_DASHED)
        return
    ends = _factor_ends(rows, [across, up]) if up == "factor" else _excess_ends(rows, [across, up])
    for axis in ("x", "y"):
        if up == "factor":
            _factor_axis(axes, axis, ends)
        else:
            _excess_axis(axes, axis, ends)
    axes.plot(ends, ends, **_DASHED)


def _factor_ends(rows: Sequence[Row], names: Sequence[str]) -> tuple[float, float]:
    """Ends that hold all miscalibrations that can be shown with a margin, and 1; not all intervals."""
    values = np.clip([1.0, *(row[name] for row in rows for name in names)], _LEAST, _MOST)
    return float(values.min()) / 3, 3 * float(values.max())


def _excess_ends(rows: Sequence[Row], names: Sequence[str]) -> tuple[float, float]:
    """Ends that hold all information with a margin, and 0; not all intervals."""
    values = [0.0, *(row[name] for row in rows for name in names)]
    return min(2.5 * min(values), -0.5), max(2.5 * max(values), 1.0)


def _factor_axis(axes: Axes, axis: str, ends: tuple[float, float]) -> None:
    """Logarithmic, with few round numbers."""
    decades = [10.0**power for power in range(-4, 6)]
    ticks = _between(decades, ends)
    if len(ticks) < 3:
        ticks = _between(sorted([*decades, *(3 * tick for tick in decades)]), ends)
    axes.set(**{f"{axis}scale": "log", f"{axis}lim": ends})
    _numbers(axes, axis, ticks[:: -(-len(ticks) // 4)])


def _excess_axis(axes: Axes, axis: str, ends: tuple[float, float]) -> None:
    """Linear up to one nat and logarithmic beyond."""
    ticks = _between((-1000, -100, -10, -1, 0, 1, 10, 100, 1000), ends)
    if len(ticks) < 4:
        ticks = _between((-10, -3, -1, 0, 1, 3, 10), ends)
    getattr(axes, f"set_{axis}scale")("symlog", linthresh=1)
    axes.set(**{f"{axis}lim": ends})
    _numbers(axes, axis, ticks)


def _between(ticks: Sequence[float], ends: tuple[float, float]) -> list[float]:
    return [tick for tick in ticks if ends[0] <= tick <= ends[1]]


def _numbers(axes: Axes, axis: str, ticks: Sequence[float]) -> None:
    signed = [f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks]
    getattr(axes, f"set_{axis}ticks")(ticks, signed)
    getattr(axes, f"{axis}axis").minorticks_off()


def _sources(n: int) -> list[Any]:
    """Colours of kinds of data."""
    return list(_PALETTE[:n]) if n <= len(_PALETTE) else colours(n)


def plot_cross(axes: Axes, row: Row, across: str, up: str, look: Mapping[str, Any]) -> Axes:
    """Draws a known point with its 95% intervals in both directions, moved to the ends of the axes if beyond them.

    What is cut off, of intervals or of the point, has an arrowhead where it is; a point that was moved is hollow.
    """
    colour, (left, right), (bottom, top) = look["color"], axes.get_xlim(), axes.get_ylim()
    x, y = float(np.clip(row[across], left, right)), float(np.clip(row[up], bottom, top))
    for name, draw, at, ends in ((across, axes.hlines, y, (left, right)), (up, axes.vlines, x, (bottom, top))):
        value, low, high = row[name], row[f"{name}_low"], row[f"{name}_high"]
        low, high = (value if low is None or high is None else end for end in (low, high))
        draw(at, *np.clip([low, high], *ends), color=colour, linewidth=0.6)
        for cut, edge, mark in ((low < ends[0], ends[0], 0), (high > ends[1], ends[1], 1)):
            if cut:
                place, marks = ((edge, at), "<>") if name == across else ((at, edge), "v^")
                axes.scatter(*place, s=12, marker=marks[mark], color=colour, **_ARROWS)
    inside = (x, y) == (row[across], row[up])
    face = colour if inside else "white"
    axes.plot([x], [y], linestyle="none", markersize=4.5, markerfacecolor=face, clip_on=False, **look)
    return axes


def _missing(axes: Axes, count: int) -> None:
    """Says how many points a panel cannot show."""
    axes.text(
        0.98,
        0.02,
        f"undefined: {count}",
        transform=axes.transAxes,
        ha="right",
        va="bottom",
        fontsize="small",
        color="#555555",
    )


def _trust_key(figure: Figure, sources: Sequence[Row]) -> None:
    palette = _sources(len(sources))
    names = [one["name"] for one in sources]
    labels = [short(name, names) for name in names]
    lines = [Line2D([], [], color=c, linewidth=3, label=name) for name, c in zip(labels, palette, strict=True)]
    shown = dict.fromkeys(power["power"] for source in sources for power in source["powers"])
    marks = [
        Line2D([], [], color="black", linestyle="none", marker=_POWERS[power], label=f"power {power}")
        for power in shown
    ]
    key(figure, lines + marks, above=True)
