"""What trials would give if the study were repeated: the same trials on resampled test taps.

Drawn anew would be the test taps, and with them their sessions where several test. So each resample draws as many
sessions as there are, with replacement, then as many taps of each class and session as it has, with replacement, and
plays trials on these. Models, policies and thresholds that are given the same taps get the same resamples and the same
random numbers, so their differences pair. The model, and so the training taps, stays as it is.

Trials draw no tap twice (`montecarlo.Rule.fresh`): every decision then is one on fresh taps, and means over trials are
unbiased, however few taps there are. In a resample some taps are in the pool several times, which makes its beliefs too
sure; so a resample says how much an estimate varies, not where it lies: its deviation from the mean of all resamples
is what counts, see `Spread`.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..hardware.pool import TapPool, pool_of
from ..models import seeds
from ..models.threads import cores, in_order
from .episode import DEADLINE
from .montecarlo import LoopPlayer, Trials, empty_trials, make_rule
from .reference import Border
from .trial_plan import TapTable, TrialPlan, checked_plan, plan_trials

type Floats = NDArray[np.float64]

RESAMPLES = 200
CONFIDENCE = 0.95
FEW = 10
"""Taps of a class below which intervals are not known to hold, see docs/intervals.md."""
RESAMPLE_TRIALS = 1000
USED_UP = 0.05
"""Share of trials that the stored taps end, above which there are too few of them."""
_DEFINED = 0.95  # of the resamples: an interval from fewer would be that of the lucky ones


class Spread(NamedTuple):
    """How resamples turn into intervals.

    Attributes:
        factor: By which deviations of resamples are enlarged: n of n draws with replacement vary less than the
            quantity itself, by n - 1 over n, n being the sessions where several test, else the taps of a class. NaN
            where n is 1, which gives no interval.
        few: Why intervals may be off, in a sentence; empty where they hold.
        taps: How many test taps there are.
    """

    factor: float
    few: str = ""
    taps: int = 0

    def interval(
        self, samples: NDArray[np.float64], least: ArrayLike = -np.inf, most: ArrayLike = np.inf
    ) -> tuple[Floats, Floats]:
        """Ends of the 95 % interval.

        Args:
            samples: The estimate and, behind that, R resamples, shape (..., 1 + R). NaN resamples are left out; where
                they are more than one in twenty, the interval is NaN. Infinite ones may be its ends.
            least: What the quantity cannot be below.
            most: Nor above.

        Returns:
            Each of shape (...).
        """
        estimate, drawn = samples[..., 0], samples[..., 1:]
        defined = ~np.isnan(drawn)
        enough = ~np.isnan(estimate) & (defined.sum(axis=-1) >= max(1.0, _DEFINED * drawn.shape[-1]))
        finite = np.isfinite(drawn)
        count = np.maximum(finite.sum(axis=-1), 1)
        center = np.where(finite, drawn, 0.0).sum(axis=-1) / count
        ordered = np.sort(drawn, axis=-1)  # NaN last
        last = np.maximum(defined.sum(axis=-1) - 1, 0)
        tail = (1 - CONFIDENCE) / 2
        places = np.floor(tail * last).astype(np.intp), np.ceil((1 - tail) * last).astype(np.intp)
        ends = []
        for place in places:
            end = np.take_along_axis(ordered, place[..., np.newaxis], axis=-1)[..., 0]
            with np.errstate(invalid="ignore"):
                moved = estimate + self.factor * (end - center)
            end = np.where(np.isfinite(estimate) & np.isfinite(end), moved, end)
            ends.append(np.where(enough, np.clip(end, least, most), np.nan))
        return ends[0], ends[1]


def share_beyond(independent: ArrayLike) -> Floats:
    """The upper end of the interval of a proportion of which no case was seen in so many independent ones.

    Three over their number is the familiar rule for an upper end alone; this is that of a two-sided interval.
    """
    return 1 - ((1 - CONFIDENCE) / 2) ** (1 / np.maximum(1.0, np.asarray(independent, dtype=np.float64)))


def widened(
    low: Floats, high: Floats, independent: ArrayLike, unit: float = 1.0, most: float = 1.0, *, opened: bool = False
) -> tuple[Floats, Floats]:
    """An interval of a mean error that reaches at least so far as not a single error, or errors only, would have it.

    A bootstrap cannot know of what never occurred.

    Args:
        low: Lower end.
        high: Upper end.
        independent: How many decisions are independent of each other.
        unit: The smallest error; 1 in a proportion.
        most: The greatest mean error, which may be infinite.
        opened: Whether ends that are NaN become 0 and the greatest mean.
    """
    beyond = unit * share_beyond(independent)
    if opened:
        low, high = np.where(np.isnan(low), 0.0, low), np.where(np.isnan(high), most, high)
    return np.minimum(low, most - beyond), np.minimum(np.maximum(high, beyond), most)


def spread(table: TapTable, used_up: float = 0.0) -> Spread:
    """How resamples of a table turn into intervals.

    Args:
        table: Test taps.
        used_up: Share of the trials that ended because all taps of a class were drawn.
    """
    taps, sessions = taps_per_class(table.pool), len(np.unique(_session(table)[table.pool.order]))
    n = sessions if sessions > 1 else taps
    factor = float(np.sqrt(n / (n - 1))) if n > 1 else np.nan
    return Spread(factor, too_few(taps, used_up), int(table.pool.count.sum()))


def taps_per_class(pool: TapPool) -> int:
    """Taps of a class, the median over those that have some."""
    return max(1, int(np.median(pool.count[pool.count > 0])))


def too_few(taps: int, used_up: float = 0.0) -> str:
    """Why intervals may be off, in a sentence; empty where they hold.

    Args:
        taps: Of a class.
        used_up: Share of the trials that ended because all taps of a class were drawn.
    """
    if taps == 1:
        return "There is one test tap of most classes, too few for an interval."
    if used_up > USED_UP:
        return (
            f"There are too few test taps: {used_up:.0%} of the decisions were made because the {taps} or so of a "
            "class were used up, not because the belief was high enough; intervals may be too wide."
        )
    if taps < FEW:
        return f"There are too few test taps, {taps} or so of each class: intervals are rough."
    return ""


def resampled_pools(table: TapTable, resamples: int, seed: int) -> Iterator[TapPool]:
    """The pool of a table as it is, then resamples of it.

    Args:
        table: Test taps; only their classes and sessions matter.
        resamples: How many.
        seed: Of the resamples.
    """
    pool = table.pool
    yield pool
    count = pool.count.ravel()
    cell = np.repeat(np.arange(len(count)), count)
    taps = np.concatenate([pool.order[f : f + n] for f, n in zip(pool.first.flat, count, strict=True)])
    groups = _groups(cell, _session(table)[taps])
    generator = seeds.generator(seed, seeds.Purpose.RESAMPLES)
    for _ in range(resamples):
        sessions = generator.integers(len(groups), size=len(groups)) if len(groups) > 1 else (0,)
        drawn = np.concatenate([groups[s].drawn(generator) for s in sessions])
        yield pool_of(taps[drawn], cell[drawn], pool.nearest.shape)


def play_resamples[T](
    table: TapTable,
    thresholds: ArrayLike,
    reduce: Callable[[Trials, TrialPlan], T],
    *,
    trials: int,
    theta_x: float,
    fixation: int = 0,
    where: int | None = None,
    border: Border = "uniform",
    deadline: int = DEADLINE,
    seed: int = 0,
    fresh: bool = True,
    resamples: int = RESAMPLES,
    resample_trials: int = RESAMPLE_TRIALS,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> list[T]:
    """What comes of trials on the test taps, and of trials on each resample of them.

    Args:
        table: Test taps.
        thresholds: theta_W, shape (H,).
        reduce: What is kept of decided trials.
        trials: On the taps as they are; their streams and starts are those of `plan_trials`.
        theta_x: Threshold for a move; 1 never moves.
        fixation: Class that the sensor aims for.
        where: Start in this where class only, or the nearest with a tap in the resample; `None` for any.
        border: Reading of Eq. 9.
        deadline: Taps after which the most probable classes are taken.
        seed: Of starts, draws and resamples.
        fresh: Whether no tap is drawn twice in a trial.
        resamples: How many.
        resample_trials: On each of them, at most `trials`.
        workers: Threads; `None` for as many as there are cores. Changes the speed only.
        progress: Told how many more trials were played, of `planned_trials`.

    Returns:
        What `reduce` gave, of the taps as they are first; resamples follow in an order that the seed alone decides.

    Raises:
        InputError: An argument is out of range.
    """
    rule = make_rule(thresholds, theta_x, border, deadline, seed)._replace(fresh=fresh)
    player = LoopPlayer(table, rule)
    fewer = min(trials, resample_trials)

    def one(pool: TapPool, n: int, stream: int) -> T:
        plan = plan_trials(pool, n, seed, fixation, _start(pool, where), stream)
        played = empty_trials(n, len(rule.thresholds))
        player.on(pool)(checked_plan(plan, pool), 0, n, played)
        return reduce(played, plan)

    sizes = (trials, *[fewer] * resamples)
    tasks = (
        partial(one, pool, n, trials + (number - 1) * fewer if number else 0)
        for number, (pool, n) in enumerate(zip(resampled_pools(table, resamples, seed), sizes, strict=True))
    )
    kept = []
    for n, result in zip(sizes, in_order(tasks, cores(workers)), strict=True):
        kept.append(result)
        if progress is not None:
            progress(n)
    return kept


def planned_trials(trials: int, resamples: int = RESAMPLES, resample_trials: int = RESAMPLE_TRIALS) -> int:
    """How many trials `play_resamples` plays."""
    return trials + resamples * min(trials, resample_trials)


def _start(pool: TapPool, where: int | None) -> int | None:
    """The where class to start in: a resample of sessions may lack the one that is wanted."""
    if where is None or not 0 <= where < len(pool.count):
        return where
    held = np.flatnonzero(pool.count.any(axis=1))
    return int(held[np.abs(held - where).argmin()])


class _Group(NamedTuple):
    """The taps of one session, class by class.

    Attributes:
        member: Their numbers, shape (n,).
        first: Where the class of each begins among them, shape (n,).
        size: How many that class has, shape (n,).
    """

    member: NDArray[np.intp]
    first: NDArray[np.intp]
    size: NDArray[np.intp]

    def drawn(self, generator: np.random.Generator) -> NDArray[np.intp]:
        """As many of each class as there are, with replacement."""
        return self.member[self.first + (generator.random(len(self.member)) * self.size).astype(np.intp)]


def _groups(cell: NDArray[np.intp], session: NDArray[np.intp]) -> list[_Group]:
    """Sessions; taps are in the order of their classes."""
    groups = []
    for s in np.unique(session):
        member = np.flatnonzero(session == s)
        _, first, index, count = np.unique(cell[member], return_index=True, return_inverse=True, return_counts=True)
        groups.append(_Group(member, first[index], count[index]))
    return groups


def _session(table: TapTable) -> NDArray[np.intp]:
    """Session of each tap of a table, shape (N,)."""
    N = len(table.log_likelihood)
    return np.zeros(N, np.intp) if table.session is None else np.asarray(table.session, np.intp)
