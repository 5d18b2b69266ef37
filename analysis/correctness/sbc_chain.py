"""Simulated episodes that satisfy every assumption, perceived by an engine; see `sbc`.

Class and place are drawn from the prior, every tap anew from the histograms of the class where the sensor stands, and
moves end at the ends of the range.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...hardware.simulator.model_rig import ModelRig
from ...inference.engines.engine import Engine, make_engine
from ...inference.episode import steps
from ...inference.moves.control import MovePolicy, default_fixation, fixation, passive
from ...inference.reference import Border
from ...models.measurement.histogram import HistogramModel
from ...models.measurement.model import TapModel

PASSIVE, ACTIVE = "passive", "active"


class World(NamedTuple):
    """What is true, and what is believed of it.

    Attributes:
        truth: Taps are drawn from its histograms.
        believed: The measurement model of the filter; the truth, unless an error is planted.
        border: The filter's reading of Eq. 9; the sensor stops at the ends of its range, which is `clamp`.
    """

    truth: HistogramModel
    believed: TapModel
    border: Border


class Checkpoints(NamedTuple):
    """When beliefs are looked at.

    Attributes:
        taps: After so many taps, increasing.
        thetas: When the belief in an object first exceeds these thresholds, increasing.
        deadline: At this tap the latest, which is part of the stopping rule.
    """

    taps: tuple[int, ...] = (1, 2, 4, 8)
    thetas: tuple[float, ...] = (0.8, 0.95)
    deadline: int = 100

    @property
    def names(self) -> list[str]:
        """In words."""
        fixed = [f"{n} tap{'s' if n > 1 else ''}" for n in self.taps]
        return [*fixed, *(f"theta {theta:g}" for theta in self.thetas)]

    def reached(self, number: int, belief: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which moments tap `number` is at or past, for the joint beliefs (..., L, M) after it; shape (..., W)."""
        best = belief.sum(axis=-2).max(axis=-1)[..., np.newaxis]
        fixed = np.broadcast_to(number >= np.array(self.taps), (*best.shape[:-1], len(self.taps)))
        return np.concatenate([fixed, (best > np.array(self.thetas)) | (number == self.deadline)], axis=-1)


class Beliefs(NamedTuple):
    """What n episodes believe at W moments.

    Attributes:
        belief: Joint belief, shape (n, W, L, M).
        where: Class in which the sensor stands then, shape (n, W).
        what: Class of the object, shape (n,).
        taps: Taps made by then, shape (n, W).
    """

    belief: NDArray[np.float64]
    where: NDArray[np.intp]
    what: NDArray[np.intp]
    taps: NDArray[np.intp]


def empty_beliefs(trials: int, moments: Checkpoints, shape: tuple[int, int]) -> Beliefs:
    """Room for the beliefs of so many trials over (L, M) classes."""
    W = len(moments.names)
    return Beliefs(
        np.zeros((trials, W, *shape)),
        np.zeros((trials, W), dtype=np.intp),
        np.zeros(trials, dtype=np.intp),
        np.zeros((trials, W), dtype=np.intp),
    )


def engine_beliefs(
    name: str,
    world: World,
    policy: str,
    trials: int,
    moments: Checkpoints,
    generator: np.random.Generator,
    progress: Callable[[int], None] | None = None,
) -> Beliefs:
    """Episodes one after the other, with the rig, the engine and the loop that perceive on a bench.

    Args:
        name: Of the engine, see `make_engine`.
        world: What is true and believed.
        policy: `PASSIVE` or `ACTIVE`, which goes to the middle of the range.
        trials: How many.
        moments: When beliefs are noted.
        generator: Of all random numbers.
        progress: Called after every trial.
    """
    truth, grid = world.truth, world.truth.grid
    engine = make_engine(name, world.believed, world.border)
    move = passive() if policy == PASSIVE else fixation(default_fixation(grid.L))
    found = empty_beliefs(trials, moments, grid.shape)
    for i in range(trials):
        where, what = int(generator.integers(grid.L)), int(generator.integers(grid.M))
        rig = ModelRig(grid, truth.probabilities, truth.edges, truth.preprocessing, where, what, generator)
        found.what[i] = what
        _follow(rig, engine, move, moments, found, i)
        if progress is not None:
            progress(1)
    return found


def _follow(rig: ModelRig, engine: Engine, move: MovePolicy, moments: Checkpoints, found: Beliefs, i: int) -> None:
    """Plays episode `i` until all moments are past, and notes the beliefs at each."""
    noted = np.zeros(found.where.shape[1], dtype=bool)
    for step in steps(rig, engine, 1.0, move, moments.deadline):
        belief = np.exp(step.log_belief)
        new = moments.reached(step.number, belief) & ~noted
        found.belief[i, new], found.where[i, new], found.taps[i, new] = belief, rig.where_index, step.number
        noted |= new
        if noted.all():
            return
