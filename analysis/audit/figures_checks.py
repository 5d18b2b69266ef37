"""Figure of the posterior predictive checks of an audit."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ..page.figure_sizes import TWO_COLUMNS, key, new_figure
from ..page.figure_style import ACTIVE, DECIDED, TRUE, styled
from ..page.numbers import number
from .checks import FAR, summarise_checks

_ROW = 0.26  # inches
_BAND = "#ececec"
_TICKS = (3, 10, 30, 100, 300, 1000, 10_000, 100_000)
_MOST = 1e6  # standard deviations, where the axis ends at most
_REPLICATES: dict[str, Any] = {"color": ACTIVE, "marker": "|", "markersize": 6}
_OBSERVED: dict[bool, dict[str, Any]] = {
    True: {"color": DECIDED, "marker": "D", "linestyle": "none", "markersize": 4.5},
    False: {"color": TRUE, "marker": "o", "linestyle": "none", "markersize": 4.5, "markerfacecolor": "white"},
}


@styled
def figure_checks(tree: xr.DataTree) -> Figure | None:
    """How far each observed statistic is from those of replicates, a row each, in standard deviations of these.

    Args:
        tree: From `checks.audit_checks`.

    Returns:
        The figure, `None` where the taps show no statistic.
    """
    summary = summarise_checks(tree)
    if not summary.sizes["statistic"]:
        return None
    figure, axes = new_figure(TWO_COLUMNS, 1.0 + _ROW * summary.sizes["statistic"], of_text=True, whole=True)
    plot_checks(axes[0, 0], summary, tree["posterior_predictive"].to_dataset())
    marks = {
        "replicates, all": Line2D([], [], **_REPLICATES),
        "observed, outside the replicates": Line2D([], [], **_OBSERVED[True]),
        "observed, within": Line2D([], [], **_OBSERVED[False]),
    }
    key(figure, list(marks.values()), list(marks))
    return figure


def plot_checks(axes: Axes, summary: xr.Dataset, predicted: xr.Dataset) -> Axes:
    """Draws a row per statistic: the range of replicates, the observed value, and both as numbers at the right.

    The axis is linear within the grey band, in which no difference is significant, and logarithmic beyond.
    """
    axes.set_xscale("symlog", linthresh=FAR, linscale=0.8)
    axes.axvspan(-FAR, FAR, color=_BAND, linewidth=0)
    axes.axvline(0, color="grey", linewidth=0.6)
    z = np.clip(summary["z"].values, -_MOST, _MOST)
    spans = np.array([_span(predicted[str(name)].values.ravel()) for name in summary["statistic"].values])
    for i, (span, seen) in enumerate(zip(spans, z, strict=True)):
        row = summary.isel(statistic=i)
        axes.plot(span, [i, i], linewidth=1.2, **_REPLICATES)
        axes.plot(seen, i, zorder=3, **_OBSERVED[bool(row["differs"])])
        ends = " to ".join(number(float(row[end]), 2) for end in ("low", "high"))
        words = f"{number(float(row['observed']), 2)}, replicates {ends}"
        axes.annotate(words, (1.01, i), xycoords=("axes fraction", "data"), va="center", fontsize="small")
    reach = 1.6 * max(2 * FAR, np.abs(z).max(), np.abs(spans).max())
    least = -reach if min(z.min(), spans.min()) < -2 * FAR else -1.6 * FAR
    ticks = [tick for tick in _TICKS if tick < reach]
    ticks = [*(-tick for tick in reversed(ticks) if -tick > least), 0, *ticks]
    axes.set_xticks(ticks, [number(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_xlim(least, reach)
    axes.set_yticks(range(len(z)), [str(label) for label in summary["label"].values])
    axes.set_ylim(len(z) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("statistic − mean of the replicates (standard deviations of the replicates)")
    return axes


def _span(values: NDArray[np.float64]) -> tuple[float, float]:
    """Ends of replicates in their standard deviations about their mean."""
    sd = values.std(ddof=1)
    ends = np.array([values.min(), values.max()]) - values.mean()
    low, high = ends / sd if sd > 0 else np.zeros(2)
    return float(low), float(high)
