"""Figures of a sensitivity study: a forest plot of all options, and effects of pairs beyond their sum.

Data are the sources of `summary.summarise`.
"""

from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from ..page.figure_sizes import TWO_COLUMNS, key, new_figure
from ..page.figure_style import DECIDED, OTHERS, TRUE, axis_label, label_panel, styled
from ..page.numbers import bounded, number
from ..page.page import Row
from .findings import VERDICTS

_ROW = 0.135  # inches
_MARKS: dict[str, dict[str, Any]] = {
    "conclusion": {"color": DECIDED, "marker": "s"},
    "numbers": {"color": TRUE, "marker": "o"},
    "not decided": {"color": "#555555", "marker": "o", "markerfacecolor": "white"},
    "nothing": {"color": OTHERS, "marker": "D"},
}
"""Verdicts, told apart by colour and by shape."""
_BAND = "0.93"
_CHARACTER = 0.055  # width in labels of ticks, of the width of a panel
_WRAP = 20


@styled
def forest(source: Row) -> Figure:
    """Effect of every option for the last policy, strongest choices on top.

    Thick lines are 95% intervals, thin ones hold all together; grey bands are changes that do not matter. Axes are
    linear in the band and logarithmic beyond.
    """
    rows = _rows(source)
    policy = source["policies"][-1]
    panels = {
        "what_error": axis_label("object error", source["what_unit"]).replace(" (", "\n("),
        "where_error": axis_label("position error", source["where_unit"]).replace(" (", "\n("),
        "taps": "taps\n",
        "factor": "calibration\n(factor)",
    }
    if source["grid"]["L"] == 1:
        del panels["where_error"]
    figure, axes = new_figure(
        TWO_COLUMNS, 1.0 + _ROW * len(rows), 1, len(panels), sharey=True, of_text=True, whole=True
    )
    for axis, letter, (quantity, label) in zip(axes[0], "ABCD", panels.items(), strict=False):
        plot_forest(axis, rows, f"{policy}_{quantity}", source["limits"][f"{policy}_{quantity}"])
        label_panel(axis, letter)
        axis.set_xlabel(label)
    axes[0, 0].set_yticks(range(len(rows)), [name for name, _ in rows], fontsize="small")
    for label, (_, row) in zip(axes[0, 0].get_yticklabels(), rows, strict=True):
        label.set_fontweight("bold" if row is None else "normal")
    figure.supxlabel(f"{policy} perception: option − default (calibration: option / default)", fontsize="medium")
    _key(figure)
    return figure


def plot_forest(axes: Axes, rows: Sequence[tuple[str, Row | None]], name: str, bound: float) -> Axes:
    """Draws one mark with both intervals for each option; headings have none.

    Args:
        axes: Where to.
        rows: Names, and numbers where it is an option.
        name: Of the quantity in the rows.
        bound: Changes that do not matter; of the logarithm where the quantity is a factor.
    """
    low, high = _scaled_axis(axes, rows, name, bound)
    for y, (_, row) in enumerate(rows):
        if row is None or row[name] is None:
            continue
        mark = _MARKS[row["verdict"]]
        for ends, width in ((("_least", "_most"), 0.5), (("_low", "_high"), 1.6)):
            known = [row[name + end] for end in ends]
            if None not in known:
                axes.plot(np.clip(known, low, high), [y, y], color=mark["color"], linewidth=width, zorder=2)
        axes.plot([row[name]], [y], **mark, linestyle="none", markersize=3.2, zorder=3)
    axes.set_ylim(len(rows) - 0.3, -0.7)
    axes.tick_params(axis="y", length=0)
    return axes


@styled
def interactions(source: Row) -> Figure | None:
    """Effect of pairs of options on the object error beyond their sum; `None` without pairs."""
    pairs = source["pairs"]
    if not pairs:
        return None
    names = list(dict.fromkeys(end for pair in pairs for end in _ends(pair)))
    n = len(names)
    figure, axes = new_figure(min(TWO_COLUMNS, 2.6 + 1.1 * n), 0.75 * n + 0.6, of_text=True)
    label = axis_label("object error beyond the sum", source["what_unit"])
    plot_interactions(axes[0, 0], pairs, names, label, source["limits"][f"{source['policies'][-1]}_what_error"])
    return figure


def plot_interactions(
    axes: Axes, pairs: Sequence[Row], names: Sequence[tuple[str, str]], label: str, bound: float
) -> Axes:
    """Draws the lower triangle: numbers with 95% intervals, bold if significant for all pairs together.

    Args:
        axes: Where to.
        pairs: Numbers.
        names: Choice and option of each row and column.
        label: Of the colours.
        bound: Change up to which colours are linear; beyond they are logarithmic.
    """
    n = len(names)
    values = np.full((n, n), np.nan)
    for pair in pairs:
        i, j = sorted(map(names.index, _ends(pair)))
        values[j, i] = pair["beyond"]
        low, high = pair["beyond_low"], pair["beyond_high"]
        axes.text(
            i,
            j,
            bounded(pair["beyond"], low, high).replace(" [", "\n["),
            ha="center",
            va="center",
            fontsize="small",
            fontweight="bold" if pair["sure"] else "normal",
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.85, "linewidth": 0},
        )
    reach = max(float(np.nanmax(np.abs(values))), 2 * bound)
    shown = np.ma.masked_invalid(values)
    scale = SymLogNorm(bound, linscale=0.6, vmin=-reach, vmax=reach)
    image = axes.imshow(shown, cmap="PuOr", norm=scale, aspect="auto")
    ticks = _ticks(bound, reach)
    bar = axes.figure.colorbar(image, ax=axes, label=label, shrink=0.8, ticks=ticks)
    bar.set_ticklabels([number(tick) for tick in ticks])
    bar.minorticks_off()
    words = [f"{fill(choice, _WRAP)}:\n{option}" for choice, option in names]
    axes.set_xticks(range(n - 1), words[:-1])
    axes.set_yticks(range(1, n), words[1:])
    axes.set_xlim(-0.5, n - 1.5)
    axes.set_ylim(n - 0.5, 0.5)
    axes.tick_params(length=0)
    axes.spines[["left", "bottom"]].set_visible(False)
    return axes


def _ends(pair: Row) -> list[tuple[str, str]]:
    """Choice and option of both."""
    return [(one["choice"], one["option"]) for one in (pair["first"], pair["second"])]


def _ticks(bound: float, reach: float) -> list[float]:
    """Powers of ten beyond a bound up to a reach, and between them where there are few, on both sides of zero."""
    powers = [10.0**k for k in range(-4, 5) if bound < 10.0**k <= reach]
    more = powers if len(powers) > 1 else [m * 10.0**k for k in range(-4, 5) for m in (1, 2, 5)]
    ends = [tick for tick in more if bound < tick <= reach]
    return [*(-tick for tick in reversed(ends)), 0.0, *ends]


def _rows(source: Row) -> list[tuple[str, Row | None]]:
    """A heading for every choice, with its default, and a row for every option."""
    rows: list[tuple[str, Row | None]] = []
    for choice in source["choices"]:
        rows.append((f"{choice['name']} ({choice['default']})", None))
        rows += [(option["name"], option) for option in choice["options"]]
    return rows


def _scaled_axis(axes: Axes, rows: Sequence[tuple[str, Row | None]], name: str, bound: float) -> tuple[float, float]:
    """Sets scale, band, ends and ticks; what lies beyond the ends of all 95% intervals is to be cut there."""
    keys = (name, f"{name}_low", f"{name}_high")
    known = [row[key] for _, row in rows if row is not None for key in keys if row[key] is not None]
    factor = name.endswith("factor")
    if factor:
        band, middle = (np.exp(-bound), np.exp(bound)), 1.0
        ends = min([0.5, *known]) / 1.25, max([2.0, *known]) * 1.25
        axes.set_xscale("log")
        ticks = [10.0**k for k in range(-300, 301)]
    else:
        band, middle = (-bound, bound), 0.0
        ends = 1.4 * min([-2 * bound, *known]), 1.4 * max([2 * bound, *known])
        axes.set_xscale("symlog", linthresh=bound, linscale=0.6)
        decades = [10.0**k for k in range(-4, 5) if 10.0**k > bound]
        ticks = [*(-tick for tick in decades), 0.0, *decades]
    axes.axvspan(*band, color=_BAND, linewidth=0)
    axes.axvline(middle, color="black", linewidth=0.6)
    axes.set_xlim(*ends)
    axes.xaxis.set_major_locator(FixedLocator(_apart(axes, [tick for tick in ticks if ends[0] <= tick <= ends[1]])))
    axes.tick_params(axis="x", labelsize="small")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
    return ends


def _apart(axes: Axes, ticks: Sequence[float]) -> list[float]:
    """The middle tick and others that leave room for their labels, the outermost first."""
    at = axes.transAxes.inverted().transform(axes.transData.transform([(tick, 0.0) for tick in ticks]))[:, 0]
    length = [len(number(tick)) for tick in ticks]
    middle = ticks.index(1.0 if 1.0 in ticks and 0.0 not in ticks else 0.0)
    kept = [middle]
    for i in sorted(range(len(ticks)), key=lambda i: (-abs(at[i] - at[middle]), i)):
        if all(abs(at[i] - at[j]) >= _CHARACTER * (1 + (length[i] + length[j]) / 2) for j in kept):
            kept.append(i)
    return [ticks[i] for i in sorted(kept)]


def _key(figure: Figure) -> None:
    lines = [Line2D([], [], **mark, markersize=4, linewidth=1.6, label=VERDICTS[name]) for name, mark in _MARKS.items()]
    key(figure, lines, above=True)
