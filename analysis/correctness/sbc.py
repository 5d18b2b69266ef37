"""Simulation-based calibration of the whole chain: prior, taps, updates, moves, stopping, decisions.

Episodes are drawn in a world that fulfils every assumption (preset `model`: histograms, power none, a sensor that stops
at the ends of its range). There the posterior is exact for any moves and any stopping rule, as both depend on past taps
only. So the truth must rank uniformly in the beliefs, and decisions must be right as often as believed, after a fixed
number of taps and at stopping; what is not so is an error of the software. `stats.uniformity` says how that is judged.
Reference: Talts et al., "Validating Bayesian inference algorithms with simulation-based calibration" (2018).
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...inference.reference import Border
from ...models import seeds
from ...models.errors import InputError
from ...models.measurement.histogram import HistogramModel
from ...models.measurement.model import TapModel
from ..stats.uniformity import Factor, JudgedBeliefs, error_factor, judge, p_values, rejected
from .sbc_chain import ACTIVE, PASSIVE, Beliefs, Checkpoints, World, engine_beliefs

ENGINES = ("numpy", "numpyro", "filter")
DEVICES = ("cpu", "xla-cpu")
ARRAYS = "arrays"
ROUTES = (*ENGINES, ARRAYS, *DEVICES)
"""Engines tap by tap, the array code of the Monte Carlo tap by tap, and its whole trials on two devices."""

POLICIES = (PASSIVE, ACTIVE)
LEVEL = 0.01


class CalibrationRow(NamedTuple):
    """What was found of one quantity at one moment.

    Attributes:
        route: One of `ROUTES`.
        policy: One of `POLICIES`.
        moment: When, see `Checkpoints.names`.
        quantity: `what`, `where` (at the place of the last tap) or `joint`.
        n: Trials.
        p: P-value of each test, see `stats.uniformity`.
        factor: Wrong decisions over those announced.
    """

    route: str
    policy: str
    moment: str
    quantity: str
    n: int
    p: Mapping[str, float]
    factor: Factor


class Calibration(NamedTuple):
    """The result for some routes.

    Attributes:
        rows: All that was looked at.
        level: Probability that right beliefs fail, at most, over all tests together.
    """

    rows: tuple[CalibrationRow, ...]
    level: float

    @property
    def tests(self) -> int:
        """How many p-values there are."""
        return sum(len(row.p) for row in self.rows)

    @property
    def least(self) -> float:
        """The smallest p-value, times the number of tests."""
        return min(1.0, self.tests * min(p for row in self.rows for p in row.p.values()))

    @property
    def failed(self) -> list[tuple[CalibrationRow, str]]:
        """Rows and tests that fail, by Holm's procedure over all tests."""
        pairs = [(row, test) for row in self.rows for test in row.p]
        found = rejected([row.p[test] for row, test in pairs], self.level)
        return [pair for pair, fails in zip(pairs, found, strict=True) if fails]

    @property
    def passed(self) -> bool:
        """Whether no test fails."""
        return not self.failed

    def part(self, **chosen: str) -> "Calibration":
        """The rows with these values, such as `route="numpy"`, judged by themselves."""
        rows = [row for row in self.rows if all(getattr(row, name) == value for name, value in chosen.items())]
        return Calibration(tuple(rows), self.level)


def calibrate(
    truth: HistogramModel,
    trials: Mapping[str, int],
    *,
    believed: TapModel | None = None,
    border: Border = "clamp",
    moments: Checkpoints | None = None,
    level: float = LEVEL,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
) -> Calibration:
    """Whether beliefs are exact in a world drawn from a model.

    Args:
        truth: Taps are drawn from its histograms, see `sources.right_model`.
        trials: How many, of each policy, by route.
        believed: The model of the filter; `None` for the truth, which then has power none. Another plants an error.
        border: The filter's reading of Eq. 9; any but `clamp` is an error.
        moments: When beliefs are looked at; `None` for the default.
        level: Of all tests together.
        seed: Of all random numbers.
        progress: Called with the number of trials finished since the last call; there are twice the sum of `trials`.

    Raises:
        InputError: There is no such route, no trial, a class that was not trained, or the level is out of range.
    """
    if not truth.trained.all():
        raise InputError("Classes are drawn from the whole grid, and some of this model were not trained.")
    unknown = sorted(set(trials) - set(ROUTES))
    if unknown or not trials:
        raise InputError(f"Routes are {', '.join(ROUTES)}, got {', '.join(unknown) or 'none'}.")
    if min(trials.values()) < 1 or not 0 < level < 1:
        raise InputError(f"Calibration needs a trial and a level between 0 and 1, got {min(trials.values())}, {level}.")
    world, moments = World(truth, truth if believed is None else believed, border), moments or Checkpoints()
    rows: list[CalibrationRow] = []
    for route, n in trials.items():
        for policy in POLICIES:
            key = ROUTES.index(route), POLICIES.index(policy)
            chance = seeds.generator(seed, seeds.Purpose.CALIBRATION, *key)
            seen = judged(route, world, policy, n, moments, chance, progress)
            rows += [
                CalibrationRow(route, policy, moment, quantity, n, p_values(one), error_factor(one))
                for (moment, quantity), one in seen.items()
            ]
    return Calibration(tuple(rows), level)


def judged(
    route: str,
    world: World,
    policy: str,
    trials: int,
    moments: Checkpoints,
    generator: np.random.Generator,
    progress: Callable[[int], None] | None = None,
) -> dict[tuple[str, str], JudgedBeliefs]:
    """What the episodes of one route and policy say of the truth, by moment and quantity."""
    if route in DEVICES:
        from .sbc_trials import trial_decisions  # noqa: PLC0415 - JAX takes half a second to import

        decided = trial_decisions(route, world, policy, trials, moments, generator, progress)
        return {(moment, "what"): one for moment, one in zip(moments.names, decided, strict=True)}
    if route == ARRAYS:
        from .sbc_arrays import array_beliefs  # noqa: PLC0415

        beliefs = array_beliefs(world, policy, trials, moments, generator, progress)
    else:
        beliefs = engine_beliefs(route, world, policy, trials, moments, generator, progress)
    return {
        (moment, quantity): judge(belief, true, generator)
        for w, moment in enumerate(moments.names)
        for quantity, (belief, true) in quantities(beliefs, w).items()
    }


def quantities(beliefs: Beliefs, w: int) -> dict[str, tuple[NDArray[np.float64], NDArray[np.intp]]]:
    """Beliefs (n, C) and true classes (n,) of what, where and both at moment `w`."""
    joint, where, what = beliefs.belief[:, w], beliefs.where[:, w], beliefs.what
    M = joint.shape[2]
    return {
        "what": (joint.sum(axis=1), what),
        "where": (joint.sum(axis=2), where),
        "joint": (joint.reshape(len(joint), -1), where * M + what),
    }
