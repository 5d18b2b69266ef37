"""Figures of the prediction of taps: groups left out, single taps left out, and predictive checks."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ..page.figure_sizes import TWO_COLUMNS, key, new_figure
from ..page.figure_style import OTHERS, TRUE, label_panel, short, styled
from .figures import model_styles

_ROW = 0.24  # inches per model
_CHECKS = 3  # panels beside each other


@styled
def groups_left_out(means: xr.Dataset) -> Figure:
    """Difference of each model's mean log probability per tap to that of the reference model, groups left out.

    Args:
        means: From `taps.mean_scores`, of `integrated` and `plug_in` or one of them.
    """
    names = [str(name) for name in means["model"].values]
    figure, axes = new_figure(TWO_COLUMNS, 0.9 + _ROW * max(len(names), 4), of_text=True)
    plot_groups_left_out(axes[0, 0], means)
    key(figure, *axes[0, 0].get_legend_handles_labels(), above=True)
    return figure


def plot_groups_left_out(axes: Axes, means: xr.Dataset) -> Axes:
    """Dots with intervals, a row per model: filled where parameters are integrated over, open where they are fixed."""
    names = [str(name) for name in means["model"].values]
    styles = model_styles(names, means.attrs.get("reference", names[0]))
    for kind, offset, filled, label in (
        ("integrated", -0.16, True, "integrated over the posterior"),
        ("plug_in", 0.16, False, "plug-in parameters"),
    ):
        if kind not in means:
            continue
        for i, name in enumerate(names):
            row = means.sel(model=name)
            middle, low, high = (float(row[f"{kind}_difference{end}"]) for end in ("", "_low", "_high"))
            if not np.isfinite(middle):
                continue
            colour = styles[name]["color"]
            axes.plot([low, high], [i + offset] * 2, color=colour, linewidth=0.8, solid_capstyle="butt")
            face = colour if filled else "white"
            axes.plot(middle, i + offset, "o", color=colour, markerfacecolor=face, markersize=4)
        axes.plot([], [], "o", color="black", markerfacecolor="black" if filled else "white", markersize=4, label=label)
    axes.axvline(0, color=OTHERS, linewidth=0.6, zorder=0)
    axes.set_yticks(range(len(names)), [short(name, names) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel(f"log probability per tap − that of {short(means.attrs.get('reference', names[0]))} (nat)")
    return axes


@styled
def pareto(left_out: xr.Dataset) -> Figure:
    """Pareto k of the training taps looked at under every model, with the share that importance sampling fails on.

    Args:
        left_out: Over (model, tap), from `taps.leave_one_tap_out`.
    """
    names = [str(name) for name in left_out["model"].values]
    figure, axes = new_figure(TWO_COLUMNS, 0.9 + _ROW * max(len(names), 4), of_text=True)
    plot_pareto(axes[0, 0], left_out)
    return figure


def plot_pareto(axes: Axes, left_out: xr.Dataset) -> Axes:
    """Quantiles of Pareto k, a row per model."""
    names = [str(name) for name in left_out["model"].values]
    styles = model_styles(names, names[0])
    good_k = float(left_out["good_k"].min())
    for i, name in enumerate(names):
        one = left_out.sel(model=name)
        k = one["pareto_k"].values[one["looked_at"].values.astype(bool)]
        if np.isfinite(k).any():
            low, quarter, median, three, high = np.quantile(k[np.isfinite(k)], [0.025, 0.25, 0.5, 0.75, 0.975])
            colour = styles[name]["color"]
            axes.plot([low, high], [i, i], color=colour, linewidth=0.8)
            axes.plot([quarter, three], [i, i], color=colour, linewidth=3.5, solid_capstyle="butt")
            axes.plot(median, i, "o", color="white", markeredgecolor=colour, markersize=4)
        axes.annotate(
            f"{(~(k <= good_k)).mean():.0%} of {len(k)} above {good_k:.2g}" if np.isfinite(k).any() else "no Pareto k",
            (1.01, i),
            xycoords=("axes fraction", "data"),
            va="center",
            fontsize="small",
        )
    axes.axvline(good_k, color=OTHERS, linewidth=0.8, linestyle="--", zorder=0)
    axes.set_yticks(range(len(names)), [short(name, names) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel("Pareto k of the training taps looked at: median, central 50% and 95%")
    return axes


@styled
def predictive_checks(checks: xr.Dataset) -> Figure:
    """Statistics of the training taps and of replicates from each model, a panel per statistic.

    Args:
        checks: From `stats.checks.predictive_checks`.
    """
    names = [str(name) for name in checks["model"].values]
    count = checks.sizes["statistic"]
    columns = min(_CHECKS, count)
    rows = -(-count // columns)
    height = rows * (0.7 + _ROW * len(names)) + 0.3
    figure, axes = new_figure(TWO_COLUMNS, height, rows, columns, sharey=True, of_text=True)
    for i, (panel, statistic) in enumerate(zip(axes.flat, checks["statistic"].values, strict=False)):
        plot_check(panel, checks.sel(statistic=statistic), names)
        label_panel(panel, chr(ord("A") + i))
    for panel in list(axes.flat)[count:]:
        panel.set_visible(False)
    key(
        figure,
        [
            Line2D([], [], color=TRUE, linewidth=1.6, label="training taps"),
            Line2D([], [], color="black", marker="o", label="replicates: median and central 95%"),
        ],
    )
    return figure


def plot_check(axes: Axes, check: xr.Dataset, names: list[str]) -> Axes:
    """The observed value as a line; median and central 95% of each model's replicates as a dot with a bar."""
    observed = float(check["observed"])
    axes.axvline(observed, color=TRUE, linewidth=1.6, zorder=0)
    styles = model_styles(names, names[0])
    values: NDArray[Any] = check["replicated"].values
    for i, name in enumerate(names):
        known = values[i][np.isfinite(values[i])]
        if known.size:
            low, median, high = np.quantile(known, [0.025, 0.5, 0.975])
            look = {"color": styles[name]["color"], "marker": styles[name]["marker"], "markersize": 3.6}
            axes.plot([low, high], [i, i], color=look["color"], linewidth=1.6, solid_capstyle="butt")
            axes.plot(median, i, linestyle="none", **look)
    axes.set_yticks(range(len(names)), [short(name, names) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    every = np.append(values[np.isfinite(values)], observed)
    margin = 0.06 * (np.ptp(every) or 1.0)
    axes.set_xlim(every.min() - margin, every.max() + margin)
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlabel(str(check["label"].values))
    return axes
