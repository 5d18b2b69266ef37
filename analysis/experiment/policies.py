"""Passive and active trials from the same starts with the same random numbers, on test taps and resamples of them."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...inference.trials.records import (
    Farthest,
    TapTable,
    TrialPlan,
    Trials,
    checked_plan,
    endings,
    join_plans,
    plan_trials,
)
from ...inference.trials.resampling import RESAMPLE_TRIALS, Spread, spread
from ...inference.trials.run import LoopPlayer, make_rule, play_plan
from ...inference.trials.selections import resampled_pools, thinned_pools
from ...models.grid import ClassGrid, TapPool
from ...models.threads import cores, in_order
from ..stats.metrics import Means, OutcomeSums, confusion, join_sums, outcomes_dataset, sum_outcomes
from .settings import ExperimentSettings

type Play = Callable[[TrialPlan, bool, bool], Trials]
"""Plays a plan; the arguments behind it are whether the sensor moves and whether no tap is drawn twice."""

_AT_ONCE = 1 << 14  # trials of a policy in memory


class Outcomes[T](NamedTuple):
    """Outcomes of trials, by position and threshold.

    Attributes:
        passive: By sensing position.
        active: By the position of the start, at the default fixation point; `None` where nothing can be acted on.
        difference: Passive minus active, trial by trial, by the position of the start; likewise.
        fixations: By fixation point, averaged over the same fewer starts; likewise, and for trials on fresh taps.
    """

    passive: T
    active: T | None = None
    difference: T | None = None
    fixations: T | None = None


def combined[T, R](outcomes: Sequence[Outcomes[T]], join: Callable[[list[T]], R]) -> Outcomes[R]:
    """Several outcomes of the same policies as one, each part made of the same parts by `join`."""

    def part(name: str) -> R | None:
        parts = [getattr(one, name) for one in outcomes]
        return None if parts[0] is None else join(parts)

    return Outcomes(join([one.passive for one in outcomes]), part("active"), part("difference"), part("fixations"))


type Sums = Outcomes[OutcomeSums]


class PlayedPolicies(NamedTuple):
    """Trials on one data set.

    Attributes:
        stored: With taps drawn with replacement up to the deadline, as in the paper, at all thresholds.
        fresh: With no tap drawn twice, at the shown threshold and those below.
        passive_confusion: Shape (M, M) at the shown threshold, of `stored`.
        active_confusion: The same at the default fixation point; `None` where nothing can be acted on.
        used_up: Share of the fresh decisions of each policy, at each of their thresholds, made because all stored taps
            of a class were drawn, shape (policy, H).
        selected: That share where a quarter of the taps is left out, for intervals.
        spread: How resamples of stored taps turn into intervals.
        fresh_spread: How those of fresh taps do.
    """

    stored: Outcomes[xr.Dataset]
    fresh: Outcomes[xr.Dataset]
    passive_confusion: NDArray[np.int64]
    active_confusion: NDArray[np.int64] | None
    used_up: NDArray[np.float64]
    selected: NDArray[np.float64]
    spread: Spread
    fresh_spread: Spread


class ResampledPools(NamedTuple):
    """Selections of the test taps, see `inference.trials.resampling`.

    Attributes:
        stored: For trials that draw with replacement.
        fresh: For those that draw no tap twice.
    """

    stored: Sequence[TapPool] = ()
    fresh: Sequence[TapPool] = ()


NO_POOLS = ResampledPools()


class Plans(NamedTuple):
    """Which trials are played.

    Attributes:
        starts: The same number at every position with a test tap, aiming for the default fixation point. Passive
            trials are the same ones without moves.
        others: At every other fixation point the first few of each position, in equal numbers; `None` where nothing
            can be acted on.
        compared: Which of `starts` the others repeat, so that fixation points compare in pairs, shape (n,).
    """

    starts: TrialPlan
    others: TrialPlan | None
    compared: NDArray[np.intp]


def make_plans(
    pool: TapPool,
    trials: int,
    seed: int,
    fixation: int,
    acts: bool,
    first_stream: int = 0,
    fewest: int = 1,
    block: range | None = None,
) -> Plans:
    """The trials of both policies.

    Args:
        pool: The test taps.
        trials: Per position, and at least as many in all per other fixation point.
        seed: Of the objects that trials start on.
        fixation: The default fixation point.
        acts: Whether active trials are wanted.
        first_stream: Random stream of the first trial at position 0.
        fewest: Trials per position at the other fixation points, at least.
        block: Which trials of each position; `None` for all. Trials do not depend on their block.

    Raises:
        InputError: There are no trials, or a stream is out of range.
    """
    block = range(trials) if block is None else block
    positions = np.flatnonzero(pool.count.any(axis=(0, 2)))
    by_position = [
        plan_trials(pool, len(block), seed, fixation, int(l), first_stream + int(l) * trials + block.start)
        for l in positions
    ]
    if not acts:
        return Plans(join_plans(by_position), None, np.empty(0, np.intp))
    each = min(trials, max(fewest, -(-trials // len(positions))))
    starts = join_plans(by_position)
    compared = np.flatnonzero(np.arange(len(starts.where)) % len(block) < each - block.start)
    few = TrialPlan(*(column[compared] for column in starts))
    others = [few._replace(fixation=np.full_like(few.fixation, l)) for l in range(pool.shape[0]) if l != fixation]
    return Plans(starts, join_plans(others), compared)


def _blocks(trials: int, size: int) -> Iterator[range]:
    """Consecutive blocks of trials."""
    for first in range(0, trials, size):
        yield range(first, min(first + size, trials))


def most_trials(grid: ClassGrid, settings: ExperimentSettings, acts: bool, resamples: int) -> int:
    """How many trials `play_policies` plays where every position has a test tap."""

    def on_pool(trials: int, fewest: int) -> int:
        each = min(trials, max(fewest, -(-trials // grid.L)))
        return grid.L * (4 * trials + (grid.L - 1) * each if acts else 2 * trials)

    return on_pool(settings.trials, 1) + resamples * on_pool(_per_position(grid.L, settings), 2)


def play_policies(
    table: TapTable,
    grid: ClassGrid,
    settings: ExperimentSettings,
    fixation: int,
    *,
    acts: bool,
    pools: ResampledPools = NO_POOLS,
    progress: Callable[[int], None] | None = None,
) -> PlayedPolicies:
    """Plays passive and active trials, on stored and on fresh taps.

    Args:
        table: Test taps.
        grid: The classes.
        settings: What to do.
        fixation: The default fixation point.
        acts: Whether active perception means anything.
        pools: Selections of the test taps, for intervals.
        progress: Called with the number of further trials played.

    Raises:
        InputError: A setting is out of range.
    """
    players = _Players(table, settings)
    play = players.on(table.pool, cores(None), progress)
    sums: list[Sums] = []  # of trials on stored taps, on fresh ones, and of the latter at best and at worst
    policies, starts = 1 + acts, 0
    confusions = np.zeros((policies, grid.M, grid.M), np.int64)
    used_up = np.zeros((policies, len(settings.fresh_thresholds)))
    for block in _blocks(settings.trials, max(1, _AT_ONCE // grid.L)):
        plans = make_plans(table.pool, settings.trials, settings.seed, fixation, acts, block=block)
        stored, trials = _outcomes(plans, play, grid, fresh=False)
        confusions += np.array([confusion(plans.starts.what, one.what[:, settings.shown], grid.M) for one in trials])
        fresh, trials = _outcomes(plans, play, grid, fresh=True)
        used_up += np.array([one.used_up.sum(axis=0) for one in trials])
        starts += len(plans.starts.where)
        new = [stored, fresh, *_endings(plans.starts, trials, grid, settings.play.deadline)]
        sums = [combined(parts, join_sums) for parts in zip(sums, new, strict=True)] if sums else new
    stored, fresh, *ends = (_means(one, grid) for one in sums)
    resampled, selected = _on_resamples(players, grid, settings, fixation, acts, pools, progress)

    def datasets(
        outcomes: Outcomes[Means], ends: Sequence[Outcomes[Means]], of: int, thresholds: Sequence[float]
    ) -> Outcomes[xr.Dataset]:
        drawn, n = [pair[of] for pair in resampled], 1 + len(ends)
        return combined(
            [outcomes, *ends, *drawn],
            lambda means: outcomes_dataset(means[0], means[n:], grid, thresholds, settings.play.deadline, means[1:n]),
        )

    return PlayedPolicies(
        datasets(stored, (), 0, settings.thresholds),
        datasets(fresh, ends, 1, settings.fresh_thresholds),
        confusions[0],
        confusions[1] if acts else None,
        used_up / starts,
        selected,
        spread(table),
        spread(table, thinned=True),
    )


class _Players:
    """Plays trials of both policies on stored and on fresh taps."""

    def __init__(self, table: TapTable, settings: ExperimentSettings) -> None:
        thresholds = settings.thresholds, settings.fresh_thresholds
        rules = [make_rule(some, settings.play, settings.seed) for some in thresholds]
        self._H = [len(some) for some in thresholds]
        player = LoopPlayer(table, rules[0])
        self._players = {
            (moves, fresh): player.under(
                rules[fresh]._replace(theta_x=settings.play.theta_x if moves else 1.0, fresh=fresh)
            )
            for moves in (False, True)
            for fresh in (False, True)
        }

    def on(self, pool: TapPool, threads: int, progress: Callable[[int], None] | None) -> Play:
        """Plays on a selection of the taps; `progress` is called with the number of further trials played."""

        def play(plan: TrialPlan, moves: bool, fresh: bool) -> Trials:
            player = self._players[moves, fresh].on(pool)
            return play_plan(player, checked_plan(plan, pool), self._H[fresh], threads, progress)

        return play


def _endings(starts: TrialPlan, policies: Sequence[Trials], grid: ClassGrid, deadline: int) -> tuple[Sums, Sums]:
    """What came of passive, and active, trials on fresh taps with those that were cut short at their best and worst."""
    passive, *active = (endings(trials, starts, deadline, Farthest.on(grid)) for trials in policies)
    summed = partial(sum_outcomes, plan=starts, place=starts.where, grid=grid)

    def outcomes(end: int) -> Sums:
        if not active:
            return Outcomes(summed(passive[end]))
        moved = active[0]
        return Outcomes(summed(passive[end]), summed(moved[end]), summed(passive[end], minus=moved[1 - end]))

    return outcomes(0), outcomes(1)


def _outcomes(plans: Plans, play: Play, grid: ClassGrid, *, fresh: bool) -> tuple[Sums, list[Trials]]:
    """What came of the trials, and the trials that started everywhere, passive and active."""
    starts, others, compared = plans
    passive = play(starts, False, fresh)
    by_start = partial(sum_outcomes, plan=starts, place=starts.where, grid=grid)
    if others is None:
        return Outcomes(by_start(passive)), [passive]
    active = play(starts, True, fresh)
    outcomes = Outcomes(by_start(passive), by_start(active), by_start(passive, minus=active))
    if fresh:
        return outcomes, [passive, active]

    def by_fixation(trials: Trials, plan: TrialPlan) -> OutcomeSums:
        return sum_outcomes(trials, plan, plan.fixation, grid)

    fixations = by_fixation(_rows(active, compared), _rows(starts, compared))
    for block in _blocks(len(others.where), _AT_ONCE):
        plan = _rows(others, slice(block.start, block.stop))
        fixations = join_sums([fixations, by_fixation(play(plan, True, False), plan)])
    return outcomes._replace(fixations=fixations), [passive, active]


def _means(sums: Sums, grid: ClassGrid) -> Outcomes[Means]:
    return combined([sums], lambda parts: parts[0].means(grid.L))


def _rows[R: (TrialPlan, Trials)](record: R, rows: NDArray[np.intp] | slice) -> R:
    """Some trials of a record."""
    return record._replace(**{name: column[rows] for name, column in record._asdict().items()})


def _on_resamples(
    players: _Players,
    grid: ClassGrid,
    settings: ExperimentSettings,
    fixation: int,
    acts: bool,
    pools: ResampledPools,
    progress: Callable[[int], None] | None,
) -> tuple[list[tuple[Outcomes[Means], Outcomes[Means]]], NDArray[np.float64]]:
    """Outcomes on stored and on fresh taps of each selection, and the share that used up the latter."""
    trials = _per_position(grid.L, settings)

    def one(
        number: int, pair: tuple[TapPool, TapPool]
    ) -> tuple[tuple[Outcomes[Means], Outcomes[Means]], NDArray[np.float64], int]:
        counted: list[int] = []

        def outcomes(fresh: bool) -> tuple[Sums, list[Trials]]:
            first = grid.L * (settings.trials + number * trials)
            plans = make_plans(pair[fresh], trials, settings.seed, fixation, acts, first, fewest=2)
            return _outcomes(plans, players.on(pair[fresh], 1, counted.append), grid, fresh=fresh)

        (stored, _), (fresh, trials_of) = outcomes(False), outcomes(True)
        means = _means(stored, grid), _means(fresh, grid)
        return means, np.array([one.used_up.mean(axis=0) for one in trials_of]), sum(counted)

    kept, used_up = [], []
    tasks = (partial(one, i, pair) for i, pair in enumerate(zip(*pools, strict=True)))
    for pair, share, counted in in_order(tasks, cores(None)):
        kept.append(pair)
        used_up.append(share)
        if progress is not None:
            progress(counted)
    return kept, np.mean(used_up, axis=0) if used_up else np.zeros((1 + acts, len(settings.fresh_thresholds)))


def resamples_of(table: TapTable, resamples: int, seed: int) -> ResampledPools:
    """Selections of the test taps, without the taps as they are."""
    return ResampledPools(*(list(pools(table, resamples, seed))[1:] for pools in (resampled_pools, thinned_pools)))


def _per_position(L: int, settings: ExperimentSettings) -> int:
    """Trials at each position on a resample."""
    return min(settings.trials, -(-RESAMPLE_TRIALS // L))
