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
_LINES = {"random": (0, (4, 1.5))}
_ROOM = 1.6  # the top of the axis of costs over the largest mean; wider intervals are cut


@styled
def tuning_figure(found: Tuning) -> Figure:
    """Error over positions, in each part and on average, and cost over thresholds with its interval; both choices."""
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
    for part, errors in enumerate(choice.errors):
        label = None if part else "a session left out"
        axes.plot(grid.where_value[tried], errors[tried], color=OTHERS, linewidth=0.8, label=label)
    axes.plot(grid.where_value[tried], choice.error.mean[tried], color=ACTIVE, label="mean")
    alike = choice.alike
    axes.plot(grid.where_value[alike], choice.error.mean[alike], "o", color=TRUE, label="within one standard error")
    axes.plot(
        grid.where_value[choice.chosen], choice.error.mean[choice.chosen], "D", color=DECIDED, label="chosen", ms=5
    )
    class_ticks(axes, grid.where_value)
    axes.set_ylim(bottom=0)
    axes.set_xlabel(axis_label("fixation point", grid.where_unit))
    axes.set_ylabel(axis_label("object error", "P(wrong)" if found.price.wrong else grid.what_error_unit))
    axes.legend()
    return axes


def plot_thresholds(axes: Axes, found: Tuning) -> Axes:
    """Expected cost at every threshold."""
    choice = found.threshold
    x = 1 - choice.theta
    _curve(axes, x, choice.cost, ACTIVE, label="cost, with its 95% interval")
    axes.plot(x, choice.taps.mean, color=TRUE, linestyle=(0, (4, 1.5)), label="its part for taps")
    axes.plot(x[found.chosen], choice.cost.mean[found.chosen], "D", color=DECIDED, label="chosen", ms=5)
    axes.set_xscale("log")
    axes.invert_xaxis()
    axes.set_ylim(0, _ROOM * choice.cost.mean.max())
    axes.set_xlabel("1 \N{MINUS SIGN} threshold")
    axes.set_ylabel("cost (taps)")
    axes.legend()
    return axes


@styled
def regret_figure(regrets: Mapping[str, Mapping[str, NDArray[np.float64]]]) -> Figure:
    """Mean regret per episode over data sets with 95% intervals, a panel for each preset.

    Args:
        regrets: By preset and learner, total regret after each episode on each data set, shape (D, T).
    """
    figure, axes = new_figure(TWO_COLUMNS, 2.4, 1, len(regrets), sharey=True)
    for panel, letter, (preset, curves) in zip(axes[0], "ABC", regrets.items(), strict=False):
        for name, total in curves.items():
            episodes = np.arange(1, total.shape[1] + 1)
            look = {"label": name, "linestyle": _LINES.get(name, "-")}
            _curve(panel, episodes, _over(total / episodes), _COLOURS[name], **look)
        panel.set_xscale("log")
        panel.set_xlim(1, None)
        panel.set_xlabel("episodes")
        label_panel(panel, letter, f"preset {preset}")
    axes[0, 0].set_ylim(bottom=0)
    axes[0, 0].set_ylabel(axis_label("mean regret per episode", "taps"))
    axes[0, 0].legend(loc="lower left")
    return figure


def _curve(axes: Axes, x: NDArray[Any], estimate: Estimate, colour: str, **look: Any) -> None:
    axes.fill_between(x, estimate.low, estimate.high, color=colour, alpha=0.14, linewidth=0)
    axes.plot(x, estimate.mean, color=colour, **look)


def _over(values: NDArray[np.float64]) -> Estimate:
    """Mean over data sets, shape (D, T), with its interval."""
    mean, error = values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(len(values))
    half = t.ppf(0.5 + CONFIDENCE / 2, len(values) - 1) * error
    return Estimate(mean, error, mean - half, mean + half)
