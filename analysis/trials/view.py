"""Counted trials as a table in the terminal."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.table import Table

from ...inference.trials.tally import Tally
from ...models.grid import ClassGrid
from ..page.figure_style import axis_label, short_unit
from ..stats.tallied import tally_means
from .spread import SPREAD, TapSpread

type Floats = NDArray[np.float64]

_DECIMALS = 5
_LEGEND = (
    "wrong: fraction that decide for a wrong object; belief: mean belief in the decided object. Stored: trials draw "
    "stored taps with replacement up to the deadline; taps that come twice in a trial make beliefs too sure. Fresh: no "
    "trial draws a tap twice, and one that has used up the taps of its class decides there."
)


def tally_table(
    tally: Tally, grid: ClassGrid, thresholds: Sequence[float], what_for: str, spread: TapSpread | None = None
) -> Table:
    """Two rows per threshold: trials as they were asked for, and trials on fresh taps; each with intervals over taps.

    Args:
        tally: The counts.
        grid: The classes.
        thresholds: theta_W, shape (H,).
        what_for: Which trials these are, behind their number in the title.
        spread: Trials on resampled and on fresh taps; without it there are no intervals, and one row.
    """
    means = tally_means(tally, grid)
    table = Table(
        title=f"{tally.trials:,} {what_for}",
        caption=" ".join(filter(None, (_LEGEND, spread.sentence, spread.few))) if spread else _LEGEND,
        title_justify="left",
        caption_justify="left",
        box=box.SIMPLE,
        padding=(0, 1, 0, 0),
    )
    units = {"what_error": grid.what_error_unit, "where_error": short_unit(grid.where_unit)}
    names = {name: axis_label(name.replace("_", " "), unit).replace(" (", "\n(") for name, unit in units.items()}
    shown = dict(zip(SPREAD, (*names.values(), "taps", "wrong", "belief", "stopped", "no class\nleft"), strict=True))
    if not (tally.no_class_left.any() or (spread and spread.fresh["no_class_left_fraction"][:, 0].any())):
        del shown["no_class_left_fraction"]
    for heading in ("theta", "on taps", *shown.values()):
        table.add_column(heading, justify="right", no_wrap=True)
    intervals = spread.intervals(means) if spread else {}
    fresh = {name: values[:, 0] for name, values in spread.fresh.items()} if spread else {}
    fresh_intervals = spread.fresh_intervals() if spread else {}
    for h, theta in enumerate(thresholds):
        table.add_row(f"{theta:g}", "stored", *_cells(shown, means, intervals, h))
        if spread:
            table.add_row("", "fresh", *_cells(shown, fresh, fresh_intervals, h))
    return table


def _cells(
    names: Iterable[str], means: Mapping[str, Floats], intervals: Mapping[str, tuple[Floats, Floats]], h: int
) -> list[str]:
    ends = {name: (low[h], high[h]) for name, (low, high) in intervals.items()}
    return [with_interval(means[name][h], *ends.get(name, (np.nan, np.nan))) for name in names]


def with_interval(value: float, low: float, high: float) -> str:
    """A number and its interval with as many digits as that allows; without, where there is none."""
    half = (high - low) / 2
    if not half > 0:
        return f"{value:.4g}"
    decimals = int(np.clip(np.ceil(-np.log10(half / 3)), 0, _DECIMALS))
    return f"{value:.{decimals}f} [{low:.{decimals}f}, {high:.{decimals}f}]"
