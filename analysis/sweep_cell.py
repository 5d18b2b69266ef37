"""The work of a sweep: one cell from its data set to means over trials."""

import hashlib
import time
import traceback
from collections.abc import Callable, Generator, Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..inference.control import check_fixation
from ..inference.tally import tally_trials
from ..inference.trial_plan import TapTable, tap_table
from .sweep_cells import Cell, Effort
from .sweep_data import DataSet
from .sweep_models import FitSettings, fit_cell
from .tallied import tally_means

_TABLES = 4


class Outcome(NamedTuple):
    """What became of a cell.

    Attributes:
        number: The cell.
        values: Results by name, shapes (H,); nothing where it failed.
        seconds: How long it took.
        traceback: Why it failed.
    """

    number: int
    values: dict[str, NDArray[np.float64]]
    seconds: float
    traceback: str = ""


type Load = Callable[[str], DataSet]
"""Gives a data set by name."""

type Runner = Callable[[Iterator[Cell], Effort, Load], Generator[Outcome]]
"""Runs cells, neighbours of which share data sets and fits, in any order and places, and yields outcomes as they come;
closing it stops everything."""


def try_cell(cell: Cell, effort: Effort, data: DataSet) -> Outcome:
    """The outcome of a cell, whatever it raises."""
    began = time.perf_counter()
    try:
        values, failure = run_cell(cell, effort, data), ""
    except Exception:  # a cell that fails must not end the others
        values, failure = {}, traceback.format_exc()
    return Outcome(cell.number, values, time.perf_counter() - began, failure)


def run_cell(cell: Cell, effort: Effort, data: DataSet) -> dict[str, NDArray[np.float64]]:
    """Fits the cell's model, plays its trials and takes means over them.

    Args:
        cell: Which one.
        effort: Trials, thresholds and deadline.
        data: The cell's data set.

    Returns:
        Those of `tally_means` and `trials`, shape (H,) each.

    Raises:
        InputError: The settings do not go with the data.
        ZeroEvidenceError: A test tap is impossible under every class.
    """
    table = _table(data, cell.fit_settings)
    counts = tally_trials(
        table,
        effort.thresholds,
        effort.trials,
        theta_x=cell.theta_x,
        fixation=check_fixation(cell.fixation, data.grid.L),
        border=cell.border,
        deadline=effort.deadline,
        seed=_trial_seed(cell),
        workers=1,
    )
    means = tally_means(counts, data.grid)
    return {**means, "trials": np.full_like(means["taps"], counts.trials)}


@lru_cache(maxsize=_TABLES)
def _table(data: DataSet, settings: FitSettings) -> TapTable:
    """The likelihoods that cells with the same data and fit share."""
    model = fit_cell(data.fold.train, data.grid, settings)
    return tap_table(model, model.usable(data.fold.test))


def _trial_seed(cell: Cell) -> int:
    """Of the cell's trials: data sets must not share random numbers, all other cells of one seed do."""
    digest = hashlib.sha256(f"{cell.seed} {cell.data}".encode()).digest()
    return int.from_bytes(digest[:7], "little")
