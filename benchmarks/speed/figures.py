"""Figure of the running times against the number of classes and the number of trials in a call."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.patheffects import withStroke
from solidtouch.analysis.page.figure_sizes import TWO_COLUMNS, new_figure
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
NAMES = {"C": "limit, in C"}
DASHES = {"passive": "-", "active": (0, (4, 2))}
PANELS = {"classes": "classes, L x M", "trials in a call": "trials in a call", "trials": "trials"}


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
    _label(axes[0, 0], next(iter(panels.values())))
    axes[0, -1].plot([], [], "-", color="0.3", label="passive")
    axes[0, -1].plot([], [], linestyle=DASHES["active"], color="0.3", label="active")
    axes[0, -1].legend(loc="upper right")
    return figure


def draw(curves: Sequence[Curve], folder: Path) -> Path:
    """Writes `performance.svg` into a folder."""
    return save(cost_figure(curves), folder, "performance")[0]


def _draw(axes: Any, curve: Curve) -> None:
    method, _, policy = curve.method.partition(", ")
    nanoseconds = [1e9 * time_ for time_ in curve.medians()]
    axes.plot(curve.size, nanoseconds, marker="o", color=COLOURS[method], linestyle=DASHES[policy])


def _label(axes: Any, curves: Sequence[Curve]) -> None:
    """Names each method behind the end of its passive line, one name clear of the other."""
    ends = sorted((1e9 * curve.medians()[-1], curve) for curve in curves if curve.method.endswith(", passive"))
    low, high = axes.get_ylim()
    least = (high / low) ** 0.05
    height = 0.0
    for end, curve in ends:
        height = max(end, height * least)
        method = curve.method.partition(", ")[0]
        style = {
            "color": COLOURS[method],
            "va": "center",
            "path_effects": [withStroke(linewidth=2.5, foreground="white")],
        }
        axes.annotate(NAMES.get(method, method), (curve.size[-1], height), (5, 0), textcoords="offset points", **style)
    low, high = axes.get_xlim()
    axes.set_xlim(low, high * (high / low) ** 0.45)
