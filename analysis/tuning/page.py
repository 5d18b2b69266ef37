"""Tables of a tuning: curves over positions and thresholds."""

import numpy as np

from ...inference.tuning.held_out import Estimate
from ..page.numbers import rounded
from ..page.page import Table
from .run import Tuning, shown_threshold, unit_of

_ROWS = 16  # thresholds that are shown


def position_table(found: Tuning) -> Table:
    """Error at every position that was tried, with interval."""
    choice, grid = found.fixation, found.grid
    columns = ("class", "position", f"error ({unit_of(found)})", "95% interval", "above the lowest", "taps", "")
    rows = []
    for l in np.flatnonzero(np.isfinite(choice.error.mean)).tolist():
        mark = "chosen" if l == choice.chosen else "not worse" if choice.alike[l] else ""
        more = f"{choice.excess.mean[l]:.3f} ± {choice.excess.error[l]:.3f}"
        taps = f"{choice.taps[:, l].mean():.1f}"
        rows.append([str(l), grid.where_label(l), *_estimate(choice.error, l), more, taps, mark])
    return Table(columns, rows, "Fixation points")


def threshold_table(found: Tuning) -> Table:
    """Error, taps and cost at some of the thresholds, the chosen one among them."""
    choice = found.threshold
    shown = np.linspace(0, len(choice.theta) - 1, min(_ROWS, len(choice.theta))).round().astype(int)
    shown = np.union1d(shown, [found.chosen])
    some = f", {len(shown)} of {len(choice.theta)} tried" * (len(shown) < len(choice.theta))
    between = "95% interval"
    columns = ("threshold", f"error ({unit_of(found)})", between, "taps", between, "cost (taps)", between, "")
    rows = []
    for h in shown.tolist():
        mark = "chosen" if h == found.chosen else "not worse" if choice.alike[h] and found.reachable is None else ""
        numbers = (*_estimate(choice.error, h), *_estimate(choice.taps, h), *_estimate(choice.cost, h))
        rows.append([shown_threshold(float(choice.theta[h])), *numbers, mark])
    return Table(columns, rows, f"Thresholds{some}")


def _estimate(estimate: Estimate, index: int) -> tuple[str, str]:
    mean, low, high = rounded(estimate.mean[index], estimate.low[index], estimate.high[index])
    return mean, f"{low} to {high}"
