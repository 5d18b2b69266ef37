"""Table of counted trials."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...inference.trials.tally import Tally
from ...models.grid import ClassGrid
from ..page.figure_style import axis_label, unit_name
from ..page.numbers import bounded
from ..page.page import Brief, Cautions, Page, Table
from ..stats.tallied import tally_means
from .spread import SPREAD, TapSpread

type Floats = NDArray[np.float64]

_LEGEND = (
    "Wrong: fraction of wrong decisions about the object; belief: mean belief in the decided object. Stored: "
    "trials draw taps with replacement up to the deadline; repeated taps make beliefs overconfident. Fresh: no trial "
    "draws a tap twice; a trial that uses up the taps of its class decides there."
)


def tally_page(
    tally: Tally, grid: ClassGrid, thresholds: Sequence[float], what_for: str, spread: TapSpread | None = None
) -> Page:
    """Two rows per threshold: trials as they were asked for, and trials on fresh taps; each with intervals over taps.

    Args:
        tally: The counts.
        grid: The classes.
        thresholds: theta_W, shape (H,).
        what_for: Which trials these are, behind their number in the title.
        spread: Trials on resampled and on fresh taps; without it there are no intervals, and one row.
    """
    means = tally_means(tally, grid)
    units = {"what_error": grid.what_error_unit, "where_error": unit_name(grid.where_unit)}
    names = [
        axis_label(name, unit) for name, unit in zip(("object error", "position error"), units.values(), strict=True)
    ]
    shown = dict(zip(SPREAD, (*names, "taps", "wrong", "belief", "stopped", "no class left"), strict=True))
    if not (tally.no_class_left.any() or (spread and spread.fresh["no_class_left_fraction"][:, 0].any())):
        del shown["no_class_left_fraction"]
    intervals = spread.intervals(means) if spread else {}
    fresh = {name: values[:, 0] for name, values in spread.fresh.items()} if spread else {}
    fresh_intervals = spread.fresh_intervals() if spread else {}
    rows: list[list[str]] = []
    for h, theta in enumerate(thresholds):
        rows.append([f"{theta:g}", "stored", *_cells(shown, means, intervals, h)])
        if spread:
            rows.append(["", "fresh", *_cells(shown, fresh, fresh_intervals, h)])
    title = f"{tally.trials:,} {what_for}"
    legend = " ".join((_LEGEND, spread.sentence)) if spread else _LEGEND
    found = Table(["theta", "draws", *shown.values()], rows, title)
    cautions = Cautions([spread.few] if spread and spread.few else [])
    return Page(title, [Brief(found), Brief(cautions), Brief(legend)], [])


def _cells(
    names: Iterable[str], means: Mapping[str, Floats], intervals: Mapping[str, tuple[Floats, Floats]], h: int
) -> list[str]:
    ends = {name: (low[h], high[h]) for name, (low, high) in intervals.items()}
    return [bounded(means[name][h], *ends.get(name, (np.nan, np.nan))) for name in names]
