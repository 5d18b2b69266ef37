"""Figures of tuning: error and cost over positions and thresholds, and regret of learners."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import t
from solidtouch.analysis.page.figure_sizes import TWO_COLUMNS, new_figure
from solidtouch.analysis.page.figure_style import (
    ACTIVE,
    DECIDED,
    OTHERS,
    TRUE,
    axis_label,
    class_ticks,
    label_panel,
    styled,
)
from solidtouch.analysis.stats.metrics import CONFIDENCE
from solidtouch.analysis.tuning.run import Tuning
from solidtouch.inference.tuning.held_out import Estimate

_COLOURS = {"thompson": DECIDED, "random": OTHERS}
_NAMES = {"thompson": "arms apart", "random": "random pair"}


@styled
def tuning_figure(found: Tuning) -> Figure:
    """Error over positions and cost over thresholds, with 95% intervals and what was chosen."""
    figure, axes = new_figure(TWO_COLUMNS, 2.4, 1, 2)
    plot_positions(axes[0, 0], found)
    label_panel(axes[0, 0], "A")
    plot_thresholds(axes[0, 1], found)
    label_panel(axes[0, 1], "B")
    return figure


def plot_positions(axes: Axes, found: Tuning) -> Axes:
    """Expected error at every position that was tried."""
    choice, grid = found.fixation, found.grid
    tried = np.flatnonzero(np.isfinite(choice.error.mean))
    _curve(axes, grid.where_value[tried], Estimate(*(values[tried] for values in choice.error)), ACTIVE)
    alike = choice.alike
    axes.plot(grid.where_value[alike], choice.error.mean[alike], "o", color=TRUE, label="within one standard error")
    axes.plot(
        grid.where_value[choice.chosen], choice.error.mean[choice.chosen], "D", color=DECIDED, label="chosen", ms=5
    )
    class_ticks(axes, grid.where_value)
    axes.set_xlabel(axis_label("fixation point", grid.where_unit))
    axes.set_ylabel(axis_label("object error", "P(wrong)" if found.price.wrong else grid.what_error_unit))
    axes.legend()
    return axes


def plot_thresholds(axes: Axes, found: Tuning) -> Axes:
    """Expected cost at every threshold."""
    choice = found.threshold
    x = 1 - choice.theta
    _curve(axes, x, choice.cost, ACTIVE)
    axes.plot(x, choice.taps.mean, color=OTHERS, label="taps, part of the cost")
    axes.plot(x[found.chosen], choice.cost.mean[found.chosen], "D", color=DECIDED, label="chosen", ms=5)
    axes.set_xscale("log")
    axes.invert_xaxis()
    axes.set_xlabel("1 \N{MINUS SIGN} threshold")
    axes.set_ylabel("cost (taps)")
    axes.legend()
    return axes


@styled
def regret_figure(regret: Mapping[str, NDArray[np.float64]]) -> Figure:
    """Mean regret over data sets with 95% intervals: the sum, and each episode's share of it.

    Args:
        regret: After each episode on each data set, shape (D, T), by the name of the learner.
    """
    figure, axes = new_figure(TWO_COLUMNS, 2.6, 1, 2)
    for name, values in regret.items():
        episodes = np.arange(1, values.shape[1] + 1)
        for panel, shown in zip(axes[0], (values, values / episodes), strict=True):
            _curve(panel, episodes, _over(shown), _COLOURS[name], _NAMES[name])
    for panel, letter, quantity in zip(axes[0], "AB", ("regret", "regret of an episode"), strict=True):
        panel.set_xscale("log")
        panel.set_xlabel("episodes")
        panel.set_ylabel(axis_label(quantity, "taps"))
        label_panel(panel, letter)
    axes[0, 0].set_yscale("log")
    axes[0, 1].set_ylim(bottom=0)
    axes[0, 0].legend()
    return figure


def _curve(axes: Axes, x: NDArray[Any], estimate: Estimate, colour: str, name: str | None = None) -> None:
    axes.fill_between(x, estimate.low, estimate.high, color=colour, alpha=0.18, linewidth=0)
    axes.plot(x, estimate.mean, color=colour, label=name)


def _over(values: NDArray[np.float64]) -> Estimate:
    """Mean over data sets, shape (D, T), with its interval."""
    mean, error = values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(len(values))
    half = t.ppf(0.5 + CONFIDENCE / 2, len(values) - 1) * error
    return Estimate(mean, error, mean - half, mean + half)
