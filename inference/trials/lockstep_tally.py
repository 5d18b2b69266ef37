"""Counts of trials in lockstep, in constant memory."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ...models.errors import InputError
from ..episode import DEADLINE
from ..moves.control import MovePolicy
from ..reference import Border
from ..stopping.recorded import stops
from ..stopping.stopping import DECIDE, what_above
from .lockstep import Record, play
from .records import TapTable, Trials, plan_trials
from .tally import Tally, tally

_AT_ONCE = 500  # trials


def trials_of(record: Record, thresholds: ArrayLike) -> Trials:
    """Recorded trials in the form of `trials.run.run_trials`, decided at every threshold theta_W, shape (H,)."""
    columns = []
    rows = np.arange(len(record.length))
    for threshold in np.atleast_1d(np.asarray(thresholds, dtype=np.float64)):
        taps, answer = stops(what_above(threshold), record)
        at = rows, taps - 1
        parts = (record.what, record.where, record.at)
        counts = (record.clamped, record.substituted, record.what_belief)
        never, none_left = np.zeros(len(taps), np.bool_), record.no_class_left & (answer != DECIDE)
        shown = (part[at] for part in parts)
        columns.append((taps, *shown, answer == DECIDE, *(part[at] for part in counts), never, none_left))
    return Trials(*(np.stack(column, axis=1) for column in zip(*columns, strict=True)))


def tally_policy(
    table: TapTable,
    thresholds: ArrayLike,
    trials: int,
    policy: MovePolicy,
    *,
    where: int | None = None,
    first_stream: int = 0,
    border: Border = "uniform",
    deadline: int = DEADLINE,
    seed: int = 0,
    progress: Callable[[Tally], None] | None = None,
) -> Tally:
    """`tally.tally_trials` for any control strategy.

    Args:
        table: Test taps.
        thresholds: theta_W, shape (H,), any order; 1 or more never stops.
        trials: How many to play.
        policy: Control strategy.
        where: Start in this where class only; `None` for any.
        first_stream: Random stream of the first trial; the others follow.
        border: Reading of Eq. 9.
        deadline: Taps after which the most probable classes are taken.
        seed: Random seed of the starts, the draws of taps and the numbers that strategies at random get.
        progress: Called with the counts so far, several times.

    Raises:
        InputError: An argument is out of range.
    """
    thresholds = np.atleast_1d(np.asarray(thresholds, dtype=np.float64))
    if trials < 1 or not len(thresholds) or np.isnan(thresholds).any():
        raise InputError(f"trials must be at least 1 and thresholds not NaN, got {trials} and {thresholds}.")
    L, M = table.pool.shape
    total = Tally.empty(len(thresholds), L, M)
    end = first_stream + trials
    for stream in range(first_stream, end, _AT_ONCE):
        plan = plan_trials(table.pool, min(_AT_ONCE, end - stream), seed, 0, where, stream)
        record = play(table, plan, policy, border=border, deadline=deadline, enough=float(thresholds.max()), seed=seed)
        total = total.plus(tally(trials_of(record, thresholds), plan, (L, M)))
        if progress is not None:
            progress(total)
    return total
