"""Learning where to go from each estimate of the place, from training taps alone.

Part of the training taps is left out of the model in turn. Trials are played on what was left out, and for each
estimate of the place and each target it is counted how the decision fares after the move.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.model import TapModel
from ...models.measurement.states import log_fold
from ...models.seeds import Purpose, derived_seed
from ...models.taps import TapSet
from ..engines.compiled import border_number, refuse_border
from ..reference import Border
from ..saturation import share, temper
from ..trials import kernel
from ..trials import random as draws
from ..trials.lockstep import drawn_taps, shifted, updated
from ..trials.plan import plan_trials
from ..trials.records import TapTable
from ..tuning.held_out import held_out
from .control import best_move, where_beliefs
from .table import Loss, TargetTable

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]

BEFORE = 3
"""Taps before the move, of which each number of them from 1 on is learned from."""
TRIALS = 2000
_LOSSES = ("error", "log")
_LEAST = 1e-6  # belief in the right object, so that one surprise is no infinite loss
_PRIOR = 4.0  # trials that the mean over all estimates counts as, where an estimate is rare


def held_out_tables(taps: TapSet, grid: ClassGrid, fit: Callable[[TapSet, ClassGrid], TapModel]) -> list[TapTable]:
    """Training taps under models that they did not train: sessions left out in turn, or each half of a single one.

    Args:
        taps: Training taps.
        grid: The classes.
        fit: Fits a model to some of them.

    Raises:
        InputError: As `held_out`.
    """
    return [part.table for part in held_out(taps, grid, fit).parts]


def learn_table(
    tables: Sequence[TapTable],
    grid: ClassGrid,
    *,
    border: Border = "uniform",
    loss: Loss = "log",
    taps: int = 1,
    trials: int = TRIALS,
    seed: int = 0,
) -> TargetTable:
    """The best target for each estimate of the place.

    Each trial starts anywhere and taps there up to `BEFORE` times; after each of these taps every target is tried.
    A target's mean loss is drawn towards that over all estimates, which decides where an estimate hardly ever occurs.
    A tap that is impossible under every class still believed in leaves the belief as it was.

    Args:
        tables: Taps under models that they did not train, see `held_out_tables`.
        grid: The classes.
        border: Reading of Eq. 9.
        loss: `"error"` counts wrong objects, `"log"` takes -log of the belief in the right one, in nats.
        taps: Taps after the move.
        trials: Trials of each table; their targets share all random numbers.
        seed: Of starts and draws.

    Raises:
        InputError: An argument is out of range.
    """
    if loss not in _LOSSES:
        raise InputError(f"The loss must be one of {', '.join(_LOSSES)}, got {loss!r}.")
    if taps < 1 or not len(tables):
        raise InputError(f"A table is learned from taps after the move, got {taps} of them and {len(tables)} sets.")
    L = grid.L
    total = np.zeros((3, L, L))
    for number, table in enumerate(tables):
        refuse_border(border_number(border), table.log_prior.shape[1], grid.M)
        own = derived_seed(seed, Purpose.TARGETS, number)
        for here, target, value in _tried(table, border, loss, taps, trials, own):
            for power in range(3):
                np.add.at(total[power, :, target], here, value**power)
    count, first, second = total
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = first / count
        spread = np.maximum(second / count - mean**2, 0.0) / (count - 1)
    overall = first.sum(axis=0) / count.sum(axis=0)
    steadied = (first + _PRIOR * overall) / (count + _PRIOR)
    deltas = np.arange(L) - np.arange(L)[:, np.newaxis]
    return TargetTable(
        target=np.arange(L) + best_move(-steadied, deltas),
        loss=mean,
        error=np.where(count > 1, np.sqrt(spread), np.nan),
        trials=count.astype(np.int64),
        where_value=grid.where_value,
        kind=loss,
        taps=taps,
    )


def _tried(
    table: TapTable, border: Border, loss: Loss, taps: int, trials: int, seed: int
) -> Iterator[tuple[Integers, int, Floats]]:
    """Every target after 1 to `BEFORE` taps at one place: estimates (n,), the target and losses (n,)."""
    L, M = table.pool.nearest.shape
    plan = plan_trials(table.pool, trials, seed)
    words = draws.words(seed, plan.stream, kernel.TAPS, 0, BEFORE + taps)
    carried = np.broadcast_to(table.log_prior, (trials, *table.log_prior.shape))
    for before in range(BEFORE):
        tap = drawn_taps(table, plan.where, plan.what, words[:, before])
        carried, _ = updated(carried, table.log_likelihood[tap])
        belief = np.exp(log_fold(temper(carried, share(before + 1, table.saturation)), M))
        here = where_beliefs(belief).argmax(axis=-1)
        for target in range(L):
            delta = target - here
            at = table.pool.nearest[np.clip(plan.where + delta, 0, L - 1), plan.what]
            log_belief = shifted(carried, delta, border, M, table.trained)
            for more in range(taps):
                tap = drawn_taps(table, at, plan.what, words[:, BEFORE + more])
                log_belief, _ = updated(log_belief, table.log_likelihood[tap])
            read = log_fold(temper(log_belief, share(before + 1 + taps, table.saturation)), M)
            yield here, target, _losses(np.exp(read).sum(axis=1), plan.what, loss)


def _losses(what: Floats, held: Integers, loss: Loss) -> Floats:
    if loss == "error":
        return (what.argmax(axis=1) != held).astype(np.float64)
    return -np.log(np.maximum(what[np.arange(len(held)), held], _LEAST))
