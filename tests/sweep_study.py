"""A study for sweeps of tests, and what its sweep left."""

from pathlib import Path

import xarray as xr
from solidtouch.analysis.sweep.cells import CellGrid, Effort
from solidtouch.analysis.sweep.data import Sources
from solidtouch.analysis.sweep.result import open_sweep
from solidtouch.analysis.sweep.study import load_study

GRID = """
pseudocount = [0.01, 1]
policy = ["passive", "active", 0.5]
fixation = [0, 2]
border = ["uniform", "clamp"]
"""
DISTINCT = 2 * (1 + 2 * 2 * 2)


def results(path: Path) -> xr.Dataset:
    """Everything but how long it took."""
    return open_sweep(path).load().drop_vars("seconds").drop_attrs()


def first_cell(path: Path):
    """The first cell of a study, its effort and its data."""
    study = load_study(path)
    sources = Sources(study, path.parent)
    cell = CellGrid.of(study, tuple(sources.keys)).cell(0)
    return cell, Effort(study.trials, study.thresholds, study.deadline), sources.load(cell.data)
