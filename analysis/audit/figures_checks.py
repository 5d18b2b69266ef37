"""Figure of the posterior predictive checks of an audit."""

from collections.abc import Mapping
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
    """Statistics of replicates as `arviz_plots.plot_ppc_tstat` draws them, and what was observed as a line.

    Args:
        tree: From `checks.audit_checks`.

    Returns:
        A panel per statistic, `None` where the taps show none.
    """
    import arviz_plots as azp  # noqa: PLC0415

    summary = summarise_checks(tree)
    names = [str(name) for name in summary["statistic"].values]
    if not names:
        return None
    columns = min(_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    figure, axes = new_figure(TWO_COLUMNS * columns / _COLUMNS, 1.4 * rows + 0.35, rows, columns)
    panels = dict(zip(names, axes.flat, strict=False))
    for panel in list(axes.flat)[len(names) :]:
        panel.set_visible(False)
    predicted = tree["posterior_predictive"].to_dataset()
    varied = [name for name in names if _varies(predicted[name].values)]
    if varied:
        azp.plot_ppc_tstat(
            # Without the observed data, a single 0 or 1 of which would be warned of as binary.
            xr.DataTree.from_dict({"posterior_predictive": predicted[varied]}),
            t_stat="mean",  # of the single value that a replicate has
            kind="hist",
            plot_collection=_collection(predicted[varied], figure, panels),
            visuals={"dist": {"color": "black", "width": 0.8}, "observed_tstat": False, "title": False},
        )
        for name in varied:
            _close(panels[name])
    for i, name in enumerate(names):
        plot_observed(panels[name], summary.sel(statistic=name), predicted[name].values.ravel())
        label_panel(panels[name], chr(ord("A") + i))
    _key(figure)
    return figure


def _close(axes: Axes) -> None:
    """Leads the outline of a histogram down to the axis at both ends."""
    for line in axes.get_lines():
        x, y = np.asarray(line.get_data())
        line.set_data(np.pad(x, 1, mode="edge"), np.pad(y, 1))


def plot_observed(axes: Axes, check: xr.Dataset, values: NDArray[np.float64]) -> Axes:
    """Draws what was observed as a line beside the replicates, orange and solid where they differ, and says both."""
    seen = float(check["observed"])
    axes.axvline(seen, ymax=0.9, **_line(differs=bool(check["differs"])))
    if not _varies(values):
        axes.axvline(values[0], ymax=0.9, color="black", linewidth=0.8)
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


def _varies(values: NDArray[np.float64]) -> bool:
    """Whether there is more than rounding to be drawn."""
    return bool(np.ptp(values) > _ROUNDING * np.abs(values).max())


def _collection(predicted: xr.Dataset, figure: Figure, panels: Mapping[str, Axes]) -> Any:
    """An ArviZ plot collection over axes that are already there."""
    import arviz_plots as azp  # noqa: PLC0415

    def whole(things: Mapping[str, Any]) -> xr.Dataset:
        return xr.Dataset({name: ((), np.array(thing, dtype=object)) for name, thing in things.items()})

    names, numbers = list(map(str, predicted)), {name: i for i, name in enumerate(panels)}
    parts = {
        "/": whole({"figure": figure}),
        "plot": whole({name: panels[name] for name in names}),
        "row_index": whole({name: numbers[name] // _COLUMNS for name in names}),
        "col_index": whole({name: numbers[name] % _COLUMNS for name in names}),
    }
    collection: Any = azp.PlotCollection  # pyright: ignore[reportPrivateImportUsage]
    return collection(predicted, xr.DataTree.from_dict(parts), backend="matplotlib", aes={})


def _line(*, differs: bool) -> dict[str, Any]:
    return {"color": DECIDED if differs else TRUE, "linestyle": "-" if differs else "--", "linewidth": 1.6, "zorder": 0}


def _key(figure: Figure) -> None:
    keys = {
        "replicates": Line2D([], [], color="black", linewidth=0.8),
        "observed, outside the replicates": Line2D([], [], **_line(differs=True)),
        "observed, within the replicates": Line2D([], [], **_line(differs=False)),
    }
    figure.legend(list(keys.values()), list(keys), loc="outside lower center", ncols=3)
