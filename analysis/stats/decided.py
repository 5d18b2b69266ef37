"""Decisions of trials: what they are about, how they ended, and how many are independent of each other.

With a single object decisions are about the position, and positions stand where objects stand otherwise.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...inference.trials.records import TapTable, TrialPlan, Trials
from ...inference.trials.run import run_trials
from ...models.errors import InputError
from ...models.grid import ClassGrid, TapPool, policies
from ...models.settings import PlaySettings


class Subject(NamedTuple):
    """Subject of decisions: object or position.

    Attributes:
        kind: `"object"`, or `"place"` where there is one object only.
        names: What can be decided for, M of them.
        table: Test taps, whose what classes these are.
        policies: Passive, and active where the finger can move.
    """

    kind: str
    names: tuple[str, ...]
    table: TapTable
    policies: tuple[str, ...]


class DecidedTrials(NamedTuple):
    """How n trials ended at one threshold or after one number of taps; all of shape (n,).

    Attributes:
        true: What class that was there.
        decided: What class that was decided for.
        belief: In the latter.
        stopped: Whether the threshold was crossed; where there is none, always.
        taps: How many it took.
    """

    true: NDArray[np.intp]
    decided: NDArray[np.intp]
    belief: NDArray[np.float64]
    stopped: NDArray[np.bool_]
    taps: NDArray[np.int64]


def decided_about(table: TapTable, grid: ClassGrid) -> Subject:
    """What the decisions of trials are about, and the table to play them on.

    Raises:
        InputError: The table holds other classes, or there is one object at one place.
    """
    if table.pool.shape != grid.shape:
        raise InputError(f"The classes of the table do not match the grid of {grid.L} x {grid.M}.")
    if grid.shape == (1, 1):
        raise InputError("With one object at one position there is nothing to decide.")
    if grid.M > 1:
        return Subject("object", grid.what_name, table, policies(grid))
    order, first, count, _ = table.pool
    places = tuple(grid.where_label(l) for l in range(grid.L))
    first, count = (values.swapaxes(1, 2).copy() for values in (first, count))
    pool = TapPool(order, first, count, np.where(count > 0, 0, -1))
    turned = table._replace(
        log_likelihood=_turned(table.log_likelihood),
        pool=pool,
        log_prior=_turned(table.log_prior[np.newaxis])[0],
        given_trained=None,
    )
    return Subject("place", places, turned, ("passive",))


def decided_trials(
    table: TapTable, plan: TrialPlan, thresholds: ArrayLike, play: PlaySettings, seed: int, *, fresh: bool = False
) -> list[DecidedTrials]:
    """Plays trials and gives how they end at each threshold."""
    return decisions_of(run_trials(table, plan, thresholds, play=play, seed=seed, fresh=fresh), plan)


def decisions_of(trials: Trials, plan: TrialPlan) -> list[DecidedTrials]:
    """How trials end at each threshold."""
    columns = trials.what.T, trials.belief.T, trials.stopped.T, trials.taps.T
    return [DecidedTrials(plan.what, *column) for column in zip(*columns, strict=True)]


def independent_decisions(pool: TapPool, m: int | None, trials: int, taps: float) -> float:
    """How many decisions the test taps make if none is used twice, at most the number of trials and at least 1.

    Args:
        pool: The test taps.
        m: Of which object; `None` for all.
        trials: That were played.
        taps: Mean number of taps of a decision.
    """
    count = pool.count.sum() if m is None else pool.count[..., m].sum()
    return float(max(1.0, min(trials, count / max(taps, 1.0))))


def _turned(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values over (N, L, S) of one object in S states as those of L objects at one place, (N, 1, S L)."""
    return np.ascontiguousarray(values.swapaxes(1, 2)).reshape(len(values), 1, -1)
