"""Figures of a comparison from `compare.nc`, as the run drew them."""

import json
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import xarray as xr

from ...models.grid import ClassGrid
from . import figures, figures_decisions, figures_taps


def stored_figures(groups: Mapping[str, xr.Dataset]) -> dict[str, Callable[[], Any]]:
    """Functions that draw the figures, by name.

    Args:
        groups: Of the file, by path; that of the root is "/".
    """
    grid = ClassGrid.from_dict(json.loads(groups["/"].attrs["grid"]))
    found: dict[str, Callable[[], Any]] = {}
    for name, group in groups.items():
        if name.endswith("s_left_out") and name != "taps_left_out":
            found[name.removesuffix("_left_out")] = partial(figures_taps.groups_left_out, group)
    if "taps_left_out" in groups:
        found["pareto"] = partial(figures_taps.pareto, groups["taps_left_out"])
    if "checks" in groups:
        found["checks"] = partial(figures_taps.predictive_checks, groups["checks"])
    return {
        **found,
        "classes": partial(figures.class_scores, groups["classes"], grid),
        "class_differences": partial(figures.class_differences, groups["classes"], grid),
        "decisions": partial(figures_decisions.decision_curves, groups["decisions"], grid),
        "decision_differences": partial(figures.decision_differences, groups["equal_taps"], grid),
        "miscalibration": partial(figures_decisions.miscalibration, groups["decisions"]),
    }
