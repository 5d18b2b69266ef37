"""Costs of episodes, on any rig and for many trials at once.

The cost is in taps: those made, and `cost_error` more for each unit of decision error. To know it somebody has to say
which object it was.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...hardware.sensor import TouchSensor
from ...models.grid import ClassGrid
from ...models.settings import PlaySettings
from ..engines.engine import Engine
from ..episode import perceive
from ..moves.control import check_fixation, fixation
from ..trials.records import TapTable, join_plans, plan_trials
from ..trials.run import run_trials
from .held_out import Parts, decision_error
from .online import Learner
from .threshold import check_cost


def episode_cost(
    sensor: TouchSensor,
    engine: Engine,
    what: int,
    fixation_index: int,
    theta: float,
    cost_error: float,
    *,
    wrong: bool = False,
    play: PlaySettings = PlaySettings(),
    chance: Iterator[float] | None = None,
) -> float:
    """Cost of one episode on any rig.

    Args:
        sensor: The rig, before the object.
        engine: How beliefs are computed.
        what: The object that is there.
        fixation_index: Where class to aim for.
        theta: Threshold on the what belief.
        cost_error: Taps that a unit of error is worth.
        wrong: Whether errors are P(wrong) even where objects have sizes.
        play: Threshold for a move and deadline; the border is that of the engine.
        chance: As in `episode.perceive`.

    Raises:
        InputError: An argument is out of range.
    """
    grid = engine.model.grid
    check_cost(cost_error)
    policy = fixation(check_fixation(fixation_index, grid.L), play.theta_x)
    episode = perceive(sensor, engine, theta, policy, play.deadline, chance=chance)
    return float(cost_error * decision_error(grid, episode.what, what, wrong) + episode.taps)


def trial_costs(
    table: TapTable,
    grid: ClassGrid,
    fixations: ArrayLike,
    thresholds: ArrayLike,
    cost_error: float,
    trials: int,
    *,
    wrong: bool = False,
    play: PlaySettings = PlaySettings(),
    seed: int = 0,
    first_stream: int = 0,
) -> NDArray[np.float64]:
    """Costs of trials with every arm, with the same starts and random numbers.

    Args:
        table: Taps that did not train the model.
        grid: The classes.
        fixations: Fixation point of each arm, shape (A,).
        thresholds: Its threshold, shape (A,).
        cost_error: Taps that a unit of error is worth.
        trials: How many, n.
        wrong: Whether errors are P(wrong) even where objects have sizes.
        play: As in `run_trials`.
        seed: Random seed of starts and draws of taps.
        first_stream: Random stream of the first trial; the others follow.

    Returns:
        Shape (A, n).

    Raises:
        InputError: An argument is out of range.
    """
    check_cost(cost_error)
    points, point = np.unique(np.asarray(fixations), return_inverse=True)
    theta, h = np.unique(np.asarray(thresholds, dtype=np.float64), return_inverse=True)
    check_fixation(int(points[0]), grid.L)
    check_fixation(int(points[-1]), grid.L)
    plan = plan_trials(table.pool, trials, seed, first_stream=first_stream)
    plan = join_plans([plan._replace(fixation=np.full(trials, l)) for l in points])
    played = run_trials(table, plan, theta, play=play, seed=seed)
    cost = cost_error * decision_error(grid, played.what, plan.what[:, np.newaxis], wrong) + played.taps
    return cost.reshape(len(points), trials, len(theta))[point, :, h]


def held_out_costs(
    parts: Parts, learner: Learner, episodes: int, cost_error: float, **options: Any
) -> NDArray[np.float64]:
    """Costs of a learner's next episodes with every arm, on held-out taps of each part in turn.

    Args:
        parts: Training taps and models that have not seen them.
        learner: Before the episodes.
        episodes: How many.
        cost_error: Taps that a unit of error is worth.
        **options: As of `trial_costs`.

    Returns:
        Shape (A, episodes).

    Raises:
        InputError: An argument is out of range.
    """
    number = learner.episodes + np.arange(episodes)
    costs = np.empty((len(learner.theta), episodes))
    for f, part in enumerate(parts.parts):
        own = number[number % len(parts.parts) == f]
        if len(own):
            costs[:, own - learner.episodes] = trial_costs(
                part.table,
                parts.grid,
                learner.fixation,
                learner.theta,
                cost_error,
                len(own),
                first_stream=int(own[0]) // len(parts.parts),
                **options,
            )
    return costs
