"""Figure of the posterior predictive checks of an audit."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ..page.figure_style import DECIDED, TRUE, TWO_COLUMNS, label_panel, new_figure, styled
from ..page.numbers import number
from .checks import summarise_checks

_ROUNDING = 1e-9
_COLUMNS = 3


@styled
def figure_checks(tree: xr.DataTree) -> Figure | None:
    """Histograms of the statistics of replicates, and what was observed as a line.

    Args:
        tree: From `checks.audit_checks`.

    Returns:
        A panel per statistic, `None` where the taps show none.
    """
    summary = summarise_checks(tree)
    names = [str(name) for name in summary["statistic"].values]
    if not names:
        return None
    columns = min(_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    figure, axes = new_figure(TWO_COLUMNS * columns / _COLUMNS, 1.4 * rows + 0.35, rows, columns)
    for panel in list(axes.flat)[len(names) :]:
        panel.set_visible(False)
    predicted = tree["posterior_predictive"].to_dataset()
    for i, (panel, name) in enumerate(zip(axes.flat, names, strict=False)):
        plot_observed(panel, summary.sel(statistic=name), predicted[name].values.ravel())
        label_panel(panel, chr(ord("A") + i))
    _key(figure)
    return figure


def plot_observed(axes: Axes, check: xr.Dataset, values: NDArray[np.float64]) -> Axes:
    """Draws what was observed as a line on a histogram of replicates, orange and solid where they differ."""
    if np.ptp(values) > _ROUNDING * np.abs(values).max():
        counts, edges = np.histogram(values, "auto")
        axes.plot(np.repeat(edges, 2), np.pad(np.repeat(counts, 2), 1), color="black", linewidth=0.8)
    else:
        axes.axvline(values[0], ymax=0.9, color="black", linewidth=0.8)
    seen = float(check["observed"])
    axes.axvline(seen, ymax=0.9, **_line(differs=bool(check["differs"])))
    low, high = min(seen, values.min()), max(seen, values.max())
    margin = 0.05 * (high - low or abs(high) or 1.0)
    axes.set_xlim(low - margin, high + margin)
    axes.set_ylim(0, None)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.locator_params(axis="x", nbins=4)
    expected = f"{number(float(check['low']), 2)} to {number(float(check['high']), 2)}"
    axes.set_xlabel(f"{check['label'].values!s}\n{number(seen, 2)}, replicates {expected}")
    return axes


def _line(*, differs: bool) -> dict[str, Any]:
    return {"color": DECIDED if differs else TRUE, "linestyle": "-" if differs else "--", "linewidth": 1.6, "zorder": 0}


def _key(figure: Figure) -> None:
    keys = {
        "replicates": Line2D([], [], color="black", linewidth=0.8),
        "observed, outside the replicates": Line2D([], [], **_line(differs=True)),
        "observed, within the replicates": Line2D([], [], **_line(differs=False)),
    }
    figure.legend(list(keys.values()), list(keys), loc="outside lower center", ncols=3)
