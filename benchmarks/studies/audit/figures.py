"""Figures of the studies of the audit: how often its tests reject."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from solidtouch.analysis.page.figure_sizes import TWO_COLUMNS, new_figure
from solidtouch.analysis.page.figure_style import OTHERS, TWELVE, label_panel, styled


class PowerCurve(NamedTuple):
    """How often a test rejects at each value of a knob.

    Attributes:
        knob: What was turned.
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
    figure, axes = new_figure(TWO_COLUMNS, 3.2, 1, len(panels), sharey=True)
    for panel, letter, (effect, curves) in zip(axes[0], "ABCDEF", panels.items(), strict=False):
        plot_power(panel, curves, level)
        panel.set_xlabel(effect)
        label_panel(panel, letter)
    axes[0, 0].set_ylabel("rejects")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def plot_power(axes: Axes, curves: Sequence[PowerCurve], level: float) -> Axes:
    """Draws one test's rates with their intervals, knob by knob."""
    axes.axhline(level, color=OTHERS, linewidth=0.8, linestyle=":", label=f"level {level:g}")
    for curve, colour, marker in zip(curves, TWELVE[1::3], "os^D", strict=False):
        order = np.argsort(curve.effect)
        axes.errorbar(
            curve.effect[order],
            curve.rate[order],
            yerr=np.stack([curve.rate - curve.low, curve.high - curve.rate])[:, order].clip(0),
            marker=marker,
            color=colour,
            elinewidth=0.6,
            label=curve.knob,
        )
    axes.set_xscale("symlog", linthresh=0.01)
    axes.set_xlim(left=-0.002)
    axes.set_ylim(-0.03, 1.03)
    axes.set_xticks([0, 0.01, 0.1], ["0", ".01", ".1"])
    return axes
