"""Figures of the decisions of models: a panel each, with the reference model in grey behind the others.

Datasets are those of `stats.decisions.decision_curves`.
"""

from collections.abc import Iterator
from itertools import chain, repeat
from string import ascii_uppercase
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...models.grid import ClassGrid
from ..page.figure_curves import read_off
from ..page.figure_sizes import TWO_COLUMNS, key, new_figure
from ..page.figure_style import ACTIVE, PASSIVE, band, label_panel, short, styled
from .figures import REFERENCE, errors_of, label_of, time_axis

_COLUMNS = 4
_LOOKS: dict[str, dict[str, Any]] = {
    "passive": {"color": PASSIVE, "marker": "s", "linestyle": (0, (4, 1.5)), "markersize": 2.6},
    "active": {"color": ACTIVE, "marker": "o", "linestyle": "-", "markersize": 2.8},
}
_BEHIND: dict[str, Any] = {**REFERENCE, "zorder": 1}
_BETWEEN = 50  # points of a line that is bent on its axis, besides the thresholds
_ROOM = 1.15  # times the largest error, where the axis of errors ends
_FACTOR_ROOM = 3.0  # likewise of factors, on both sides


@styled
def decision_curves(curves: xr.Dataset, grid: ClassGrid) -> Figure:
    """Errors against mean reaction time, a panel for each error and model, passive and active together.

    Args:
        curves: From `stats.decisions.decision_curves`.
        grid: The classes; an error of a part with one class is left out.
    """
    names, models = errors_of(grid), shown_models(curves)
    rows, columns = _shape(len(models))
    figure, axes = new_figure(TWO_COLUMNS, 0.5 + 1.65 * rows * len(names), rows * len(names), columns, sharey="row")
    letters = chain(ascii_uppercase, repeat(""))
    for name, part in zip(names, np.split(axes, len(names)), strict=True):
        for panel, model in _filled(part, models):
            plot_errors(panel, curves, name, model)
            label_panel(panel, next(letters), short(model, models))
            panel.set_ylabel(label_of(curves, name) if panel in part[:, 0] else "")
    figure.supxlabel("mean reaction time (taps)", fontsize="medium")
    _key(figure, axes[0, 0])
    return figure


@styled
def miscalibration(curves: xr.Dataset) -> Figure:
    """Miscalibration factor against the threshold, a panel for each model, passive and active together."""
    models = shown_models(curves)
    rows, columns = _shape(len(models))
    figure, axes = new_figure(TWO_COLUMNS, 0.5 + 1.8 * rows, rows, columns, sharey=True, sharex=True)
    letters = chain(ascii_uppercase, repeat(""))
    for panel, model in _filled(axes, models):
        plot_miscalibration(panel, curves, model)
        label_panel(panel, next(letters) if len(models) > 1 else "", short(model, models))
        panel.set_ylabel("wrong / mean (1 − belief)" if panel in axes[:, 0] else "")
        panel.tick_params(labelbottom=True)
    figure.supxlabel("belief threshold", fontsize="medium")
    _key(figure, axes[0, 0])
    return figure


def shown_models(data: xr.Dataset) -> list[str]:
    """Models that have a panel: all but the reference, or the reference alone."""
    names = [str(name) for name in data["model"].values]
    return [name for name in names if name != data.attrs["reference"]] or names


def plot_errors(axes: Axes, curves: xr.Dataset, name: str, model: str) -> Axes:
    """Draws one error of a model against mean reaction time, a point per threshold, with its interval as a band.

    Lines are linear in the time, as `at_equal_taps` interpolates, so on this axis they are bent. The axis fits the
    errors of all models; bands that reach farther are cut, because they would flatten the lines.
    """
    names = name, f"{name}_low", f"{name}_high"
    curves = curves[[*names, "taps"]].sortby("theta")
    for policy, own, look in _lines(curves, model):
        part = curves.sel(policy=policy, model=own)
        times = part["taps"].values
        between = np.unique(np.concatenate([times, np.geomspace(times[0], times[-1], _BETWEEN)[1:-1]]))
        nodes = np.searchsorted(between, times).tolist()
        dense = xr.Dataset({key: ("taps", np.interp(between, times, part[key].values)) for key in names})
        (line,) = axes.plot(between, dense[name].values, markevery=nodes, **look)
        read_off(line, [f"threshold {theta:g}" for theta in part["theta"].values], at=nodes)
        if own == model:
            band(axes, between, dense, name, look["color"])
    top = float(curves[name].max())
    axes.set_ylim(0, _ROOM * top if top > 0 else None)
    times = curves["taps"].values.ravel()
    time_axis(axes, times)
    axes.set_xlim(times.min() / 1.06, times.max() * 1.06)
    return axes


def plot_miscalibration(axes: Axes, curves: xr.Dataset, model: str) -> Axes:
    """Draws a model's factors against the belief threshold on a log axis that fits those of all; 1 is calibrated."""
    axes.set_yscale("log")
    axes.axhline(1, color="grey", linewidth=0.8, linestyle=":")
    curves = curves[[f"miscalibration{end}" for end in ("", "_low", "_high")]].sortby("theta")
    for policy, own, look in _lines(curves, model):
        part = curves.sel(policy=policy, model=own)
        theta = part["theta"].values
        axes.plot(theta, part["miscalibration"].values, **look)
        if own == model:
            band(axes, theta, part, "miscalibration", look["color"])
    values = curves["miscalibration"].values
    values = values[np.isfinite(values) & (values > 0)]
    axes.set_ylim(values.min(initial=1.0) / _FACTOR_ROOM, values.max(initial=1.0) * _FACTOR_ROOM)
    axes.set_xlim(0, 1.02)
    return axes


def _lines(curves: xr.Dataset, model: str) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Policy, model and look of every line of a panel: those of the reference are behind."""
    reference = str(curves.attrs["reference"])
    for own in dict.fromkeys((reference, model)):
        for policy in map(str, curves["policy"].values):
            look = _LOOKS[policy]
            if own == model:
                yield policy, own, {**look, "label": policy, "zorder": 3}
            else:
                label = f"{short(own)}, {policy}"
                yield policy, own, {**look, **_BEHIND, "marker": "", "label": label}


def _shape(panels: int) -> tuple[int, int]:
    """Rows and columns."""
    columns = min(_COLUMNS, panels)
    return -(-panels // columns), columns


def _filled(axes: Any, models: list[str]) -> Iterator[tuple[Axes, str]]:
    """Panels with their models; hides the others."""
    for panel in axes.flat[len(models) :]:
        panel.set_visible(False)
    return zip(axes.flat, models, strict=False)


def _key(figure: Figure, axes: Axes) -> None:
    """One key below all panels, what is in front first."""
    handles, labels = axes.get_legend_handles_labels()
    order = sorted(range(len(labels)), key=lambda i: handles[i].get_zorder(), reverse=True)
    key(
        figure,
        [handles[i] for i in order],
        [labels[i] for i in order],
        above=True,
        handlelength=2.8,
    )
