"""Fixation point from training taps: expected decision error at every position, and the choice.

At each position trials are played on taps that did not train their model, either such as aim for it or passive ones
that stand there. Trials of all positions have the same random numbers, so positions are compared trial by trial.

**Choice.** The least error is the least by luck too, the more so the flatter the curve. So every position counts as
good whose error exceeds the least by no more than one standard error of that very difference, and of the good ones the
nearest to the middle of the range is taken: from there moves are shortest and least often end at a border, where
the belief that leaves the range is lost. The difference has a smaller standard error than either error, because what a
session does to one position it does to its neighbours.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.grid import TapPool
from ...models.settings import PlaySettings
from ..moves.control import default_fixation
from ..trials.records import Farthest, TapTable, TrialPlan, endings, join_plans, plan_trials
from ..trials.run import run_trials
from .held_out import (
    Estimate,
    Floats,
    Parts,
    decision_error,
    excess_over_parts,
    over_parts,
    repeated_means,
    with_unseen,
)

TRIALS = 1000


class FixationChoice(NamedTuple):
    """Errors at every position and the chosen fixation point.

    Attributes:
        errors: Mean error in each part, NaN at positions that were not tried, shape (F, L).
        taps: Mean reaction time, likewise.
        error: Expected error, each of shape (L,).
        excess: By how much it exceeds the least, each of shape (L,).
        best: The position with the least error.
        alike: Positions that are no worse by more than a standard error, shape (L,).
        chosen: The one of these nearest to the middle.
    """

    errors: Floats
    taps: Floats
    error: Estimate
    excess: Estimate
    best: int
    alike: NDArray[np.bool_]
    chosen: int


def choose_fixation(
    parts: Parts,
    play: PlaySettings,
    *,
    wrong: bool = False,
    trials: int = TRIALS,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
) -> FixationChoice:
    """Fixation point chosen by the error at each position.

    Args:
        parts: Training taps and models that have not seen them.
        play: How trials are played: passive ones stand at the position, active ones begin anywhere and aim for it.
        wrong: Whether errors are P(wrong) even where objects have sizes.
        trials: At each position in each part.
        seed: Random seed of the trials.
        progress: Called with the number of trials since the last call.

    Raises:
        InputError: No position has taps in all parts, or a setting is out of range.
    """
    tried = _positions(parts, play.passive)

    far = Farthest.on(parts.grid)

    def played_on(table: TapTable, stream: int) -> tuple[NDArray[Any], ...]:
        plan = (_passive_plan if play.passive else _active_plan)(table.pool, tried, trials, seed, stream)
        played = run_trials(
            table,
            plan,
            (play.threshold,),
            play=play,
            seed=seed,
            fresh=True,
            progress=progress,
        )
        ends = [played, *endings(played, plan, play.deadline, far)]
        errors = [decision_error(parts.grid, end.what[:, 0], plan.what, wrong) for end in ends]
        return tuple(one.reshape(len(tried), trials) for one in (*errors, played.taps))

    played = (played_on(part.table, f * trials) for f, part in enumerate(parts.parts))
    errors, *ends, taps = map(np.array, zip(*played, strict=True))
    drawn = repeated_means(parts, played_on, trials, seed)[0]
    found = choice(errors, taps, tried, parts.grid.L, drawn, ends)
    return found._replace(error=with_unseen(found.error, found.taps.mean(axis=0), parts, wrong))


def choice(
    errors: Floats,
    taps: Floats,
    tried: NDArray[np.intp],
    L: int,
    drawn: Floats,
    might_be: Sequence[Floats] = (),
) -> FixationChoice:
    """Fixation point from the outcomes of trials.

    Args:
        errors: Errors of n trials at each of P positions in each of F parts, shape (F, P, n).
        taps: Reaction times, likewise.
        tried: The positions, shape (P,).
        L: Number of positions of the grid.
        drawn: Mean errors in repeats, see `over_parts`, shape (R, P).
        might_be: What else the errors might be, likewise.
    """
    error = over_parts(errors, drawn, 0.0, might_be)
    best = int(error.mean.argmin())
    excess = excess_over_parts(errors, best, drawn, might_be)
    alike = np.flatnonzero(excess.mean <= excess.error)
    away = np.abs(tried[alike] - (L - 1) / 2)
    chosen = alike[np.lexsort((tried[alike] != default_fixation(L), error.mean[alike], away))[0]]
    good = np.zeros(L, dtype=np.bool_)
    good[tried[alike]] = True
    return FixationChoice(
        _spread(errors.mean(axis=-1), tried, L),
        _spread(taps.mean(axis=-1), tried, L),
        Estimate(*(_spread(values, tried, L) for values in error)),
        Estimate(*(_spread(values, tried, L) for values in excess)),
        int(tried[best]),
        good,
        int(tried[chosen]),
    )


def _positions(parts: Parts, passive: bool) -> NDArray[np.intp]:
    """Positions to play trials at."""
    if not passive:
        return np.arange(parts.grid.L)
    there = np.all([part.table.pool.count.any(axis=(0, 2)) for part in parts.parts], axis=0)
    if not there.any():
        raise InputError("Passive trials need a position with taps in every part of the training taps; there is none.")
    return np.flatnonzero(there)


def _passive_plan(pool: TapPool, tried: NDArray[np.intp], trials: int, seed: int, stream: int) -> TrialPlan:
    return join_plans([plan_trials(pool, trials, seed, where=int(l), first_stream=stream) for l in tried])


def _active_plan(pool: TapPool, tried: NDArray[np.intp], trials: int, seed: int, stream: int) -> TrialPlan:
    plan = plan_trials(pool, trials, seed, first_stream=stream)
    return join_plans([plan._replace(fixation=np.full(trials, l)) for l in tried])


def _spread(values: Floats, tried: NDArray[np.intp], L: int) -> Floats:
    """Values of some positions, NaN for the others."""
    whole = np.full((*values.shape[:-1], L), np.nan)
    whole[..., tried] = values
    return whole
