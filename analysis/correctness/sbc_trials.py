"""Decisions of whole Monte Carlo trials on pools so large that taps hardly repeat; see `sbc`.

Trials draw from a pool of stored taps with replacement, and the proofs speak of fresh ones. So every thousand trials
have a pool of their own, of a thousand taps per class and more where active trials go, so that a trial hardly meets a
tap twice and seldom one that another trial met.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...hardware.simulator.model_rig import bin_tables
from ...inference.moves.control import default_fixation
from ...inference.trials.records import TapTable, TrialPlan, Trials, plan_trials
from ...inference.trials.run import run_trials
from ...models.grid import tap_pool
from ...models.settings import PlaySettings
from ..stats.uniformity import JudgedBeliefs
from .sbc_arrays import draw
from .sbc_chain import PASSIVE, Checkpoints, World

AT_ONCE = 1000  # trials on one pool
_PER_CLASS, _AT_FIXATION = 1000, 8000  # taps of a pool


def trial_decisions(
    name: str,
    world: World,
    policy: str,
    trials: int,
    moments: Checkpoints,
    generator: np.random.Generator,
    progress: Callable[[int], None] | None = None,
) -> list[JudgedBeliefs]:
    """Decisions about the object at each moment; arguments as of `engine_beliefs`, with a device for `name`."""
    parts: list[list[JudgedBeliefs]] = []
    for first in range(0, trials, AT_ONCE):
        n = min(AT_ONCE, trials - first)
        table = _fresh_table(world, policy, generator)
        seed = int(generator.integers(2**62))
        plan = plan_trials(table.pool, n, seed, default_fixation(world.truth.grid.L))
        parts.append([_decided(played, plan) for played in _played(name, world, policy, table, plan, moments, seed)])
        if progress is not None:
            progress(n)
    return [_joined(at) for at in zip(*parts, strict=True)]


def _played(
    name: str, world: World, policy: str, table: TapTable, plan: TrialPlan, moments: Checkpoints, seed: int
) -> list[Trials]:
    """The same trials to every moment, each with one threshold."""

    def run(thresholds: tuple[float, ...], deadline: int) -> Trials:
        return run_trials(
            table,
            plan,
            thresholds,
            play=PlaySettings(theta_x=1.0 if policy == PASSIVE else 0.0, border=world.border, deadline=deadline),
            seed=seed,
            device=name,
        )

    return [*(run((1.0,), n) for n in moments.taps), *(run((theta,), moments.deadline) for theta in moments.thetas)]


def _fresh_table(world: World, policy: str, generator: np.random.Generator) -> TapTable:
    """Taps drawn from the truth as the filter sees them."""
    truth, (L, M) = world.truth, world.truth.grid.shape
    count = np.full((L, M), _PER_CLASS)
    if policy != PASSIVE:
        count[default_fixation(L)] = _AT_FIXATION
    where, what = (np.repeat(index.ravel(), count.ravel()) for index in np.indices((L, M)))
    tables = bin_tables(truth.probabilities, truth.edges, (L, M))
    taps = draw(tables, where, what, truth.preprocessing.samples, generator)
    believed = world.believed
    return TapTable(
        believed.log_likelihood(taps), tap_pool(where, what, (L, M)), believed.log_prior, believed.saturation
    )


def _decided(played: Trials, plan: TrialPlan) -> JudgedBeliefs:
    """Of trials at one threshold."""
    none: NDArray[np.float64] = np.empty(0)
    return JudgedBeliefs(none, none, np.minimum(played.belief[:, 0], 1.0), played.what[:, 0] == plan.what)


def _joined(parts: tuple[JudgedBeliefs, ...]) -> JudgedBeliefs:
    return JudgedBeliefs(*(np.concatenate(column) for column in zip(*parts, strict=True)))
