"""Belief threshold from training taps, for a cost of errors in taps.

An episode costs its taps and `cost_error` taps for each unit of decision error. Higher thresholds buy fewer errors with
more taps; the one with the least mean cost on held-out taps is taken, the lowest of equal ones. The price says which
errors one is ready to wait for; it cannot be found in data.

For a wanted error instead of a price there is `analysis.stats.target_error`, which promises something of new sessions.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.errors import InputError
from ...models.settings import PlaySettings
from ..moves.control import check_fixation
from ..trials.records import Farthest, TapTable, endings, plan_trials
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

TRIALS = 4000
_DEAREST = 1e9  # taps for an error of 1


class ThresholdChoice(NamedTuple):
    """Costs of every threshold and the chosen one.

    Attributes:
        theta: The thresholds, increasing, shape (H,).
        wrong: P(wrong) in each part, shape (F, H).
        error: Mean error, each of shape (H,).
        taps: Mean reaction time, likewise.
        cost: Mean cost of an episode in taps, likewise.
        excess: By how much it exceeds the least, likewise.
        alike: Thresholds whose cost the data cannot tell from the least: the 95% interval of the excess holds 0,
            shape (H,).
        chosen: Index of the one with the least cost.
        used_up: Share of trials that ended because they had had all taps of a class, shape (H,).
    """

    theta: Floats
    wrong: Floats
    error: Estimate
    taps: Estimate
    cost: Estimate
    excess: Estimate
    alike: NDArray[np.bool_]
    chosen: int
    used_up: Floats

    @property
    def value(self) -> float:
        """The chosen threshold."""
        return float(self.theta[self.chosen])


def choose_threshold(
    parts: Parts,
    thresholds: ArrayLike,
    cost_error: float,
    *,
    play: PlaySettings = PlaySettings(),
    wrong: bool = False,
    trials: int = TRIALS,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
) -> ThresholdChoice:
    """Threshold with the lowest mean cost.

    Args:
        parts: Training taps and models that have not seen them.
        thresholds: Those to choose from, shape (H,).
        cost_error: Taps that a unit of error is worth, 0 or more.
        play: How trials are played.
        wrong: Whether errors are P(wrong) even where objects have sizes.
        trials: In each part; all thresholds share them.
        seed: Random seed of the trials.
        progress: Called with the number of trials since the last call.

    Raises:
        InputError: The price is negative, or a setting is out of range.
    """
    check_cost(cost_error)
    theta = np.unique(np.asarray(thresholds, dtype=np.float64))
    aim = check_fixation(play.fixation, parts.grid.L)

    far = Farthest.on(parts.grid)

    def played_on(table: TapTable, stream: int) -> tuple[NDArray[Any], ...]:
        plan = plan_trials(table.pool, trials, seed, aim, first_stream=stream)
        played = run_trials(
            table,
            plan,
            theta,
            play=play,
            seed=seed,
            fresh=True,
            progress=progress,
        )
        true, ends = plan.what[:, np.newaxis], (played, *endings(played, plan, play.deadline, far))
        error = [decision_error(parts.grid, end.what, true, wrong).T for end in ends]
        return *error, *(end.taps.T for end in ends), (played.what != true).T, played.used_up.T

    error, error_best, error_worst, taps, taps_best, taps_worst, missed, used_up = map(
        np.array, zip(*(played_on(part.table, f * trials) for f, part in enumerate(parts.parts)), strict=True)
    )
    errors, times = (error_best, error_worst), (taps_best, taps_worst)
    cost, costs = cost_error * error + taps, [cost_error * e + t for e, t in zip(errors, times, strict=True)]
    drawn = repeated_means(parts, played_on, trials, seed)
    error_drawn, taps_drawn = drawn[0], drawn[3]
    cost_drawn = cost_error * error_drawn + taps_drawn
    mean = over_parts(cost, cost_drawn, 1.0, costs)
    chosen = int(mean.mean.argmin())
    excess = excess_over_parts(cost, chosen, cost_drawn, costs)
    reaction = over_parts(taps, taps_drawn, 1.0, times)
    return ThresholdChoice(
        theta,
        missed.mean(axis=-1),
        with_unseen(over_parts(error, error_drawn, 0.0, errors), reaction.mean, parts, wrong),
        reaction,
        mean,
        excess,
        excess.low <= 0,
        chosen,
        used_up.mean(axis=(0, -1)),
    )


def check_cost(cost_error: float) -> float:
    """Checked cost of an error in taps.

    Raises:
        InputError: It is negative, no number, or so large that taps no longer count.
    """
    if not 0 <= cost_error <= _DEAREST:
        raise InputError(f"The cost of an error must be a number of taps, 0 to {_DEAREST:g}, got {cost_error}.")
    return float(cost_error)
