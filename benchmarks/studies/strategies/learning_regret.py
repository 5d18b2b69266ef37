"""Regret of learners of fixation point and threshold against the best pair from the start.

The regret after n episodes is the sum of the expected costs of the chosen arms minus n times the least expected cost.
Expectations are means over many trials separate from the episodes. The arm that is best in one half of these trials is
priced by the other half, so that the least cost is not biased by selection.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.inference.trials.records import TapTable
from solidtouch.inference.tuning.costs import trial_costs
from solidtouch.inference.tuning.online import METHODS, Learner, learn, recommended
from solidtouch.models.grid import ClassGrid

type Floats = NDArray[np.float64]
_APART = 1 << 40  # random streams of the trials that price arms


class Prices(NamedTuple):
    """What arms cost in expectation.

    Attributes:
        fixation: Of each arm, shape (A,).
        theta: Of each arm, shape (A,).
        mean: Mean cost over all trials, shape (A,).
        least: That of the best arm, without its luck.
    """

    fixation: NDArray[np.int64]
    theta: Floats
    mean: Floats
    least: float

    def of(self, fixation: int, theta: float) -> float:
        """The mean cost of a pair."""
        return float(self.mean[(self.fixation == fixation) & np.isclose(self.theta, theta)][0])


class Lost(NamedTuple):
    """One learner on one data set.

    Attributes:
        regret: After 1, 2, ... episodes, in taps, shape (T,).
        kept: Mean cost of the arm that it recommends in the end, less the least.
    """

    regret: NDArray[np.floating]
    kept: float


def arm_prices(
    table: TapTable, grid: ClassGrid, learner: Learner, cost_error: float, trials: int, **options: Any
) -> Prices:
    """Expected costs of a learner's arms.

    Args:
        table: Taps that did not train the model.
        grid: The classes.
        learner: Whose arms these are.
        cost_error: Taps that a unit of error is worth.
        trials: Of each fixation point, an even number.
        **options: As of `trial_costs`.
    """
    costs = trial_costs(
        table, grid, learner.fixation, learner.theta, cost_error, trials, first_stream=_APART, **options
    )
    halves = costs.reshape(len(costs), 2, -1).mean(axis=-1)
    first, second = halves.argmin(axis=0)
    return Prices(learner.fixation, learner.theta, costs.mean(axis=1), float(halves[first, 1] + halves[second, 0]) / 2)


def regrets(
    table: TapTable,
    grid: ClassGrid,
    fixations: Sequence[int],
    thresholds: Sequence[float],
    cost_error: float,
    *,
    episodes: int,
    trials: int,
    seed: int,
    **options: Any,
) -> tuple[Mapping[str, Lost], Prices]:
    """What each learner loses on the same episodes, beside an arm drawn anew for each, named `random`.

    Args:
        table: Taps that did not train the model.
        grid: The classes.
        fixations: Points to learn from.
        thresholds: Thresholds to learn from.
        cost_error: Taps that a unit of error is worth.
        episodes: How many, T.
        trials: By which arms are priced.
        seed: Of learners and episodes.
        **options: As of `trial_costs`.
    """
    new = Learner.new(METHODS[0], fixations, thresholds, seed)
    prices = arm_prices(table, grid, new, cost_error, trials, seed=seed, **options)
    costs = trial_costs(table, grid, new.fixation, new.theta, cost_error, episodes, seed=seed, **options)
    lost = {}
    for method in METHODS:
        arms: list[int] = []
        start = Learner.new(method, fixations, thresholds, seed)
        after = learn(start, episodes, lambda t, a: float(costs[a, t]), lambda _, arm, paid, own=arms: own.append(arm))  # noqa: ARG005
        kept = float(prices.mean[recommended(after)]) - prices.least
        lost[method] = Lost(np.cumsum(prices.mean[arms] - prices.least), kept)
    any_arm = float(prices.mean.mean()) - prices.least
    lost["random"] = Lost(any_arm * np.arange(1, episodes + 1), any_arm)
    return lost, prices
