"""The folder of a comparison: figures, `compare.nc`, `summary.json` and the page."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ...models.storage import complete_folder
from ..page.page import Picture, write_page
from . import figures, figures_taps
from .run import Comparison


def write_comparison(folder: Path, comparison: Comparison, summary: Mapping[str, Any], force: bool = False) -> None:
    """Writes everything, whole or not at all.

    Args:
        folder: Where to.
        comparison: What came out.
        summary: See `summary.summarise`.
        force: Whether files in an existing folder may be replaced.

    Raises:
        InputError: The folder cannot be written.
    """
    with complete_folder(folder, force) as temporary:
        comparison_tree(comparison, summary).to_netcdf(temporary / "compare.nc", engine="h5netcdf")
        write_page(temporary, "compare.html", summary, _pictures(comparison), "summary.json")


def comparison_tree(comparison: Comparison, summary: Mapping[str, Any]) -> xr.DataTree:
    """All numbers with their names, dims and units."""
    groups: dict[str, xr.Dataset | None] = {
        "/": xr.Dataset(attrs={"title": summary["title"], "command": summary["command"], "seed": summary["seed"]}),
        "taps_left_out": comparison.left_out_taps,
        "sessions_left_out": comparison.left_out_sessions,
        "checks": comparison.checks,
        "classes": comparison.classes,
        "decisions": comparison.curves,
        "equal_taps": comparison.equal,
    }
    if comparison.stacking is not None:
        numbers = comparison.stacking.select_dtypes("number")
        groups["stacking"] = xr.Dataset(
            {name: ("model", numbers[name].to_numpy(dtype=np.float64)) for name in numbers.columns},
            {"model": np.array(comparison.stacking.index, dtype=np.str_)},
        )
    return xr.DataTree.from_dict({name: group for name, group in groups.items() if group is not None})


def _pictures(comparison: Comparison) -> Iterator[Picture]:
    if comparison.left_out_sessions is not None:
        yield Picture(
            "sessions",
            "Sessions left out",
            "Mean log probability of a tap’s bins less that of the reference model, with 95 % intervals.",
            figures_taps.sessions_left_out(comparison.left_out_sessions),
        )
    if comparison.left_out_taps is not None:
        yield Picture(
            "pareto",
            "Where importance sampling can leave out a tap",
            "Pareto k of the training taps; beyond the dashed line the estimate of a tap is not to be trusted.",
            figures_taps.pareto(comparison.left_out_taps),
        )
    if comparison.checks is not None and comparison.checks.sizes["statistic"]:
        yield Picture(
            "checks",
            "Predictive checks",
            "Statistics of the training taps (lines) and of replicates drawn from each fitted model (ticks).",
            figures_taps.predictive_checks(comparison.checks),
        )
    grid = comparison.grid
    for name, title, caption, draw in _levels(comparison):
        yield Picture(name, title, caption, draw(grid))


def _levels(comparison: Comparison) -> list[tuple[str, str, str, Callable[[Any], Any]]]:
    return [
        (
            "classes",
            "Beliefs after a number of taps",
            "Scores of beliefs against the number of taps of one class, with 95 % intervals.",
            lambda grid: figures.class_scores(comparison.classes, grid),
        ),
        (
            "class_differences",
            "Beliefs, differences",
            "The same, less the score of the reference model on the same sequences.",
            lambda grid: figures.class_differences(comparison.classes, grid),
        ),
        (
            "decisions",
            "Errors against reaction time",
            "Mean errors against mean reaction times, one point per threshold; bands are 95 % intervals.",
            lambda grid: figures.decision_curves(comparison.curves, grid),
        ),
        (
            "decision_differences",
            "Errors at equal reaction times, differences",
            "Error less that of the reference model at the same mean reaction time, in the same trials.",
            lambda grid: figures.decision_differences(comparison.equal, grid),
        ),
        (
            "miscalibration",
            "Are decisions as right as they believe?",
            "Fraction of wrong objects over the mean of 1 - belief against the threshold; 1 where beliefs are right.",
            lambda _: figures.miscalibration(comparison.curves),
        ),
    ]
