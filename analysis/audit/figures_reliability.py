"""Figures of the cost of wrong beliefs: reliability, exceeded bounds, and the threshold for a wanted error.

Datasets are those of `reliability.reliability` and `guarantees.guarantees`. Everything together is black, passive
perception alone red; objects have the same colour in all of them.
"""

from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter, NullLocator
from numpy.typing import ArrayLike, NDArray

from ...models.grid import ClassGrid
from ..page.figure_confusion import confusion
from ..page.figure_sizes import TWO_COLUMNS, key, new_figure
from ..page.figure_style import (
    ACTIVE,
    DECIDED,
    MOST_FACTOR,
    OTHERS,
    PASSIVE,
    TRUE,
    colours,
    label_panel,
    line_bundle,
    short,
    styled,
)
from ..page.numbers import number
from ..stats.reliability import EVERYTHING, after_contacts, at_stopping
from ..stats.target_error import COVERAGE, TargetError, prediction_interval
from .guarantees import PROMISED, USED

_MARKERS = "osD^v<>ph"
_CURVES = 4
_NAMED = 8  # objects that a key names; beyond, lines are grey
_LEAST = 1e-4  # where fractions on a log axis end: what is below is drawn there
_LOWEST = 0.01  # likewise of factors
_LEAST_END = 0.05  # of intervals that an axis of factors stretches to hold


def confusions(data: xr.Dataset, grid: ClassGrid, theta: float) -> Figure:
    """Confusion of objects by all decisions at the threshold nearest to a given one, a panel for each policy.

    Args:
        data: From `reliability.reliability`.
        grid: The classes.
        theta: The threshold.
    """
    tables = {
        str(policy): at_stopping(data, str(policy)).sel(theta=theta, method="nearest")["confusion"].sel(counted="all")
        for policy in np.unique(data["policy"])
    }
    return confusion(tables.get("passive"), tables.get("active"), list(grid.what_name), theta)


@styled
def reliability_after_taps(data: xr.Dataset) -> Figure:
    """Reliability after fixed numbers of taps: curves, calibration error and Brier score, and miscalibration factor.

    Args:
        data: From `reliability.reliability`, with contacts.
    """
    figure, axes = new_figure(TWO_COLUMNS, 3.0, 1, 3, panel=1.8)
    part = after_contacts(data).sel(what=EVERYTHING)
    plot_curves(axes[0, 0], part)
    plot_scores(axes[0, 1], part)
    plot_factor(axes[0, 2], part)
    for panel, letter in zip(axes[0], "ABC", strict=True):
        label_panel(panel, letter, panel.get_title())
    handles, labels = axes[0, 0].get_legend_handles_labels()
    labels = [f"{label} tap{'s' * (label != '1')}" for label in labels]
    marks, words = axes[0, 2].get_legend_handles_labels()
    handles, labels = [*handles, *marks], [*labels, *(f"C: {word}" for word in words)]
    key(figure, handles, labels, handlelength=1.2)
    return figure


@styled
def reliability_at_stopping(data: xr.Dataset) -> Figure:
    """Wrong decisions against the threshold, of all objects together and each, passive and active side by side.

    Args:
        data: From `reliability.reliability`.
    """
    shown = [name for name in ("passive", "active") if name in data["policy"].values]
    figure, axes = new_figure(TWO_COLUMNS if len(shown) > 1 else 4.4, 3.4, 1, len(shown), sharey=True, panel=2.2)
    for panel, letter, policy in zip(axes[0], "AB", shown, strict=False):
        plot_wrong(panel, at_stopping(data, policy).sel(counted="stopped"))
        label_panel(panel, letter if len(shown) > 1 else "", policy)
    axes[0, 0].set_ylabel("P(wrong), stopped trials")
    _key(figure, axes[0, 0])
    return figure


@styled
def guarantee_factors(data: xr.Dataset) -> Figure:
    """Ratio of error rates to the bounds of the stopping rule at each threshold, passive and active side by side.

    Args:
        data: From `guarantees.guarantees`.
    """
    shown = [str(name) for name in data["policy"].values]
    figure, axes = new_figure(TWO_COLUMNS if len(shown) > 1 else 4.4, 3.2, 1, len(shown), sharey=True, panel=2.2)
    for panel, letter, policy in zip(axes[0], "AB", shown, strict=False):
        plot_promises(panel, data.sel(policy=policy))
        label_panel(panel, letter if len(shown) > 1 else "", policy)
    axes[0, 0].set_ylabel("wrong / bound")
    _key(figure, axes[0, 0])
    return figure


@styled
def wanted_error(result: TargetError) -> Figure:
    """Errors and reaction times of the tuning sessions against the threshold, and what is chosen for a wanted error."""
    figure, axes = new_figure(TWO_COLUMNS, 3.2, 1, 2, width_ratios=(1.5, 1), panel=2.6)
    plot_sessions(axes[0, 0], result)
    plot_times(axes[0, 1], result)
    for panel, letter in zip(axes[0], "AB", strict=True):
        label_panel(panel, letter)
    _key(figure, axes[0, 0])
    return figure


def plot_curves(axes: Axes, data: xr.Dataset) -> Axes:
    """Draws the fraction right against the belief after four numbers of taps at most, darker for more."""
    axes.axline((0, 0), slope=1, color="grey", linewidth=0.8, linestyle=":")
    counts = np.unique(data["contacts"].values)
    counts = counts[np.unique(np.linspace(0, len(counts) - 1, _CURVES).round().astype(int))]
    for n, colour in zip(counts, mpl.colormaps["Reds"](np.linspace(0.35, 1.0, len(counts))), strict=True):
        part = data.sel(contacts=n)
        belief, right = part["curve_belief"].values, part["curve_right"].values
        full = np.isfinite(belief)
        axes.plot(belief[full], right[full], marker="o", color=colour, label=str(n))
        axes.vlines(
            belief[full],
            part["curve_right_low"].values[full],
            part["curve_right_high"].values[full],
            color=colour,
            linewidth=0.4,
        )
    axes.set(xlabel="belief in the decision", ylabel="fraction correct", xlim=(0, 1.02), ylim=(0, 1.02))
    return axes


def plot_scores(axes: Axes, data: xr.Dataset) -> Axes:
    """Draws calibration error and Brier score against the number of taps."""
    names = {"calibration_error": ("calibration error", "s", TRUE), "brier": ("Brier score", "^", DECIDED)}
    for name, (label, marker, colour) in names.items():
        _bars(axes, data["contacts"].values, data, name, color=colour, marker=marker, label=label)
    axes.set_ylim(0, max(0.05, axes.get_ylim()[1]))
    axes.set_xlabel("taps")
    _taps_axis(axes, data["contacts"].values)
    axes.set_ylim(0, 1.35 * axes.get_ylim()[1])  # room for the legend
    axes.legend(loc="upper left")
    return axes


def plot_factor(axes: Axes, data: xr.Dataset) -> Axes:
    """Draws the miscalibration factor against the number of taps, with 1, which is right, as a line.

    A factor of 0 is an open triangle at the lower end, one beyond `MOST_FACTOR` a triangle at the top.
    """
    axes.axhline(1, color="grey", linewidth=0.8, linestyle=":")
    taps, factor = data["contacts"].values, data["factor"].values
    none, beyond = factor == 0, factor > MOST_FACTOR
    value, low, high = _from_lowest(data)
    ends = {"factor": np.where(beyond, np.nan, value), "factor_low": low, "factor_high": np.minimum(high, MOST_FACTOR)}
    shown = data.assign({name: (data[name].dims, values) for name, values in ends.items()})
    marker = {"marker": "o", "markevery": (~none[np.isfinite(ends["factor"])]).tolist()}
    _bars(axes, taps, shown, "factor", color=PASSIVE, **marker)
    _log_factor(axes, data)
    look: dict[str, Any] = {"color": PASSIVE, "markersize": 5, "linestyle": "none", "zorder": 3, "clip_on": False}
    if none.any():
        words = "0: no wrong decision"
        axes.plot(taps[none], value[none], marker="v", markerfacecolor="white", label=words, **look)
    if beyond.any():
        top = axes.get_ylim()[1]
        axes.vlines(taps[beyond], np.minimum(low[beyond], top), top, color=PASSIVE, linewidth=0.6)
        axes.plot(taps[beyond], np.full(beyond.sum(), top), marker="^", label=f"over {MOST_FACTOR:g}", **look)
    if np.isnan(factor).all():
        axes.text(0.5, 0.6, "no errors and no doubt", ha="center", transform=axes.transAxes)
    axes.set(xlabel="taps", ylabel="wrong / mean (1 − belief)")
    _taps_axis(axes, taps)
    return axes


def plot_wrong(axes: Axes, data: xr.Dataset) -> Axes:
    """Draws the wrong fraction of all objects together and of each against the threshold, beside what beliefs say.

    The band is the interval of all together; what is below 0.0001 is drawn there.

    Args:
        axes: Where to.
        data: Over (theta, what).
    """
    x = 1 - data["theta"].values
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.plot(x, x, color="grey", linewidth=0.8, linestyle=":", label="1 − threshold")
    together = data.sel(what=EVERYTHING)
    axes.plot(x, _shown(together["doubt"].values), color="grey", linewidth=0.8, linestyle="--", label="1 − belief")
    named = data.sizes["what"] <= _NAMED + 1
    for name, style in _objects(data):
        axes.plot(
            x,
            _shown(data["wrong"].sel(what=name).values),
            label=short(str(name), data["what"].values.tolist()) if named else None,
            **style,
        )
    if not named:
        axes.plot([], [], color=OTHERS, linewidth=0.6, label="each")
    low, high = (_shown(together[f"wrong{end}"].values) for end in ("_low", "_high"))
    axes.fill_between(x, low, high, color="black", alpha=0.12, linewidth=0)
    axes.plot(x, _shown(together["wrong"].values), **_together())
    axes.set_ylim(_LEAST * 0.7, 1.3)
    axes.set_yticks([_LEAST, 1e-3, 0.01, 0.1, 1.0], [f"{_LEAST:g} or less", "0.001", "0.01", "0.1", "1"])
    _threshold_axis(axes, data["theta"].values)
    return axes


def plot_promises(axes: Axes, data: xr.Dataset) -> Axes:
    """Draws the factors of all objects together and of each, thresholds side by side.

    Args:
        axes: Where to.
        data: Over (setup, theta, what).
    """
    theta = data["theta"].values
    axes.set_yscale("log")
    axes.axhline(1, color="grey", linewidth=0.8, linestyle=":", label="bound")
    names = [str(name) for name in data["what"].values]
    styles = dict(_objects(data)) | {EVERYTHING: _together()}
    grey = len(names) > _NAMED + 1
    for i, setup in enumerate((PROMISED, USED)):
        filled = setup == PROMISED
        for j, name in enumerate(names):
            x = np.arange(len(theta)) + (i - 0.5) * 0.42 + 0.3 * ((j + 0.5) / len(names) - 0.5)
            part = data.sel(setup=setup, what=name)
            value, low, high = _from_lowest(part)
            full = np.isfinite(value)
            axes.errorbar(
                x[full],
                value[full],
                yerr=None
                if grey and name != EVERYTHING
                else np.maximum(np.stack([value - low, high - value])[:, full], 0),
                linestyle="none",
                elinewidth=0.6,
                color=styles[name]["color"],
                marker=styles[name].get("marker", "o"),
                markerfacecolor=styles[name]["color"] if filled else "white",
                label=short(str(name), names) if filled and not (grey and name != EVERYTHING) else None,
            )
    if grey:
        axes.plot([], [], "o", color=OTHERS, markersize=2, label="each")
    for filled, label in ((True, PROMISED), (False, USED)):
        axes.plot([], [], "o", color=OTHERS, markerfacecolor=OTHERS if filled else "white", label=label)
    ends = np.stack([data["factor"].values, data["factor_high"].values])
    axes.set_ylim(0.8 * _LOWEST, 2 * float(ends[np.isfinite(ends)].max(initial=1.0)))
    axes.fmt_xdata = lambda x: number(theta[round(x)], 6)
    axes.yaxis.set_major_formatter(_factor_tick)
    axes.set_xticks(range(len(theta)), [f"{value:g}" for value in theta])
    axes.set_xlabel("belief threshold")
    return axes


def plot_sessions(axes: Axes, result: TargetError) -> Axes:
    """Draws the error of each session, their mean and what a new one will do against the threshold."""
    curves, chosen = result.curves, result.chosen
    x = 1 - curves.theta
    low, high = prediction_interval(curves.error)
    line_bundle(axes, x, curves.error, colors=OTHERS, linewidths=0.6)
    axes.plot([], [], color=OTHERS, linewidth=0.6, label="sessions")
    # In a colour of its own, as it is not the interval of the mean.
    axes.fill_between(x, low, high, color="0.88", linewidth=0, label=f"new session, {COVERAGE:.0%}")
    axes.plot(x, curves.error.mean(axis=0), color="black", label="mean")
    axes.axhline(result.target, color="grey", linewidth=0.8, linestyle="--", label="wanted")
    left = result.left_out
    axes.plot(1 - left.theta, left.error, "x", color=TRUE, label="left out, tuned on the others", clip_on=False)
    label = "chosen" if result.reachable else "lowest; the target is not reachable"
    axes.plot([1 - chosen.theta], [chosen.error], "o", color=DECIDED, markersize=5, label=label)
    axes.plot([1 - result.default.theta], [result.default.error], "s", color=ACTIVE, label="default")
    axes.set_xscale("log")
    axes.set_ylim(0, min(1.02, max(1.1 * float(high.max()), 1.1 * result.target)))
    axes.set_ylabel("fraction of wrong decisions")
    _threshold_axis(axes, curves.theta)
    return axes


def plot_times(axes: Axes, result: TargetError) -> Axes:
    """Draws the mean reaction time of each session and all against the threshold."""
    curves = result.curves
    x = 1 - curves.theta
    axes.set_xscale("log")
    line_bundle(axes, x, curves.taps, colors=OTHERS, linewidths=0.6)
    axes.plot(x, curves.taps.mean(axis=0), color="black")
    axes.plot([1 - result.chosen.theta], [result.chosen.taps], "o", color=DECIDED, markersize=5)
    axes.plot([1 - result.default.theta], [result.default.taps], "s", color=ACTIVE)
    axes.set_ylim(0, None)
    axes.set_ylabel("mean reaction time (taps)")
    _threshold_axis(axes, curves.theta)
    return axes


def _objects(data: xr.Dataset) -> list[tuple[str, dict[str, Any]]]:
    """How each object is drawn: in colours of its own up to eight, else grey."""
    names = [str(name) for name in data["what"].values if name != EVERYTHING]
    if len(names) > _NAMED:
        return [(name, {"color": OTHERS, "linewidth": 0.6}) for name in names]
    return [
        (name, {"color": colour, "linewidth": 0.8, "marker": _MARKERS[1 + i % (len(_MARKERS) - 1)]})
        for i, (name, colour) in enumerate(zip(names, colours(len(names)), strict=True))
    ]


def _together() -> dict[str, Any]:
    return {"color": "black", "marker": "o", "label": EVERYTHING, "zorder": 3}


def _shown(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.maximum(values, _LEAST)


def _bars(axes: Axes, x: ArrayLike, data: xr.Dataset, name: str, **style: Any) -> None:
    """Finite values with their intervals; infinite ends are left out."""
    value, low, high = (data[f"{name}{end}"].values for end in ("", "_low", "_high"))
    finite = np.isfinite(value)
    x, value, low, high = np.asarray(x)[finite], value[finite], low[finite], high[finite]
    bars = np.maximum(np.stack([value - low, high - value]), 0.0)
    axes.errorbar(x, value, yerr=np.where(np.isfinite(bars), bars, 0.0), elinewidth=0.6, **style)


def _from_lowest(data: xr.Dataset) -> list[NDArray[np.float64]]:
    """Factors with the ends of their intervals, those below the axis at its lower end."""
    return [np.maximum(data[f"factor{end}"].values, _LOWEST) for end in ("", "_low", "_high")]


def _factor_tick(value: float, _: float) -> str:
    return f"{value:g} or less" if value <= _LOWEST else f"{value:g}"


def _log_factor(axes: Axes, data: xr.Dataset) -> None:
    """A log axis about 1 that holds the factors and, so far as they are within reach, the ends of their intervals."""
    value, low, high = _from_lowest(data)
    ends = np.concatenate([low, high])
    values = np.concatenate([value, ends[ends > _LEAST_END]])
    values = values[values <= MOST_FACTOR]
    least, most = 0.8 * min(0.6, values.min(initial=1.0)), 1.25 * max(1.6, values.max(initial=1.0))
    axes.set_yscale("log")
    axes.set_ylim(least, most)
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if most < 100 * least else (1.0,)))
    axes.yaxis.set_major_formatter(_factor_tick)
    axes.yaxis.set_minor_formatter(NullFormatter())


def _taps_axis(axes: Axes, values: NDArray[Any]) -> None:
    axes.set_xscale("log")
    axes.set_xlim(values.min() / 1.15, values.max() * 1.15)
    axes.set_xticks(values, [str(value) for value in values])
    axes.xaxis.set_minor_locator(NullLocator())


def _threshold_axis(axes: Axes, theta: NDArray[np.float64]) -> None:
    """Thresholds towards 1 on the logarithmic axis of 1 - threshold, which runs backwards."""
    marks = np.array([0.5, 0.9, 0.99, 0.999, 0.9999, 0.99999, 0.999999])
    if len(marks[(marks >= theta.min()) & (marks <= theta.max())]) < 3:
        marks = np.array([0.2, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 0.995, 0.999])
    marks = marks[(marks >= theta.min() - 1e-12) & (marks <= theta.max() + 1e-12)]
    if not len(marks):
        marks = np.unique(theta)
    axes.xaxis.set_major_locator(FixedLocator((1 - marks).tolist()))
    axes.set_xticklabels([f"{mark:.6g}" for mark in marks], rotation=30 if marks[-1] > 0.9995 else 0)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlim(1.15 * (1 - theta.min()), (1 - theta.max()) / 1.15)
    axes.set_xlabel("belief threshold")
    axes.fmt_xdata = lambda x: number(1 - x, 6)


def _key(figure: Figure, axes: Axes) -> None:
    """One key below all panels."""
    handles, labels = axes.get_legend_handles_labels()
    key(figure, handles, labels)
