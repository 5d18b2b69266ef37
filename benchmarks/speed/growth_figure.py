"""Figure of the growth of time and memory: a column for each size, two rows for each work."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from solidtouch.analysis.page.figure_sizes import TWO_COLUMNS, empty_figure, key
from solidtouch.analysis.page.figure_style import label_panel, styled

from benchmarks.speed.growth import METHODS, SIZES, Growth, slope, slope_text

# Okabe and Ito's palette, told apart under the common colour deficiencies, and in grey by their markers.
STYLES = {
    "trials, passive": ("#000000", "o"),
    "trials, active": ("#d55e00", "s"),
    "reproduce": ("#0072b2", "^"),
    "Filter, from samples": ("#009e73", "D"),
    "histogram": ("#000000", "o"),
    "gaussian": ("#cc79a7", "s"),
}
NAMES = {
    "L x M": "classes, L × M",
    "K": "taxels, K",
    "J": "samples per taxel, J",
    "N": "training taps, N",
    "trials": "trials",
}
COSTS = {
    "tap-update": ("time per tap-update (s)", "memory (MiB)"),
    "fit": ("time per fit (s)", "memory (MiB)"),
}
LEAST_MIB = 0.1
"""Smaller peaks are not drawn, as other memory of the process hides them."""


@styled
def growth_figure(found: Sequence[Growth]) -> Any:
    """Time and memory of tap-updates and of fits, on logarithmic axes, with the slope of each line."""
    figure: Any = empty_figure(TWO_COLUMNS, 8.6, whole=True)
    letters = iter("ABCDEFGHIJKLMNOP")
    for part, (work, methods) in zip(figure.subfigures(len(METHODS), 1), METHODS.items(), strict=True):
        sizes = [axis for axis in SIZES if any(axis in measured for measured in methods.values())]
        axes = part.subplots(2, len(sizes), sharex="col", sharey="row")
        for row, (panels, label) in enumerate(zip(axes, COSTS[work], strict=True)):
            for panel, axis in zip(panels, sizes, strict=True):
                panel.set(xscale="log", yscale="log")
                _draw(panel, [one for one in found if (one.work, one.axis) == (work, axis)], memory=row == 1)
                label_panel(panel, next(letters))
            panels[0].set_ylabel(label)
            low, high = panels[0].get_ylim()
            panels[0].set_ylim(low, high * (high / low) ** 0.3)  # room for the slopes
        for panel, axis in zip(axes[-1], sizes, strict=True):
            panel.set_xlabel(NAMES[axis])
        lines = [panel.plot([], [], "-", color=STYLES[name][0], marker=STYLES[name][1])[0] for name in methods]
        key(part, lines, list(methods), above=True)
    return figure


def _draw(panel: Any, curves: Sequence[Growth], *, memory: bool) -> None:
    """Lines with their slopes above, and a dotted line of slope 1 through the last point of each, but over trials."""
    for number, curve in enumerate(curves):
        colour, marker = STYLES[curve.method]
        size = np.array(curve.size, dtype=np.float64)
        cost = np.array(curve.mebibytes if memory else curve.fastest())
        shown = np.where(cost >= LEAST_MIB, cost, np.nan) if memory else cost
        panel.plot(size, shown, marker=marker, color=colour)
        fitted = slope(curve.size, cost.tolist())
        if fitted is not None and curve.axis != "trials":
            last = size[-max(4, (len(size) + 1) // 2) :]
            panel.plot(last, cost[-1] * last / last[-1], ":", color="0.5", zorder=0)
        text = f"below {LEAST_MIB} MiB" if np.isnan(shown[-1]) else slope_text(fitted)
        place = 0.03, 0.98 - 0.1 * number
        panel.annotate(text, place, xycoords="axes fraction", color=colour, fontsize="small", va="top")
