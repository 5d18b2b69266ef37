"""Figures of the studies of the audit: how often its tests reject."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from solidtouch.analysis.page.figure_sizes import TWO_COLUMNS, key, new_figure
from solidtouch.analysis.page.figure_style import OTHERS, label_panel, styled

KNOBS = {
    "common_noise_counts": ("#cc6677", "o", "-", "noise shared by all taxels (SD, counts)"),
    "taxel_noise_counts": ("#332288", "s", "--", "noise of each taxel (SD, counts)"),
    "tap_depth_log_sd": ("#999933", "^", "-.", "depth of taps (SD of the logarithm)"),
    "position_spread_mm": ("#6699cc", "D", ":", "position within a class (SD, mm)"),
}
"""Settings of the simulator that are turned: colour, mark and line, and what they are, with the unit."""


class PowerCurve(NamedTuple):
    """How often a test rejects at each value of a knob.

    Attributes:
        knob: Field of the simulator's settings that was turned, one of `KNOBS`.
        effect: Mean effect size, shape (V,).
        rate: Share of data sets in which the test rejects, shape (V,).
        low: Lower ends of intervals of the shares.
        high: Upper ends.
    """

    knob: str
    effect: NDArray[np.float64]
    rate: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


@styled
def power_figure(panels: Mapping[str, Sequence[PowerCurve]], level: float) -> Figure:
    """Rates of rejection against effect sizes, a panel for each test.

    Args:
        panels: Curves by the name of the effect size.
        level: Of the tests, drawn as a line.
    """
    figure, axes = new_figure(TWO_COLUMNS, 2.9, 1, len(panels), sharey=True)
    for panel, letter, (effect, curves) in zip(axes[0], "ABCDEF", panels.items(), strict=False):
        plot_power(panel, curves, level)
        panel.set_xlabel(effect)
        label_panel(panel, letter)
    axes[0, 0].set_ylabel("fraction of data sets rejected")
    handles = {
        label: handle for axis in axes[0] for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    key(figure, list(handles.values()), list(handles))
    return figure


def plot_power(axes: Axes, curves: Sequence[PowerCurve], level: float) -> Axes:
    """Draws one test's rates with their intervals, knob by knob."""
    axes.axhline(level, color=OTHERS, linewidth=0.8, linestyle=":", label=f"level {level:g}")
    for curve in curves:
        colour, marker, line, words = KNOBS.get(curve.knob, ("black", "o", "-", curve.knob))
        order = np.argsort(curve.effect)
        axes.errorbar(
            curve.effect[order],
            curve.rate[order],
            yerr=np.stack([curve.rate - curve.low, curve.high - curve.rate])[:, order].clip(0),
            marker=marker,
            color=colour,
            linestyle=line,
            elinewidth=0.6,
            label=words,
        )
    axes.set_xscale("symlog", linthresh=0.01)
    axes.set_xlim(left=-0.002)
    axes.set_ylim(-0.03, 1.03)
    axes.set_xticks([0, 0.01, 0.1], ["0", ".01", ".1"])
    return axes
