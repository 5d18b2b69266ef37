"""Test taps and plans of trials, each of which depends only on its random stream."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...hardware.replay import TapPool, tap_pool
from ...models.errors import InputError
from ...models.measurement.model import TapModel
from ...models.taps import TapSet
from . import kernel
from . import random as draws
from .records import TapTable, TrialPlan


def tap_table(model: TapModel, taps: TapSet) -> TapTable:
    """Log-likelihoods of test taps and their pool.

    Args:
        model: The fitted measurement model.
        taps: Test taps, all of trained classes (see `TapModel.usable`).
    """
    where, what = taps.indices(model.grid)
    pool = tap_pool(where, what, model.grid.shape)
    return TapTable(
        model.log_likelihood(taps.taps), pool, model.log_prior, model.saturation, taps.session, model.trained
    )


def plan_trials(
    pool: TapPool, trials: int, seed: int, fixation: int = 0, where: int | None = None, first_stream: int = 0
) -> TrialPlan:
    """Trials that start in classes with a test tap, drawn uniformly over those.

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
    if not 0 <= first_stream <= draws.MOST_STREAM - trials:
        raise InputError(f"Streams must be from 0 to {draws.MOST_STREAM}, got {first_stream} and following.")
    cells = np.argwhere(pool.count > 0)
    if where is not None:
        cells = cells[cells[:, 0] == where]
    if not len(cells):
        raise InputError(f"Position {where} has no test tap to start from.")
    stream = first_stream + np.arange(trials)
    word = _start_words(seed, first_stream, trials)
    start = cells[draws.below(word, np.uint64(len(cells))).astype(np.intp)]
    where_class, what_class = (np.ascontiguousarray(column) for column in start.T)
    return TrialPlan(where_class, what_class, np.full(trials, fixation, dtype=np.intp), stream)


@lru_cache(maxsize=512)
def _start_words(seed: int, first_stream: int, trials: int) -> NDArray[np.uint64]:
    """Random words that select the start of trials; the same for resamples of every model and policy."""
    word = draws.words(seed, first_stream + np.arange(trials), kernel.STARTS, 0, 1)[:, 0]
    word.flags.writeable = False
    return word


def join_plans(plans: Sequence[TrialPlan]) -> TrialPlan:
    """Several plans joined in order."""
    return TrialPlan(*(np.concatenate(parts) for parts in zip(*plans, strict=True)))


def trial_uniforms(seed: int, stream: int, taps: int) -> NDArray[np.float64]:
    """Random numbers of a trial, one per tap; number u selects tap floor(u * count) of the class."""
    return draws.uniform(draws.words(seed, stream, kernel.TAPS, 0, taps)[0])


def trial_chances(seed: int, stream: int, taps: int) -> NDArray[np.float64]:
    """Random numbers for the control strategy in a trial, one after each tap."""
    return draws.uniform(draws.words(seed, stream, kernel.CHANCE, 0, taps)[0])


def checked_plan(plan: TrialPlan, pool: TapPool) -> TrialPlan:
    """Plan in the form of the compiled loops.

    Raises:
        InputError: Its columns differ in length, or it names a class that is not there or an object without a tap.
    """
    plan = TrialPlan(*(np.ascontiguousarray(column, dtype=np.int64) for column in plan))
    if len({column.shape for column in plan}) != 1 or plan.where.ndim != 1:
        raise InputError(f"The columns of a plan differ in shape: {', '.join(str(column.shape) for column in plan)}.")
    L, M = pool.nearest.shape
    inside = (plan.where >= 0) & (plan.where < L) & (plan.what >= 0) & (plan.what < M)
    if not inside.all():
        i = int(inside.argmin())
        raise InputError(f"Trial {i} starts in class ({plan.where[i]}, {plan.what[i]}), outside the {L} x {M} classes.")
    empty = pool.nearest[plan.where, plan.what] < 0
    if empty.any():
        raise InputError(f"Trial {int(empty.argmax())} uses object {plan.what[empty][0]}, which has no test tap.")
    return plan
