"""Trials of the Monte Carlo beside the same trials played tap by tap with the reference equations."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..hardware.replay import ReplayRig
from ..inference.control import fixation
from ..inference.engine import Engine
from ..inference.episode import steps
from ..inference.montecarlo import THRESHOLDS, Trials, run_trials
from ..inference.reference import Border
from ..inference.trial_plan import TapTable, TrialPlan, trial_uniforms
from ..models.taps import TapSet

DEVICES = ("cpu", "xla-cpu")


class TrialDifferences(NamedTuple):
    """What differs between trials and the reference.

    Attributes:
        belief: Beliefs at the decision in trials that agree otherwise, reference and trials, shape (2, n).
        decisions: Decisions that differ: in what, where, the number of taps or the place.
        near_ties: Differences not counted above, because some decision on the way was one between equals.
    """

    belief: NDArray[np.float64]
    decisions: int
    near_ties: int


def compare_trials(
    engine: Engine, table: TapTable, taps: TapSet, plan: TrialPlan, border: Border, deadline: int, near_tie: float
) -> dict[str, TrialDifferences]:
    """Plays trials with moves on every device that is always there, and beside `engine`.

    Args:
        engine: The reference.
        table: The test taps.
        taps: The same taps, as recorded.
        plan: The trials.
        border: Reading of Eq. 9.
        deadline: Taps of a trial.
        near_tie: Beliefs nearer to each other, or to a threshold, are equal.

    Returns:
        The differences by device.
    """
    played = {
        device: run_trials(table, plan, THRESHOLDS, theta_x=0.0, border=border, deadline=deadline, device=device)
        for device in DEVICES
    }
    found = {device: TrialDifferences(np.zeros((2, 0)), 0, 0) for device in DEVICES}
    for i in range(len(plan.where)):
        expected, margins = _play(engine, taps, TrialPlan(*(column[i : i + 1] for column in plan)), deadline)
        for device, trials in played.items():
            found[device] = _compare(found[device], expected, trials, i, margins, near_tie)
    return found


class _Decision(NamedTuple):
    """One trial at one threshold."""

    taps: int
    what: int
    where: int
    true_where: int
    stopped: bool
    no_class_left: bool
    belief: float


def _play(engine: Engine, taps: TapSet, plan: TrialPlan, deadline: int) -> tuple[list[_Decision], list[float]]:
    """The decisions at `THRESHOLDS`, and after each tap how far the choices made then were from others."""
    where, what, target, stream = (int(column[0]) for column in plan)
    rig = ReplayRig(taps, engine.model.grid, where, what, iter(trial_uniforms(0, stream, deadline).tolist()))
    decisions: list[_Decision] = []
    margins: list[float] = []
    for step in steps(rig, engine, 1.0, fixation(target), deadline):
        belief = float(step.what_marginal.max())
        undecided = np.abs(belief - np.array(THRESHOLDS[len(decisions) :]))
        margins.append(min(belief_gap(step.where_marginal), belief_gap(step.what_marginal), *undecided))
        for theta in THRESHOLDS[len(decisions) :]:
            stopped = belief > theta and not step.no_class_left
            if not (stopped or step.no_class_left) and step.number < deadline:
                break
            where_and_how = rig.where_index, stopped, step.no_class_left
            decisions.append(_Decision(step.number, step.what, step.where, *where_and_how, belief))
        if len(decisions) == len(THRESHOLDS):
            break
    return decisions, margins


def _compare(
    found: TrialDifferences, expected: list[_Decision], trials: Trials, i: int, margins: list[float], near_tie: float
) -> TrialDifferences:
    beliefs, decisions, near_ties = [], found.decisions, found.near_ties
    for h, decision in enumerate(expected):
        actual = _Decision(*(getattr(trials, name)[i, h] for name in _Decision._fields))
        same = actual[:-1] == decision[:-1]
        if min(margins[: max(decision.taps, int(actual.taps))]) < near_tie:
            near_ties += not same
        elif same:
            beliefs.append((decision.belief, actual.belief))
        else:
            decisions += 1
    both = np.array(beliefs, dtype=np.float64).reshape(-1, 2).T
    return TrialDifferences(np.concatenate([found.belief, both], axis=1), decisions, near_ties)


def belief_gap(marginal: NDArray[np.float64]) -> float:
    """Distance between the two largest values; infinite where there is one."""
    largest = np.sort(marginal)[::-1]
    return float(largest[0] - largest[1]) if len(largest) > 1 else np.inf
