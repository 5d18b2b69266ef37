"""Inputs and outputs of trials, as records of arrays for compiled loops."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...models import seeds
from ...models.errors import InputError
from ...models.grid import ClassGrid, TapPool, episode_sessions, tap_pool
from ...models.measurement.model import TapModel
from ...models.taps import TapSet


class TapTable(NamedTuple):
    """Test taps with their log-likelihoods.

    Attributes:
        log_likelihood: log P(z | class) of every tap, shape (N, L, S M): hypothesis s M + m is object m in state s of
            the episode, see `models.measurement.states`; without states S is 1.
        pool: Which taps belong to which class, and to which of the sessions that trials stay in.
        log_prior: Log belief before the first tap, shape (L, S M).
        saturation: How many taps' evidence a sequence of them carries at most, see `saturation`.
        session: Recorded session of each tap, shape (N,); `None` where all are of one.
        given_trained: Which classes belief may move into, shape (L, M); `None` for those with a prior above 0.
    """

    log_likelihood: NDArray[np.float64]
    pool: TapPool
    log_prior: NDArray[np.float64]
    saturation: float = np.inf
    session: NDArray[np.integer] | None = None
    given_trained: NDArray[np.bool_] | None = None

    @property
    def trained(self) -> NDArray[np.bool_]:
        """Mask of the classes that may have belief, shape (L, M)."""
        if self.given_trained is not None:
            return self.given_trained
        L, M = self.pool.shape
        return (self.log_prior > -np.inf).reshape(L, -1, M).any(axis=1)

    def recorded_session(self, number: int) -> int | None:
        """Recorded session of a number in a plan; `None` where trials draw taps of all."""
        pool = self.pool
        if len(pool.count) == 1 or self.session is None:
            return None
        return int(self.session[pool.order[pool.first[number][pool.count[number] > 0][0]]])


class TrialPlan(NamedTuple):
    """Plan of n trials.

    Attributes:
        where: Class in which the sensor starts, shape (n,).
        what: Class of the object, shape (n,).
        fixation: Class that the sensor aims for, shape (n,).
        stream: Random stream, shape (n,); trials of one stream see the same random numbers.
        session: Number of the session in the pool that its taps are drawn from, shape (n,).
    """

    where: NDArray[np.intp]
    what: NDArray[np.intp]
    fixation: NDArray[np.intp]
    stream: NDArray[np.intp]
    session: NDArray[np.intp]


class Rule(NamedTuple):
    """Moving and stopping of trials, in the form of the compiled loops.

    Attributes:
        thresholds: theta_W in increasing order, infinity for those that never stop, shape (H,).
        column: Where each stands in the results, shape (H,).
        theta_x: Threshold for a move.
        border: Number of the border, see `engines.compiled.border_number`.
        deadline: Taps after which the most probable classes are taken.
        key0: First key word of the seed.
        key1: Second key word.
        fresh: Whether no tap is drawn twice in a trial. A trial that has had all stored taps of the class where it
            stands then ends with the most probable classes, as at the deadline. Otherwise taps are drawn with
            replacement. The move to that class is no part of the trial: it brought no tap.
    """

    thresholds: NDArray[np.float64]
    column: NDArray[np.int64]
    theta_x: float
    border: int
    deadline: int
    key0: np.uint64
    key1: np.uint64
    fresh: bool = False


class Trials(NamedTuple):
    """Decisions of n trials at H thresholds; all arrays of shape (n, H).

    Attributes:
        taps: Reaction time.
        what: Decided what class.
        where: Decided where class, at the place of the last tap.
        true_where: Class in which the sensor stood then.
        stopped: Whether the threshold was crossed; otherwise the deadline came.
        clamped: Moves before the last tap that the end of the range cut short.
        substituted: Times before the last tap that a class without a tap was replaced by the nearest with one.
        belief: Belief in the decided what class.
        used_up: Whether a trial on fresh taps ended because it had had all stored taps of the class, see `Rule.fresh`.
        no_class_left: Whether the trial ended undecided with a tap that was impossible under every class still believed
            in; the decision is what was most probable before that tap, which `taps` counts.
    """

    taps: NDArray[np.int64]
    what: NDArray[np.int64]
    where: NDArray[np.int64]
    true_where: NDArray[np.int64]
    stopped: NDArray[np.bool_]
    clamped: NDArray[np.int64]
    substituted: NDArray[np.int64]
    belief: NDArray[np.float64]
    used_up: NDArray[np.bool_]
    no_class_left: NDArray[np.bool_]


class Likelihoods(NamedTuple):
    """Likelihoods of N taps relative to the largest of each, as scaled numbers z 2^(-256 k).

    Attributes:
        rows: z, 0 where the tap is impossible, shape (N, S M, L).
        plain: The likelihoods as plain numbers, 0 where k > 1, shape (N, S M, L).
        least: The smallest of these above 0 of each tap, shape (N,).
        wide: Whether some k is not 0, shape (N,).
        units: k, shape (N, S M, L), or (0, S M, L) where no tap is wide.
    """

    rows: NDArray[np.float64]
    plain: NDArray[np.float64]
    least: NDArray[np.float64]
    wide: NDArray[np.bool_]
    units: NDArray[np.int64]


class ScaledBelief(NamedTuple):
    """Belief relative to its largest class, as scaled numbers.

    Attributes:
        z: Shape (S M, L).
        k: Shape (S M, L).
    """

    z: NDArray[np.float64]
    k: NDArray[np.int64]


class Classes(NamedTuple):
    """Mask of the classes that may have belief.

    Attributes:
        holes: Whether some may hold none.
        trained: Which may, shape (M, L).
        nearest: The nearest such position of the same object, shape (M, L).
    """

    holes: bool
    trained: NDArray[np.bool_]
    nearest: NDArray[np.int64]


ENDINGS = ("_at_best", "_at_worst")
"""Suffixes of what trials come to with those that were cut short so, in datasets."""


class Farthest(NamedTuple):
    """Decision with the largest error for each true class.

    Attributes:
        where: Shape (L,).
        what: Shape (M,); another object, if there is one.
    """

    where: NDArray[np.intp]
    what: NDArray[np.intp]

    @classmethod
    def among(cls, L: int, M: int) -> Self:
        """Result if all errors are equal: the next class."""
        return cls(*((np.arange(n) + 1) % n for n in (L, M)))

    @classmethod
    def on(cls, grid: ClassGrid) -> Self:
        """Result on a grid."""
        where, what = (
            error(*np.indices((n, n))).argmax(axis=0)
            for error, n in ((grid.where_error, grid.L), (grid.what_error, grid.M))
        )
        alike = what == np.arange(grid.M)  # objects of one size
        return cls(where, np.where(alike, cls.among(*grid.shape).what, what))


def endings(trials: Trials, plan: TrialPlan, deadline: int, farthest: Farthest) -> tuple[Trials, Trials]:
    """Trials with the truncated ones at their best, and at their worst.

    Args:
        trials: On fresh taps.
        plan: What they are.
        deadline: Taps after which a trial ends at the latest.
        farthest: What their worst decisions are.
    """
    cut = trials.used_up
    what, where = plan.what[:, np.newaxis], trials.true_where
    decided = trials._replace(stopped=trials.stopped | cut)
    best = decided._replace(what=np.where(cut, what, trials.what), where=np.where(cut, where, trials.where))
    worst = decided._replace(
        what=np.where(cut, farthest.what[what], trials.what),
        where=np.where(cut, farthest.where[where], trials.where),
        taps=np.where(cut, deadline, trials.taps),
        belief=np.where(cut, 1.0, trials.belief),
    )
    return best, worst


def tap_table(model: TapModel, taps: TapSet) -> TapTable:
    """Log-likelihoods of test taps and their pool.

    Args:
        model: The fitted measurement model.
        taps: Test taps, all of trained classes (see `TapModel.usable`).
    """
    where, what = taps.indices(model.grid)
    pool = tap_pool(where, what, model.grid.shape, episode_sessions(where, what, taps.session))
    return TapTable(
        model.judging(taps).log_likelihood(taps.samples),
        pool,
        model.log_prior,
        model.saturation,
        taps.session,
        model.trained,
    )


def plan_trials(
    pool: TapPool, trials: int, seed: int, fixation: int = 0, where: int | None = None, first_stream: int = 0
) -> TrialPlan:
    """Trials that start in classes with a test tap, drawn uniformly over those of every session.

    The start of a trial depends on the seed and its stream only, so a plan can be made in pieces.

    Args:
        pool: The test taps.
        trials: Number of trials.
        seed: Random seed of the starting classes.
        fixation: Class that the sensor aims for.
        where: Start in this where class only; `None` for any.
        first_stream: Random stream of the first trial; the others follow.

    Raises:
        InputError: No class with a test tap is left, there are no trials, or the seed or a stream is out of range.
    """
    if trials < 1:
        raise InputError(f"trials must be at least 1, got {trials}.")
    if not 0 <= first_stream <= seeds.MOST_STREAM - trials:
        raise InputError(f"Streams must be from 0 to {seeds.MOST_STREAM}, got {first_stream} and following.")
    held = pool.count > 0
    if where is not None:
        held = held & (np.arange(held.shape[1]) == where)[:, np.newaxis]
    if not held.any():
        raise InputError(f"Position {where} has no test tap to start from.")
    made = _starts if trials <= _KEPT else _starts.__wrapped__
    session, where_class, what_class = (
        row.copy() for row in made(held.tobytes(), held.shape, trials, seed, first_stream)
    )
    stream = first_stream + np.arange(trials)
    return TrialPlan(where_class, what_class, np.full(trials, fixation, dtype=np.intp), stream, session)


_KEPT = 5000  # trials at most whose starts are kept, as many as resamples have


@lru_cache(maxsize=512)
def _starts(held: bytes, shape: tuple[int, ...], trials: int, seed: int, first_stream: int) -> NDArray[np.intp]:
    """Session, position and object in which trials start, shape (3, trials); resamples of every model share them."""
    cells = np.argwhere(np.frombuffer(held, np.bool_).reshape(shape))
    word = seeds.words(seed, first_stream + np.arange(trials), seeds.STARTS, 0, 1)[:, 0]
    return np.ascontiguousarray(cells[seeds.below(word, np.uint64(len(cells))).astype(np.intp)].T)


def join_plans(plans: Sequence[TrialPlan]) -> TrialPlan:
    """Several plans joined in order."""
    return TrialPlan(*(np.concatenate(parts) for parts in zip(*plans, strict=True)))


def trial_uniforms(seed: int, stream: int, taps: int) -> NDArray[np.float64]:
    """Random numbers of a trial, one per tap; number u selects tap floor(u * count) of the class."""
    return seeds.uniform(seeds.words(seed, stream, seeds.TAPS, 0, taps)[0])


def trial_chances(seed: int, stream: int, taps: int) -> NDArray[np.float64]:
    """Random numbers for the control strategy in a trial, one after each tap."""
    return seeds.uniform(seeds.words(seed, stream, seeds.CHANCE, 0, taps)[0])


def checked_plan(plan: TrialPlan, pool: TapPool) -> TrialPlan:
    """Plan in the form of the compiled loops.

    Raises:
        InputError: Its columns differ in length, or it names a class or session that is not there, or an object
            without a tap.
    """
    plan = TrialPlan(*(np.ascontiguousarray(column, dtype=np.int64) for column in plan))
    if len({column.shape for column in plan}) != 1 or plan.where.ndim != 1:
        raise InputError(f"The columns of a plan differ in shape: {', '.join(str(column.shape) for column in plan)}.")
    (L, M), S = pool.shape, len(pool.count)
    inside = (plan.where >= 0) & (plan.where < L) & (plan.what >= 0) & (plan.what < M)
    if not inside.all():
        i = int(inside.argmin())
        raise InputError(f"Trial {i} starts in class ({plan.where[i]}, {plan.what[i]}), outside the {L} x {M} classes.")
    known = (plan.session >= 0) & (plan.session < S)
    if not known.all():
        i = int(known.argmin())
        raise InputError(f"Trial {i} stays in session {plan.session[i]} of {S} sessions.")
    empty = pool.nearest[plan.session, plan.where, plan.what] < 0
    if empty.any():
        raise InputError(f"Trial {int(empty.argmax())} uses object {plan.what[empty][0]}, which has no test tap.")
    return plan
