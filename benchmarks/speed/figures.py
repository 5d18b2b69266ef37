"""Figure of the running times against the number of classes and the number of trials in a call."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.lines import Line2D
from solidtouch.analysis.page.figure_sizes import TWO_COLUMNS, key, new_figure
from solidtouch.analysis.page.figure_style import label_panel, save, styled

from benchmarks.speed.scaling import Curve

# Okabe and Ito's palette, told apart under the common colour deficiencies; passive lines are full, active ones dashed.
COLOURS = {
    "NumPy loop": "#d55e00",
    "NumPy batches": "#e69f00",
    "dynamax": "#cc79a7",
    "solidtouch": "#000000",
    "C": "#0072b2",
}
MARKS = {"NumPy loop": "v", "NumPy batches": "^", "dynamax": "D", "solidtouch": "o", "C": "s"}
NAMES = {"C": "limit, in C"}
DASHES = {"passive": "-", "active": (0, (4, 2))}
PANELS = {"classes": "classes, L × M", "trials in a call": "trials in a call", "trials": "trials"}


@styled
def cost_figure(curves: Sequence[Curve]) -> Any:
    """Cost of a tap-update, one panel per size, on logarithmic axes."""
    panels = {axis: [curve for curve in curves if curve.axis == axis] for axis in PANELS}
    panels = {axis: shown for axis, shown in panels.items() if shown}
    figure, axes = new_figure(TWO_COLUMNS, 3.2, 1, len(panels), sharey=True)
    for letter, panel, (axis, shown) in zip("ABC", axes[0], panels.items(), strict=False):
        for curve in shown:
            _draw(panel, curve)
        panel.set(xscale="log", yscale="log", xlabel=PANELS[axis])
        label_panel(panel, letter)
    axes[0, 0].set_ylabel("time per tap-update (ns)")
    drawn = {curve.method.partition(", ")[0] for curve in curves}
    methods = [
        Line2D([], [], color=COLOURS[name], marker=MARKS[name], label=NAMES.get(name, name))
        for name in COLOURS
        if name in drawn
    ]
    policies = [Line2D([], [], color="0.3", linestyle=dash, label=policy) for policy, dash in DASHES.items()]
    key(figure, [*methods, *policies], above=True, handlelength=2.6)
    return figure


def draw(curves: Sequence[Curve], folder: Path) -> Path:
    """Writes `performance.svg` into a folder."""
    return save(cost_figure(curves), folder, "performance")[0]


def _draw(axes: Any, curve: Curve) -> None:
    method, _, policy = curve.method.partition(", ")
    nanoseconds = [1e9 * time_ for time_ in curve.medians()]
    axes.plot(curve.size, nanoseconds, marker=MARKS[method], color=COLOURS[method], linestyle=DASHES[policy])
