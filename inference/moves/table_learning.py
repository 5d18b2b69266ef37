"""Learning the best target for each estimated position, from training taps only.

Parts of the training taps are held out of the model in turn. Trials are played on the held-out taps, and for each
estimated position and target the loss of the decision after the move is averaged.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.model import TapModel
from ...models.seeds import Purpose, derived_seed
from ...models.taps import TapSet
from ..belief import log_fold, share, temper
from ..engines.compiled import border_number, refuse_border
from ..reference import Border
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
"""Maximum number of taps before the move; every number from 1 on is learned from."""
TRIALS = 2000
_LOSSES = ("error", "log")
_LEAST = 1e-6  # lowest belief in the true object, to keep the loss finite
_PRIOR = 4.0  # weight, in trials, of the mean over all estimates


def held_out_tables(taps: TapSet, grid: ClassGrid, fit: Callable[[TapSet, ClassGrid], TapModel]) -> list[TapTable]:
    """Training taps under models that they did not train: each session held out, or each half of a single session.

    Args:
        taps: Training taps.
        grid: Class grid.
        fit: Fits a model to some of the taps.

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
    """Table of the best target for each estimated position.

    Each trial starts at a random position and taps there up to `BEFORE` times; after each tap every target is tried.
    The mean loss of a target is shrunk towards that over all estimates, which decides for rare estimates. A tap that is
    impossible under every class with nonzero belief leaves the belief unchanged.

    Args:
        tables: Taps under models that they did not train, see `held_out_tables`.
        grid: Class grid.
        border: Interpretation of Eq. 9 at the ends of the range.
        loss: `"error"` counts wrong objects, `"log"` takes -log of the belief in the true object, in nats.
        taps: Number of taps after the move.
        trials: Number of trials per table; their targets share all random numbers.
        seed: Random seed.

    Raises:
        InputError: An argument is out of range.
    """
    if loss not in _LOSSES:
        raise InputError(f"loss must be one of {', '.join(_LOSSES)}, got {loss!r}.")
    if taps < 1 or not len(tables):
        raise InputError(f"Learning needs at least 1 tap after the move and 1 table, got {taps} and {len(tables)}.")
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
    """Every target after 1 to `BEFORE` taps at one position: estimates (n,), target and losses (n,)."""
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
