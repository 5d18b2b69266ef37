"""Figures that compare models: scores by contacts, and paired differences.

Datasets are those of `classes.class_scores` and `stats.decisions.at_equal_taps`. A model
has the same colour, marker and line in all of them; the reference model is grey.
"""

from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter
from numpy.typing import NDArray

from ...models.grid import ClassGrid
from ..page.figure_curves import read_off
from ..page.figure_sizes import TWO_COLUMNS, key, new_figure
from ..page.figure_style import axis_label, label_panel, short, styled

_COLOURS = (
    "#cc6677",
    "#332288",
    "#117733",
    "#88ccee",
    "#aa4499",
    "#999933",
    "#44aa99",
    "#882255",
    "#ddcc77",
    "#6699cc",
    "#661100",
)  # CARTO "Safe" like `figure_style.TWELVE`, neighbours far apart
REFERENCE: dict[str, Any] = {"color": "#949494", "linewidth": 1.8}
_MARKERS = "s^DvPX<>*p"
_LINES = ("-", "--", "-.", ":")
_LABELS = {
    "log_score_joint": "log score, class",
    "log_score_what": "log score, object",
    "brier_joint": "Brier score, class",
    "brier_what": "Brier score, object",
    "calibration_what": "calibration error, object",
    "calibration_where": "calibration error, position",
    "accuracy_joint": "fraction correct, class",
    "accuracy_where": "fraction correct, position",
    "accuracy_what": "fraction correct, object",
    "what_error": "object error",
    "where_error": "position error",
    "what_wrong": "P(wrong object)",
    "miscalibration": "P(wrong) / mean (1 − belief)",
}
_SPREAD = 0.2  # of the models at one number of contacts, as the logarithm of the number
_TICKS = 15
_ENDS = "", "_low", "_high"
_WORSE = 1.5  # times the log score of guessing: what is beyond that is only said to be


def model_styles(names: Sequence[str], reference: str) -> dict[str, dict[str, Any]]:
    """Colour, marker and line of each model: broad and grey for the reference, distinct for ten more and on."""
    styles = zip(cycle(_COLOURS), cycle(_MARKERS), cycle(_LINES), strict=False)
    others = {
        name: {"color": colour, "marker": marker, "linestyle": line}
        for name, (colour, marker, line) in zip((name for name in names if name != reference), styles, strict=False)
    }
    return {reference: {**REFERENCE, "marker": "o", "linestyle": "-", "zorder": 3}, **others}


@styled
def class_scores(scores: xr.Dataset, grid: ClassGrid) -> Figure:
    """Scores against the number of contacts, a panel each; those of a part with one class are left out.

    Args:
        scores: From `classes.class_scores`.
        grid: The classes.
    """
    names = [name for name in _class_panels(grid) if name in scores]
    return _panels(scores, [[(plot_scores, {"name": name, "grid": grid}) for name in row] for row in _rows(names)], 2.2)


@styled
def class_differences(scores: xr.Dataset, grid: ClassGrid) -> Figure:
    """Differences of the scores to those of the reference model against the number of contacts."""
    names = [name for name in _class_panels(grid) if name in scores]
    return _panels(
        scores, [[(plot_differences, {"name": name, "grid": grid}) for name in row] for row in _rows(names)], 2.2
    )


@styled
def decision_differences(equal: xr.Dataset, grid: ClassGrid) -> Figure:
    """Differences of the errors to those of the reference model at equal mean reaction times.

    Args:
        equal: From `stats.decisions.at_equal_taps`.
        grid: The classes; an error of a part with one class is left out.
    """
    rows = [[(plot_differences, {"name": name, "policy": p}) for p in _policies(equal)] for name in errors_of(grid)]
    return _panels(equal, rows, 2.3, sharey="row")


def plot_scores(axes: Axes, scores: xr.Dataset, name: str, grid: ClassGrid | None = None) -> Axes:
    """Draws one score against the number of contacts with its intervals, models side by side.

    With a grid the level of guessing is a dotted line, and log scores far below that, like -inf without a grid, are
    triangles at the lower edge.
    """
    _dots(axes, scores, name, "contacts", joined=True)
    chance = None if grid is None else _chance(name, grid)
    if chance is not None:
        axes.axhline(chance, color="grey", linewidth=0.8, linestyle=":", label="chance")
    if name.startswith("log_score"):
        _keep_within(axes, scores, name, "contacts", -np.inf if chance is None else _WORSE * chance, 0.0)
    elif name.startswith("accuracy"):
        axes.set_ylim(0, 1.02)
    else:
        axes.set_ylim(bottom=0)
    axes.set_ylabel(label_of(scores, name))
    return axes


def plot_differences(
    axes: Axes, data: xr.Dataset, name: str, policy: str | None = None, grid: ClassGrid | None = None
) -> Axes:
    """Draws differences to the reference model with their intervals, models side by side.

    Args:
        axes: Where to.
        data: Over (model, contacts), or over (model, policy, taps) with a policy.
        name: The quantity.
        policy: Which.
        grid: With it, differences of log scores far beyond the score of guessing are triangles at the edge.
    """
    data = data[[name, *(f"{name}_difference{end}" for end in _ENDS)]]
    if policy is not None:
        data = data.sel(policy=policy)
        axes.set_title(policy)
    dim = "contacts" if "contacts" in data.dims else "taps"
    axes.axhline(0, color="black", linewidth=0.8)
    others = data.sel(model=[model for model in data["model"].values if model != data.attrs["reference"]])
    _dots(axes, others, f"{name}_difference", dim, joined=False)
    axes.set_ylabel(f"{label_of(data, name)}\n− that of {short(data.attrs['reference'])}")
    if not data.sizes[dim]:
        axes.text(0.5, 0.5, "no common reaction time", ha="center", va="bottom", transform=axes.transAxes)
    if name.startswith("log_score"):
        chance = None if grid is None else _chance(name, grid)
        reach = np.inf if chance is None else -_WORSE * chance
        _keep_within(axes, others, f"{name}_difference", dim, -reach, reach)
    return axes


def _panels(data: xr.Dataset, rows: list[list[tuple[Any, dict[str, Any]]]], height: float, **options: Any) -> Figure:
    """A figure of panels, each drawn by a function with arguments, and one key below them all."""
    columns = max(map(len, rows))
    figure, axes = new_figure(TWO_COLUMNS, height * len(rows) + 0.4, len(rows), columns, **options)
    letters = iter("ABCDEFGHIJKL")
    for row, panels in zip(rows, axes, strict=True):
        for panel in panels[len(row) :]:
            panel.set_visible(False)
        for (draw, arguments), panel in zip(row, panels, strict=False):
            draw(panel, data, **arguments)
            label_panel(panel, next(letters), panel.get_title())
    handles: dict[str, Any] = {}
    for panel in axes.flat:
        handles |= dict(zip(*reversed(panel.get_legend_handles_labels()), strict=True))
    order = [name for name in [*map(str, data["model"].values), "chance"] if name in handles]
    if order:
        key(figure, [handles[name] for name in order], order, handlelength=2.6)
    return figure


def _dots(axes: Axes, data: xr.Dataset, name: str, dim: str, *, joined: bool) -> None:
    """Every model's values with intervals, a little beside each other; infinite bounds end at the value."""
    x, models = data[dim].values, data["model"].values.tolist()
    values = np.stack([data[f"{name}{end}"].transpose("model", dim).values for end in _ENDS], axis=1)
    for i, (model, style) in enumerate(_styles(data).items()):
        finite = np.isfinite(values[i, 0])
        value, low, high = values[i][:, finite]
        bars = np.clip(np.stack([value - low, high - value]), 0, None)
        line, *_ = axes.errorbar(
            _beside(x, i, len(models))[finite],
            value,
            yerr=np.where(np.isfinite(bars), bars, 0.0),
            elinewidth=0.6,
            label=short(model, models),
            **style if joined else {**style, "linestyle": "none"},
        )
        read_off(line, x=[f"{value:g}" for value in x[finite]])
    axes.margins(x=0.06)
    time_axis(axes, x, ticks=True)
    axes.set_xlabel("taps" if dim == "contacts" else "mean reaction time (taps)")


def _styles(data: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Those of the models in the data, in their order."""
    names = [str(name) for name in data["model"].values]
    styles = model_styles(names, data.attrs["reference"])
    return {name: styles[name] for name in names}


def _beside(x: NDArray[Any], i: int, n: int) -> NDArray[np.float64]:
    """Where model i of n is drawn for values at x on a logarithmic axis."""
    return x * np.exp(_SPREAD * (i - (n - 1) / 2) / n)


def time_axis(axes: Axes, x: NDArray[Any], *, ticks: bool = False) -> None:
    """A logarithmic axis with plain numbers: at the values so far as there is room, or at round ones between them."""
    axes.set_xscale("log")
    if not ticks:
        low, high = (x.min(), x.max()) if x.size else (1.0, 1.0)
        x = np.outer(10.0 ** np.arange(6), (1, 2, 5)).ravel()
        x = x[(x >= low / 1.5) & (x <= high * 1.5)]
    kept: list[float] = []
    for value in np.unique(x):
        if not kept or np.log(value / kept[-1]) > np.log(x.max() / x.min()) / _TICKS:
            kept.append(float(value))
    axes.xaxis.set_major_locator(FixedLocator(kept))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_locator(NullLocator())


def _keep_within(axes: Axes, data: xr.Dataset, name: str, dim: str, low: float, high: float) -> None:
    """Lets the y axis end at these values at most, and draws what lies beyond as triangles at its edges."""
    bottom, top = axes.get_ylim()
    if low < high:  # with one class, guessing scores as well as can be
        axes.set_ylim(max(bottom, low), min(top, high))
    for i, (model, style) in enumerate(_styles(data).items()):
        x, y = _beside(data[dim].values, i, data.sizes["model"]), data[name].sel(model=model).values
        for beyond, edge, marker in ((y < low) | np.isneginf(y), 0, "v"), ((y > high) | np.isposinf(y), 1, "^"):
            for place in x[beyond]:
                transform = axes.get_xaxis_transform()
                axes.plot([place], [edge], marker, color=style["color"], transform=transform, clip_on=False)


def _rows(names: list[str]) -> list[list[str]]:
    """At most three panels a row, rows of about equal length."""
    columns = -(-len(names) // -(-len(names) // 3))
    return [names[i : i + columns] for i in range(0, len(names), columns)]


def _class_panels(grid: ClassGrid) -> list[str]:
    """Scores worth a panel; what and where alone are the same as both where the other has one class."""
    if grid.M == 1:
        return ["log_score_joint", "brier_joint", "calibration_where", "accuracy_where"]
    if grid.L == 1:
        return ["log_score_what", "brier_what", "calibration_what", "accuracy_what"]
    return ["log_score_joint", "brier_joint", "accuracy_where", "log_score_what", "calibration_what", "accuracy_what"]


def errors_of(grid: ClassGrid) -> list[str]:
    """Errors that can be made."""
    return [name for name, classes in (("what_error", grid.M), ("where_error", grid.L)) if classes > 1] or [
        "what_error"
    ]


def _policies(data: xr.Dataset) -> list[str]:
    return [str(policy) for policy in data["policy"].values]


def _chance(name: str, grid: ClassGrid) -> float | None:
    """The score of a uniform belief, where that says something."""
    quantity, part = name.rsplit("_", maxsplit=1)
    classes = {"joint": grid.L * grid.M, "where": grid.L, "what": grid.M}[part]
    levels = {"accuracy": 1 / classes, "log_score": -np.log(classes), "brier": 1 - 1 / classes}
    return levels.get(quantity)


def label_of(data: xr.Dataset, name: str) -> str:
    """A quantity with its unit."""
    return axis_label(_LABELS[name], data[name].attrs.get("units", ""))
