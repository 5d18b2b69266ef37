"""Figure of the calibration of the whole chain: credible sets, and how often decisions are wrong."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from solidtouch.analysis.page.figure_sizes import TWO_COLUMNS, key, new_figure
from solidtouch.analysis.page.figure_style import ACTIVE, DECIDED, OTHERS, TRUE, label_panel, styled

_LOOK = {"what": (DECIDED, "o"), "where": (TRUE, "s"), "joint": (ACTIVE, "^")}
_NAMES = {"what": "object", "where": "position", "joint": "object and position"}
_LEAST, _MOST = 0.1, 100.0  # factors beyond are drawn at the end of the axis


class CalibrationPanel(NamedTuple):
    """One filter.

    Attributes:
        title: What is wrong with it.
        z: Where distribution functions are looked at.
        low: Lower end of the simultaneous band of uniform numbers, minus `z`.
        high: Upper end, likewise.
        curves: Share of the credible sets of probability `z` that hold the truth, minus `z`, of each quantity.
        factors: Wrong decisions over those announced, with interval, by quantity, shape (W, 3); NaN where none is.
    """

    title: str
    z: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    curves: Mapping[str, NDArray[np.float64]]
    factors: Mapping[str, NDArray[np.float64]]


@styled
def calibration_figure(panels: Sequence[CalibrationPanel], moments: Sequence[str]) -> Figure:
    """A column per filter: above the credible sets, below the factors at each moment."""
    figure, axes = new_figure(TWO_COLUMNS, 4.4, 2, len(panels), sharey="row", whole=True)
    for i, panel in enumerate(panels):
        plot_spread(axes[0, i], panel)
        label_panel(axes[0, i], chr(ord("A") + i), panel.title)
        plot_factors(axes[1, i], panel, moments)
    axes[0, 0].set_ylabel("fraction of sets with the truth\n− their probability")
    axes[1, 0].set_ylabel("wrong decisions\n/ expected from beliefs")
    key(figure, *axes[0, 0].get_legend_handles_labels())
    return figure


def plot_spread(axes: Axes, panel: CalibrationPanel) -> Axes:
    """One line per quantity over the band."""
    axes.fill_between(
        panel.z, panel.low, panel.high, color=OTHERS, alpha=0.35, linewidth=0, label="95% band of a right filter"
    )
    axes.axhline(0, color=OTHERS, linewidth=0.6)
    for name, curve in panel.curves.items():
        colour, marker = _LOOK[name]
        axes.plot(panel.z, curve, color=colour, marker=marker, markevery=max(1, len(panel.z) // 8), label=_NAMES[name])
    axes.set_xlim(0, 1)
    axes.set_xticks([0, 0.5, 1], ["0", ".5", "1"])
    axes.set_yscale("symlog", linthresh=0.03, linscale=1.5)
    axes.set_yticks([-0.3, -0.03, 0, 0.03, 0.3], ["\N{MINUS SIGN}.3", "\N{MINUS SIGN}.03", "0", ".03", ".3"])
    axes.minorticks_off()
    axes.set_xlabel("probability of the set")
    return axes


def plot_factors(axes: Axes, panel: CalibrationPanel, moments: Sequence[str]) -> Axes:
    """A mark with its interval per quantity and moment, on a logarithmic axis around 1."""
    axes.axhline(1, color=OTHERS, linewidth=0.6)
    place = np.arange(len(moments), dtype=np.float64)
    for shift, (name, factor) in zip((-0.22, 0.0, 0.22), panel.factors.items(), strict=False):
        colour, marker = _LOOK[name]
        value, low, high = np.clip(factor, _LEAST, _MOST).T
        axes.vlines(place + shift, low, high, color=colour, linewidth=0.8)
        axes.plot(place + shift, value, marker, color=colour, markersize=2.5)
    axes.set_yscale("log")
    axes.set_ylim(_LEAST / 1.3, _MOST * 1.3)
    axes.set_yticks([0.1, 1, 10, 100], [".1", "1", "10", "100"])
    axes.set_xlim(-0.5, len(moments) - 0.5)
    axes.set_xticks(place, moments, rotation=60, ha="right", rotation_mode="anchor")
    return axes
