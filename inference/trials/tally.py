"""Counts of any number of trials in constant memory, with interim results.

Counts of pieces add up, so it does not matter how the trials were cut and who played them.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.compiled import compiled
from ...models.errors import InputError
from ...models.settings import PlaySettings
from ...models.threads import cores, in_order
from .records import Rule, TapTable, TrialPlan, Trials, plan_trials
from .run import Player, empty_trials, make_player, make_rule


class Tally(NamedTuple):
    """Counts of decided trials at H thresholds, in the given order.

    Attributes:
        what: How often each object (axis 1) was taken for each (axis 2), shape (H, M, M).
        where: How often the sensor stood in each class (axis 1) and believed to be in each (axis 2), shape (H, L, L).
        taps: How many trials took each number of taps, from 0 to the longest, shape (H, longest + 1).
        stopped: How many crossed the threshold before the deadline, shape (H,).
        clamped: How many had a move cut short by the end of the range, shape (H,).
        substituted: How many had a class without a tap replaced, shape (H,).
        belief: Sum of the beliefs in what was decided, shape (H,).
        no_class_left: How many ended as no class was left, see `Trials`, shape (H,).
    """

    what: NDArray[np.int64]
    where: NDArray[np.int64]
    taps: NDArray[np.int64]
    stopped: NDArray[np.int64]
    clamped: NDArray[np.int64]
    substituted: NDArray[np.int64]
    belief: NDArray[np.float64]
    no_class_left: NDArray[np.int64]

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.taps[0].sum())

    @classmethod
    def empty(cls, H: int, L: int, M: int, longest: int = 0) -> Self:
        """Tally without trials."""

        def counts(*shape: int) -> NDArray[np.int64]:
            return np.zeros((H, *shape), dtype=np.int64)

        return cls(
            what=counts(M, M),
            where=counts(L, L),
            taps=counts(longest + 1),
            stopped=counts(),
            clamped=counts(),
            substituted=counts(),
            belief=np.zeros(H),
            no_class_left=counts(),
        )

    def plus(self, other: Self) -> Self:
        """Sum of two tallies."""
        if self.taps.shape[1] < other.taps.shape[1]:
            return other.plus(self)
        other = other._replace(taps=_padded(other.taps, self.taps.shape[1]))
        return self._replace(**{name: value + getattr(other, name) for name, value in self._asdict().items()})


def tally_trials(
    table: TapTable,
    thresholds: ArrayLike,
    trials: int,
    *,
    play: PlaySettings = PlaySettings(),
    fixation: int = 0,
    where: int | None = None,
    first_stream: int = 0,
    seed: int = 0,
    device: str = "cpu",
    workers: int | None = None,
    progress: Callable[[Tally], None] | None = None,
) -> Tally:
    """Counts of trials from random starts, in constant memory.

    They are those of `plan_trials` and `run_trials` with the same arguments.

    Args:
        table: Test taps.
        thresholds: theta_W, shape (H,), any order; 1 or more never stops.
        trials: How many to play.
        play: As in `run_trials`.
        fixation: Class that the sensor aims for.
        where: Start in this where class only; `None` for any.
        first_stream: Random stream of the first trial; the others follow.
        seed: Random seed of the starts and the draws of taps.
        device: As in `run_trials`.
        workers: As in `run_trials`.
        progress: Called with the counts so far, several times.

    Raises:
        InputError: An argument is out of range, or there is no such device.
    """
    if trials < 1:
        raise InputError(f"trials must be at least 1, got {trials}.")
    rule = make_rule(thresholds, play, seed)
    player = make_player(table, rule, device)
    piece = partial(_piece, table, player, rule, seed, fixation, where)
    end = first_stream + trials
    tasks = (
        partial(piece, stream, min(player.at_once, end - stream)) for stream in range(first_stream, end, player.at_once)
    )
    L, M = table.pool.shape
    total = Tally.empty(len(rule.thresholds), L, M)
    for part in in_order(tasks, cores(workers) if device == "cpu" else 1):
        total = total.plus(part)
        if progress is not None:
            progress(total)
    return total


def _piece(
    table: TapTable, play: Player, rule: Rule, seed: int, fixation: int, where: int | None, stream: int, n: int
) -> Tally:
    plan = plan_trials(table.pool, n, seed, fixation, where, stream)
    trials = empty_trials(n, len(rule.thresholds))
    play(plan, 0, n, trials)
    L, M = table.pool.shape
    return tally(trials, plan, (L, M))


def tally(trials: Trials, plan: TrialPlan, shape: tuple[int, int]) -> Tally:
    """Counts of decided trials.

    Args:
        trials: n trials at H thresholds.
        plan: The same trials as planned.
        shape: (L, M).
    """
    L, M = shape
    counts = Tally.empty(trials.taps.shape[1], L, M, int(trials.taps.max(initial=0)))
    _count(trials, plan.what, counts)
    return counts


@compiled
def _count(trials: Trials, held: NDArray[np.intp], counts: Tally) -> None:
    n, H = trials.taps.shape
    for i in range(n):
        for h in range(H):
            counts.what[h, held[i], trials.what[i, h]] += 1
            counts.where[h, trials.true_where[i, h], trials.where[i, h]] += 1
            counts.taps[h, trials.taps[i, h]] += 1
            counts.stopped[h] += trials.stopped[i, h]
            counts.clamped[h] += trials.clamped[i, h] > 0
            counts.substituted[h] += trials.substituted[i, h] > 0
            counts.belief[h] += trials.belief[i, h]
            counts.no_class_left[h] += trials.no_class_left[i, h]


def _padded(taps: NDArray[np.int64], columns: int) -> NDArray[np.int64]:
    return np.pad(taps, ((0, 0), (0, columns - taps.shape[1])))
