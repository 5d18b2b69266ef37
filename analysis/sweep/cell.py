"""Work of one cell of a sweep, from its data set to means over trials."""

import hashlib
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...inference.information import TapOutcomes
from ...inference.moves.control import MovePolicy, check_fixation
from ...inference.moves.information import training_outcomes
from ...inference.moves.strategies import make_policy, parse_strategy
from ...inference.moves.table import held_out_tables, learn_table
from ...inference.trials.lockstep_tally import tally_policy
from ...inference.trials.records import TapTable, tap_table
from ...inference.trials.tally import Tally, tally_trials
from ...models.seeds import Purpose, derived_seed
from ...models.settings import PlaySettings
from ..stats.resampled_units import resampled_table
from ..stats.tallied import tally_means
from .cells import Cell, Effort
from .data import DataSet
from .models import FitAxes, fit_cell

if TYPE_CHECKING:
    from ...models.measurement.model import TapModel

_TABLES = 4


def run_cell(cell: Cell, data: DataSet, effort: Effort) -> dict[str, NDArray[np.float64]]:
    """Fits the cell's model, plays its trials and takes means over them.

    Returns:
        Those of `tally_means` and `trials`, shape (H,) each.

    Raises:
        InputError: The settings do not go with the data.
    """
    counts = _counts(cell, effort, data)
    means = tally_means(counts, data.grid)
    return {**means, "trials": np.full_like(means["taps"], counts.trials)}


def _counts(cell: Cell, effort: Effort, data: DataSet) -> Tally:
    """Trials of a cell, compiled where their strategy is."""
    table = resampled_table(_table(data, cell.fit_settings), cell.resample, _seed_of(cell.data, 0))
    trials = effort.thresholds, effort.trials
    seed = _trial_seed(cell)
    theta_x = cell.theta_x
    if theta_x is None:
        return tally_policy(
            table, *trials, _policy(cell, data), border=cell.border, deadline=effort.deadline, seed=seed
        )
    point = check_fixation(cell.fixation, data.grid.L)
    play = PlaySettings(theta_x=theta_x, border=cell.border, deadline=effort.deadline)
    return tally_trials(table, *trials, play=play, fixation=point, workers=1, seed=seed)


def _policy(cell: Cell, data: DataSet) -> MovePolicy:
    """The strategy of a cell; what it learns from are the training taps."""
    strategy = parse_strategy(cell.strategy)
    outcomes = _outcomes(data, cell.fit_settings) if strategy.needs_outcomes else None
    targets = None
    if strategy.kind == "table":
        fitted = partial(fit_cell, settings=cell.fit_settings)
        tables = held_out_tables(data.fold.train, data.grid, fitted)
        targets = learn_table(tables, data.grid, border=cell.border, seed=_seed_of(cell.data, cell.seed))
    return make_policy(cell.strategy, data.grid, border=cell.border, outcomes=outcomes, table=targets)


@lru_cache(maxsize=_TABLES)
def _model(data: DataSet, settings: FitAxes) -> "TapModel":
    """The fitted model that cells with the same data and fit share."""
    return fit_cell(data.fold.train, data.grid, settings)


@lru_cache(maxsize=_TABLES)
def _table(data: DataSet, settings: FitAxes) -> TapTable:
    """The likelihoods that cells with the same data and fit share."""
    model = _model(data, settings)
    return tap_table(model, model.usable(data.fold.test))


@lru_cache(maxsize=_TABLES)
def _outcomes(data: DataSet, settings: FitAxes) -> TapOutcomes:
    """The training taps that such cells look ahead to."""
    return training_outcomes(_model(data, settings), data.fold.train)


def _trial_seed(cell: Cell) -> int:
    """Of the cell's trials: data sets and resamples must not share random numbers, all other cells of one seed do."""
    return _seed_of(cell.data, cell.seed, *([cell.resample] if cell.resample else []))


def _seed_of(data: str, seed: int, *further: int) -> int:
    name = hashlib.sha256(data.encode()).digest()
    return derived_seed(seed, Purpose.CELL, *(int.from_bytes(name[i : i + 4], "little") for i in (0, 4)), *further)
