"""Means of counted trials at each threshold: errors, reaction times and fractions."""

import numpy as np
from numpy.typing import NDArray

from ...inference.trials.tally import Tally
from ...models.grid import ClassGrid

QUANTITIES = {
    "what_error": "mean object error, in what_unit",
    "what_error_se": "Monte Carlo standard error over trials on the same taps",
    "where_error": "mean position error at the decision, in where_unit",
    "where_error_se": "Monte Carlo standard error over trials on the same taps",
    "taps": "mean reaction time in taps",
    "taps_se": "Monte Carlo standard error over trials on the same taps",
    "what_wrong": "fraction of trials that decide for a wrong object",
    "stopped_fraction": "fraction of trials that cross the threshold before the deadline",
    "clamped_fraction": "fraction of trials in which the end of the range shortened a move before the decision",
    "substituted_fraction": "fraction of trials in which a class without a test tap was replaced before the decision",
    "no_class_left_fraction": "fraction of trials that met a tap impossible under every remaining class",
    "belief": "mean belief in the decided object",
}
"""Names and what they mean, in the order in which they are stored."""


def tally_means(tally: Tally, grid: ClassGrid) -> dict[str, NDArray[np.float64]]:
    """Means over trials by name, each of shape (H,).

    Returns:
        Errors and taps with their standard errors over trials as `<name>_se` (NaN for a single trial), and
        `what_wrong`, `stopped_fraction`, `clamped_fraction`, `substituted_fraction`, `no_class_left_fraction` and
        `belief`.
    """
    n = tally.trials
    what, where = np.arange(grid.M), np.arange(grid.L)
    values = {
        "what_error": (tally.what, grid.what_error(what, what[:, np.newaxis])),
        "where_error": (tally.where, grid.where_error(where, where[:, np.newaxis])),
        "taps": (tally.taps, np.arange(tally.taps.shape[1], dtype=np.float64)),
    }
    means: dict[str, NDArray[np.float64]] = {}
    for name, (counts, value) in values.items():
        flat = counts.reshape(len(counts), -1)
        mean = flat @ value.ravel() / n
        variance = np.maximum(flat @ value.ravel() ** 2 / n - mean**2, 0.0)
        means[name] = mean
        means[f"{name}_se"] = np.sqrt(variance / (n - 1)) if n > 1 else np.full_like(mean, np.nan)
    means["what_wrong"] = 1 - np.trace(tally.what, axis1=1, axis2=2) / n
    for name in ("stopped", "clamped", "substituted", "no_class_left"):
        means[f"{name}_fraction"] = getattr(tally, name) / n
    means["belief"] = tally.belief / n
    return means
