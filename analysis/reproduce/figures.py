"""Figures of a reproduction; figures 5 and 7, and accuracy over contacts, are drawn here.

Datasets carry `what_error`, `where_error` and `taps`, each also with `_low` and `_high`, over the dim `theta` and
for Fig. 5 also `place`; the attributes `what_unit` and `where_unit` name the units of the errors.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from ...models.grid import ClassGrid
from ..page.figure_confusion import confusion
from ..page.figure_curves import read_off
from ..page.figure_episodes import beliefs, trajectories
from ..page.figure_sizes import ONE_COLUMN, TWO_COLUMNS, new_figure
from ..page.figure_style import (
    ACTIVE,
    PASSIVE,
    axis_label,
    band,
    class_ticks,
    discrete_colours,
    label_panel,
    shades,
    styled,
)
from ..page.page import Picture
from .examples import TRAJECTORIES
from .figure_taps import pressure
from .record import ANSWERS
from .results import Request, Results

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BAND = "The band is the 95% interval at the highest threshold."
_QUANTITIES = {"what_error": "object error", "where_error": "position error", "taps": "reaction time"}
_POLICIES: dict[str, dict[str, Any]] = {
    "passive": {"color": PASSIVE, "marker": "s", "markersize": 2.6, "linestyle": (0, (4, 1.5))},
    "active": {"color": ACTIVE, "marker": "o"},
}
_SERIES: dict[str, dict[str, Any]] = {
    "joint": {"color": "#332288", "marker": "o"},
    "where": {"color": "#44aa99", "marker": "s"},
    "what": {"color": "#aa4499", "marker": "^"},
}


class _Asked:
    """Draws with arguments that are computed when it draws, or is sent to the process that does."""

    def __init__(self, draw: Callable[..., Figure], arguments: Callable[[], tuple[Any, ...]]) -> None:
        self._draw, self._arguments = draw, arguments

    def __call__(self) -> Figure:
        return self._draw(*self._arguments())

    def __reduce__(self) -> tuple[Any, ...]:
        return partial, (self._draw, *self._arguments())


def pictures(request: Request, results: Results) -> Iterator[Picture]:
    """Every figure that the data allow."""
    yield _pressure(request, results)
    yield Picture(
        "fig4",
        "Beliefs in single sequences",
        "Belief in each class against the number of taps in a clear (A) and an ambiguous (B) passive sequence; grey: "
        "all other classes.",
        _Asked(beliefs, lambda: (*results.cases, results.grid)),
    )
    yield from _active_pictures(request, results)
    yield _acuity(results)
    theta = request.settings.thresholds[request.settings.shown]
    if results.grid.M > 1:
        yield Picture(
            "confusion",
            "Confusion of objects",
            f"Fraction of decisions at threshold {theta:g}; each row is a true object, cells below 0.005 are blank.",
            partial(confusion, *results.confusions, list(results.grid.what_name), theta),
        )
    if max(results.grid.shape) > 1:
        yield Picture(
            "contacts",
            "Accuracy after a fixed number of contacts",
            "Fraction of correct decisions after n taps of the same class, without moves or stopping, with 95% "
            "intervals.",
            partial(contacts, results.accuracy_dataset, results.grid),
            curves=True,
        )


def _pressure(request: Request, results: Results) -> Picture:
    train = request.split.folds[0].train
    shown = int(results.studies[0].test.what[0])
    shown = shown if (train.what == shown).any() else int(train.what[0])
    session = train.session[train.what == shown][0]
    taps = train.select((train.session == session) & (train.what == shown))
    return Picture(
        "fig3",
        "Taps of one object",
        f"Training taps on {train.what_name[shown]} in session {session}, in order of position.",
        partial(pressure, taps, shown),
    )


def _active_pictures(request: Request, results: Results) -> Iterator[Picture]:
    if results.by_fixation is None:
        return
    theta = request.settings.thresholds[request.settings.shown]
    yield Picture(
        "fig5_passive",
        "Passive perception by sensing position",
        "Errors and reaction time against the sensing position, one curve per threshold. " + _BAND,
        partial(errors_by_position, results.by_position),
        curves=True,
    )
    yield Picture(
        "fig5_active",
        "Active perception by fixation point",
        "Errors and reaction time against the fixation point, averaged over starts, one curve per threshold. " + _BAND,
        partial(errors_by_fixation, results.by_fixation),
        curves=True,
    )
    yield Picture(
        "fig6",
        "Trajectories",
        f"Position against taps in {TRAJECTORIES} passive (A) and active (B) trials at threshold "
        f"{theta:g}; the fixation point is {results.grid.where_label(results.fixation)}.",
        _Asked(trajectories, lambda: (*(results.paths or ()), results.grid, results.fixation)),
        curves=True,
    )


def _acuity(results: Results) -> Picture:
    curves = {name: curve for name, curve in results.curves.items() if name in _POLICIES}
    if "active" in curves:
        title = "Decision errors, passive and active"
        note = f"; the fixation point is {results.grid.where_label(results.fixation)}."
    else:
        title, note = "Decision errors, passive", "."
    return Picture(
        "fig7",
        title,
        f"Errors against the belief threshold and the mean reaction time; bands and bars are 95% intervals{note}",
        partial(acuity_of, curves, results.grid),
        curves=True,
    )


@styled
def errors_by_position(data: xr.Dataset) -> Figure:
    """Errors and reaction time against sensing position, one shade per threshold; Fig. 5, passive."""
    return _errors_by_place(data, "sensing position", PASSIVE)


@styled
def errors_by_fixation(data: xr.Dataset) -> Figure:
    """Errors and reaction time against fixation point, one shade per threshold; Fig. 5, active."""
    return _errors_by_place(data, "fixation point", ACTIVE)


def _errors_by_place(data: xr.Dataset, place: str, colour: str) -> Figure:
    figure, axes = new_figure(TWO_COLUMNS, 2.3, 1, 3, panel=2.0)
    for panel, letter, name in zip(axes[0], "ABC", _QUANTITIES, strict=True):
        plot_by_place(panel, data, name, colour)
        panel.set_xlabel(axis_label(place, data["place"].attrs.get("units", "")))
        label_panel(panel, letter)
    _threshold_key(figure, axes[0], np.sort(data["theta"].values), colour)
    return figure


def plot_by_place(axes: Axes, data: xr.Dataset, name: str, colour: str) -> Axes:
    """Draws one quantity against place, a line per threshold, the highest in this colour with its interval."""
    data = data[[name, f"{name}_low", f"{name}_high"]].sortby(["place", "theta"])
    place = data["place"].values
    size = 3 if len(place) <= 20 else 1.5
    for i, shade in enumerate(shades(data.sizes["theta"], colour)):
        at = data.isel(theta=i)
        style: dict[str, Any] = {"color": shade, "linewidth": 0.8, "markersize": size}
        (line,) = axes.plot(place, at[name].values, ".-", label=f"threshold {float(at['theta']):g}", **style)
        read_off(line, low=at[f"{name}_low"], high=at[f"{name}_high"])
    band(axes, place, data.isel(theta=-1), name, colour)
    axes.set_ylabel(_quantity_label(data, name))
    axes.set_ylim(bottom=0)
    class_ticks(axes, place)
    return axes


def _threshold_key(figure: Figure, axes: np.ndarray, theta: np.ndarray, colour: str) -> None:
    if len(theta) == 1:
        axes[-1].set_title(f"threshold {theta[0]:g}", loc="right")
        return
    bar = figure.colorbar(discrete_colours(shades(len(theta), colour)), ax=list(axes), aspect=25, pad=0.02)
    shown = np.arange(len(theta))[:: -max(1, -(-len(theta) // 14))][::-1]
    bar.set_ticks(list(shown), labels=[f"{theta[i]:.3g}" for i in shown])
    bar.ax.tick_params(length=0, labelsize="small")
    bar.minorticks_off()
    bar.set_label("belief threshold")


def acuity_of(curves: Mapping[str, xr.Dataset], grid: ClassGrid) -> Figure:
    """The figure of curves by policy; with one class of a kind its error is zero, and its panels are left out."""
    empty = [name for name, size in zip(("where_error", "what_error"), grid.shape, strict=True) if size == 1]
    kept = {name: curve.drop_vars(empty if len(empty) == 1 else []) for name, curve in curves.items()}
    return acuity(kept.get("passive"), kept.get("active"))


@styled
def acuity(passive: xr.Dataset | None, active: xr.Dataset | None) -> Figure:
    """Errors against threshold (A, B) and against reaction time (C, D), passive and active; Fig. 7.

    Args:
        passive: Curves over `theta`, or `None` where there are none.
        active: The same for active perception. Panels of an error that neither holds are left out.

    Raises:
        ValueError: Both are `None`.
    """
    curves = {name: data for name, data in (("passive", passive), ("active", active)) if data is not None}
    if not curves:
        raise ValueError("passive and active are both None: there is no curve to draw.")
    names = [name for name in ("what_error", "where_error") if all(name in data for data in curves.values())]
    figure, axes = new_figure(TWO_COLUMNS if len(names) > 1 else ONE_COLUMN, 4.4, 2, len(names), sharey="col")
    for column, name in enumerate(names):
        for policy, data in curves.items():
            plot_against_threshold(axes[0, column], data, name, policy)
            plot_against_taps(axes[1, column], data, name, policy)
    for panel, letter in zip(axes.flat, "ABCD"[: axes.size], strict=True):
        label_panel(panel, letter)
        panel.set_xlim(left=0)
        panel.set_ylim(bottom=0)
    axes[0, 0].legend(loc="best")
    return figure


def plot_against_threshold(axes: Axes, data: xr.Dataset, name: str, policy: str) -> Axes:
    """Draws one error against belief threshold with its interval as a band."""
    data = data.sortby("theta")
    axes.plot(data["theta"].values, data[name].values, label=policy, **_POLICIES[policy])
    band(axes, data["theta"].values, data, name, _POLICIES[policy]["color"])
    axes.set(xlabel="belief threshold", ylabel=_quantity_label(data, name), xlim=(0, 1.02))
    return axes


def plot_against_taps(axes: Axes, data: xr.Dataset, name: str, policy: str) -> Axes:
    """Draws one error against mean reaction time, a point per threshold, with thin bars for both intervals."""
    data = data.sortby("theta")
    line, *_ = axes.errorbar(
        data["taps"].values,
        data[name].values,
        yerr=_bars(data, name),
        xerr=_bars(data, "taps"),
        elinewidth=0.5,
        label=policy,
        **_POLICIES[policy],
    )
    read_off(line, [f"threshold {theta:g}" for theta in data["theta"].values])
    axes.set(xlabel="mean reaction time (taps)", ylabel=_quantity_label(data, name))
    return axes


@styled
def contacts(accuracy: xr.Dataset, grid: ClassGrid) -> Figure:
    """Fraction of right decisions against the number of contacts.

    Args:
        accuracy: `joint`, `where` and `what` with `_low` and `_high` over the dim `contacts`.
        grid: The classes that were decided between; a part with one class is left out.
    """
    figure, axes = new_figure(ONE_COLUMN, 2.6)
    plot_contacts(axes[0, 0], accuracy, grid)
    return figure


def plot_contacts(axes: Axes, accuracy: xr.Dataset, grid: ClassGrid) -> Axes:
    """Draws each accuracy with its interval, and the level of guessing as a dotted line in its colour."""
    accuracy = accuracy.sortby("contacts")
    n = accuracy["contacts"].values
    sizes = {"joint": grid.L * grid.M, "where": grid.L, "what": grid.M}
    if grid.L == 1 or grid.M == 1:
        sizes = {"what" if grid.L == 1 else "where": max(grid.shape)}
    for name, size in sizes.items():
        axes.plot(n, accuracy[name].values, label=ANSWERS[name], **_SERIES[name])
        band(axes, n, accuracy, name, _SERIES[name]["color"])
        axes.axhline(1 / size, color=_SERIES[name]["color"], linewidth=0.8, linestyle=":")
    axes.plot([], [], color="grey", linewidth=0.8, linestyle=":", label="chance")
    axes.set(xlabel="contacts", ylabel="fraction correct", ylim=(0, 1.02))
    if n[-1] >= 10 * n[0]:
        axes.set_xscale("log")
    axes.set_xticks(n[:: -(-len(n) // 10)], [f"{value:g}" for value in n[:: -(-len(n) // 10)]])
    axes.set_xticks([], minor=True)
    axes.legend(loc="upper left", bbox_to_anchor=(1, 1))
    return axes


def _quantity_label(data: xr.Dataset, name: str) -> str:
    unit = "taps" if name == "taps" else data.attrs.get(name.replace("_error", "_unit"), "")
    return axis_label(_QUANTITIES[name], unit)


def _bars(data: xr.Dataset, name: str) -> np.ndarray:
    """Lengths of the error bars below and above, shape (2, n); 0 where a bound is missing."""
    bounds = data[name] - data[f"{name}_low"], data[f"{name}_high"] - data[name]
    return np.nan_to_num(np.clip(np.stack([bound.values for bound in bounds]), 0, None))
