"""Figure 3: raw taps of one object."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.taps import TapSet
from ..page.figure_sizes import TWO_COLUMNS, new_figure
from ..page.figure_style import TWELVE, axis_label, colours, discrete_colours, every, short, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 1500  # more than an axes has pixels in print
_TICK_CHARACTERS = 64


@styled
def pressure(taps: TapSet, what: int) -> Figure:
    """All taps on one object side by side in order of position, one colour per taxel; Fig. 3 of the paper.

    Args:
        taps: The labelled taps; select a session first where the sessions should not be mixed.
        what: The object, an index into `taps.what_name`.

    Raises:
        InputError: The object has no tap.
    """
    palette = colours(taps.dataset.sizes["taxel"])
    figure, axes = new_figure(TWO_COLUMNS, 2.6, 1, 2, width_ratios=[4.4, 1], panel=3.0)
    plot_pressure(axes[0, 0], taps, what, palette)
    plot_taxels(axes[0, 1], taps, palette)
    return figure


def plot_pressure(axes: Axes, taps: TapSet, what: int, palette: list[Any]) -> Axes:
    """Draws the samples of all taps on object `what` against position, or tap number if there is but one."""
    order = np.lexsort((taps.trial, taps.session, taps.where))
    order = order[taps.what[order] == what]
    if not len(order):
        raise InputError(f"The object {taps.what_name[what]!r} has no tap to draw.")
    chosen = taps.select(order)
    n, J, K = chosen.taps.shape
    x, y = _envelope(np.arange(n * J) / J, chosen.taps.reshape(n * J, K))
    for k in np.argsort(-np.ptp(y, axis=0), kind="stable"):  # small signals in front of large ones
        axes.plot(x, y[:, k], color=palette[k], linewidth=0.6, rasterized=True)
    axes.set_xlim(0, max(float(x[-1]), 1e-9))
    axes.set_ylabel(axis_label("sensor reading", taps.dataset["taps"].attrs.get("units", "")))
    axes.set_title(f"{short(taps.what_name[what], taps.what_name)}, {n} taps")
    _position_axis(axes, chosen)
    return axes


def plot_taxels(axes: Axes, taps: TapSet, palette: list[Any]) -> Axes:
    """Draws where each taxel sits in its colour, or names the colours where positions are not known."""
    if "taxel_position" in taps.dataset.coords:
        return _layout(axes, taps.dataset["taxel_position"].values, palette)
    axes.set_axis_off()
    if len(palette) <= len(TWELVE):
        for k, colour in enumerate(palette):
            axes.plot([], [], color=colour, linewidth=2, label=str(k))
        axes.legend(title="taxel", loc="center left", ncols=1 + (len(palette) > 6), borderpad=0)
        return axes
    bar = axes.figure.colorbar(discrete_colours(palette), cax=axes.inset_axes((0, 0.05, 0.15, 0.9)))
    bar.set_label("taxel")
    bar.set_ticks(list(range(0, len(palette), 10 if len(palette) > 30 else 2)))
    bar.minorticks_off()
    return axes


def _envelope(x: NDArray[Any], y: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Lowest and highest value per column where there are more samples than a page can show."""
    if len(x) <= 2 * _COLUMNS:
        return x, y
    starts = np.linspace(0, len(x), _COLUMNS, endpoint=False).astype(np.intp)
    extremes = np.stack([np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)], axis=1)
    return np.repeat(x[starts], 2), extremes.reshape(2 * _COLUMNS, -1)


def _position_axis(axes: Axes, taps: TapSet) -> None:
    """Labels an axis of sorted taps with positions: class edges if there are any, else the listed values."""
    grid = taps.grid()
    if grid.L == 1:
        axes.set_xlabel("tap")
        axes.locator_params(axis="x", integer=True)
        return
    if grid.where_edges is not None:
        values = grid.where_edges
        ticks = np.searchsorted(taps.where, values - 1e-6 * np.diff(values).min())
    else:
        index = grid.where_index(taps.where)
        values = grid.where_value[np.unique(index[index >= 0])]
        boundaries = np.searchsorted(index, np.unique(index[index >= 0]))
        ticks = np.append(boundaries, len(taps))
        axes.set_xticks(ticks, minor=True)
        ticks = (ticks[:-1] + ticks[1:]) / 2
    labels = [f"{value:g}" for value in values]
    step = every(labels, _TICK_CHARACTERS)
    axes.set_xticks(ticks, [label if i % step == 0 else "" for i, label in enumerate(labels)])
    axes.set_xlabel(axis_label("position", grid.axis_unit))


def _layout(axes: Axes, position: NDArray[np.float64], palette: list[Any]) -> Axes:
    across, along = np.sort(np.argsort(-np.ptp(position, axis=0), kind="stable")[:2])
    if np.ptp(position[:, across]) > np.ptp(position[:, along]):
        across, along = along, across
    K = len(position)
    axes.scatter(position[:, across], position[:, along], s=110 if K <= 24 else 25, c=palette, linewidths=0)
    for k in range(K if K <= 24 else 0):
        dark = np.dot(_rgb(palette[k]), (0.3, 0.59, 0.11)) < 0.55
        axes.text(
            position[k, across],
            position[k, along],
            str(k),
            ha="center",
            va="center_baseline",
            fontsize="small",
            color="white" if dark else "black",
        )
    axes.margins(0.25, 0.1)
    axes.set_aspect("equal")
    axes.set_title("taxels (mm)")
    return axes


def _rgb(colour: Any) -> NDArray[np.float64]:
    if isinstance(colour, str):
        return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.asarray(colour)[:3]
