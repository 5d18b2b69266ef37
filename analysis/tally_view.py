"""Counted trials as a table in the terminal."""

from collections.abc import Sequence

import numpy as np
from rich import box
from rich.table import Table
from scipy.special import ndtri

from ..inference.tally import Tally
from ..models.classes import ClassGrid
from .figure_style import axis_label, short_unit
from .metrics import CONFIDENCE
from .tallied import UNCERTAIN, tally_means

_DECIMALS = 5
_LEGEND = "wrong: fraction that decide for a wrong object; belief: mean belief in the decided object."
_INTERVAL = (
    f"Intervals are {CONFIDENCE:.0%} normal intervals over the Monte Carlo trials of this one data set; they hold the "
    "sampling of trials only, not how another recording would differ."
)


def tally_table(tally: Tally, grid: ClassGrid, thresholds: Sequence[float], what_for: str) -> Table:
    """One row per threshold, with half the width of the normal interval over trials behind what has one.

    Args:
        tally: The counts.
        grid: The classes.
        thresholds: theta_W, shape (H,).
        what_for: Which trials these are, behind their number in the title.
    """
    means = tally_means(tally, grid)
    table = Table(
        title=f"{tally.trials:,} {what_for}",
        caption=f"{_LEGEND} {_INTERVAL}",
        title_justify="left",
        caption_justify="left",
        box=box.SIMPLE,
        padding=(0, 1, 0, 0),
    )
    units = {"what_error": grid.what_error_unit, "where_error": short_unit(grid.where_unit)}
    names = {name: axis_label(name.replace("_", " "), unit).replace(" (", "\n(") for name, unit in units.items()}
    rest = {"what_wrong": "wrong", "belief": "belief", "stopped_fraction": "stopped"}
    if tally.no_class_left.any():
        rest["no_class_left_fraction"] = "no class\nleft"
    for heading in ("theta", *names.values(), "taps", *rest.values()):
        table.add_column(heading, justify="right", no_wrap=True)
    for h, theta in enumerate(thresholds):
        uncertain = [_with_half(means[name][h], means[f"{name}_se"][h]) for name in UNCERTAIN]
        table.add_row(f"{theta:g}", *uncertain, *(f"{means[name][h]:.4f}" for name in rest))
    return table


def _with_half(mean: float, se: float) -> str:
    """A mean with as many digits as its interval allows."""
    half = float(ndtri(0.5 + CONFIDENCE / 2)) * se
    if not half > 0:
        return f"{mean:.4g}"
    decimals = int(np.clip(np.ceil(-np.log10(half)), 0, _DECIMALS))
    return f"{mean:.{decimals}f}±{half:.{decimals}f}"
