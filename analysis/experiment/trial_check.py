"""Monte Carlo trials compared with the same trials played tap by tap by the reference equations."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...hardware.replay import ReplayRig
from ...inference.engines.engine import Engine
from ...inference.episode import steps
from ...inference.moves.control import fixation
from ...inference.raw import Decision, LabelledTaps, RawFilter
from ...inference.reference import Border
from ...inference.trials.records import TapTable, TrialPlan, Trials, trial_uniforms
from ...inference.trials.run import THRESHOLDS, run_trials
from ...models.settings import PlaySettings
from ...models.taps import TapSet

DEVICES = ("cpu", "xla-cpu")
RAW = "raw taps"


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
    engine: Engine,
    table: TapTable,
    taps: TapSet,
    plan: TrialPlan,
    border: Border,
    deadline: int,
    near_tie: float,
    raw: RawFilter | None = None,
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
        raw: Plays them too, if there is one.

    Returns:
        The differences by device; those of `raw` as `RAW`.
    """
    played = {
        device: run_trials(
            table, plan, THRESHOLDS, play=PlaySettings(theta_x=0.0, border=border, deadline=deadline), device=device
        )
        for device in DEVICES
    }
    where_of, what_of = taps.indices(engine.model.grid)
    found = {name: TrialDifferences(np.zeros((2, 0)), 0, 0) for name in (*DEVICES, *([RAW] if raw else []))}
    for i in range(len(plan.where)):
        where, what, target, stream, number = (int(column[i]) for column in plan)
        session = table.recorded_session(number)
        rig = ReplayRig(taps, engine.model.grid, where, what, _draws(stream, deadline), session=session)
        expected, margins = _play(engine, rig, target, deadline)
        answers = {device: _decisions(trials, i) for device, trials in played.items()}
        if raw is not None:
            draws, inside = _draws(stream, deadline), True if session is None else taps.session == session
            labelled = LabelledTaps(taps.taps, np.where(inside, where_of, -1), what_of)
            answers[RAW] = raw.trial(labelled, (where, what), target, draws, THRESHOLDS, deadline)
        for name, actual in answers.items():
            found[name] = _compare(found[name], expected, actual, margins, near_tie)
    return found


def _draws(stream: int, deadline: int) -> Iterator[float]:
    """The random numbers that pick the taps of a trial, on every route."""
    return iter(trial_uniforms(0, stream, deadline).tolist())


def _play(engine: Engine, rig: ReplayRig, target: int, deadline: int) -> tuple[list[Decision], list[float]]:
    """The decisions at `THRESHOLDS`, and after each tap how far the choices made then were from others."""
    decisions: list[Decision] = []
    margins: list[float] = []
    for step in steps(rig, engine, 1.0, fixation(target), deadline):
        belief = float(step.what_marginal.max())
        undecided = np.abs(belief - np.array(THRESHOLDS[len(decisions) :]))
        margins.append(min(belief_gap(step.where_marginal), belief_gap(step.what_marginal), *undecided))
        for theta in THRESHOLDS[len(decisions) :]:
            stopped = belief > theta and not step.no_class_left
            if not (stopped or step.no_class_left) and step.number < deadline:
                break
            ended = rig.where_index, stopped, step.no_class_left
            decisions.append(Decision(step.number, step.what, step.where, *ended, belief))
        if len(decisions) == len(THRESHOLDS):
            break
    return decisions, margins


def _decisions(trials: Trials, i: int) -> list[Decision]:
    """Those of trial i."""
    return [Decision(*(getattr(trials, name)[i, h] for name in Decision._fields)) for h in range(len(THRESHOLDS))]


def _compare(
    found: TrialDifferences,
    expected: list[Decision],
    decisions: list[Decision],
    margins: list[float],
    near_tie: float,
) -> TrialDifferences:
    beliefs, differing, near_ties = [], found.decisions, found.near_ties
    for decision, actual in zip(expected, decisions, strict=True):
        same = actual[:-1] == decision[:-1]
        if min(margins[: max(decision.taps, int(actual.taps))]) < near_tie:
            near_ties += not same
        elif same:
            beliefs.append((decision.belief, actual.belief))
        else:
            differing += 1
    both = np.array(beliefs, dtype=np.float64).reshape(-1, 2).T
    return TrialDifferences(np.concatenate([found.belief, both], axis=1), differing, near_ties)


def belief_gap(marginal: NDArray[np.float64]) -> float:
    """Distance between the two largest values; infinite where there is one."""
    largest = np.sort(marginal)[::-1]
    return float(largest[0] - largest[1]) if len(largest) > 1 else np.inf
