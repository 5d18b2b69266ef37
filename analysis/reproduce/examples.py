"""Single episodes for the figures: evolving beliefs (Fig. 4) and trajectories (Fig. 6)."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...hardware.named_rigs import Truth
from ...hardware.replay import ReplayRig
from ...inference.engines.engine import Engine
from ...inference.episode import Episode, perceive
from ...inference.filter import fold
from ...inference.moves.control import fixation, passive
from ...inference.trials.records import checked_plan, plan_trials, trial_uniforms
from ...inference.trials.run import LoopPlayer, make_rule, play_plan
from ..experiment.settings import ExperimentSettings
from ..experiment.study import Study
from ..live.viewing import example
from ..page.figure_episodes import BeliefCase
from ..page.page import Embedded

_CANDIDATES = 40
_CASE_TAPS = 20
_EXAMPLE_TAPS = 3
TRAJECTORIES = 100


class Trajectories(NamedTuple):
    """Where the sensor stood at each tap, -1 after the decision; where indices, shape (trials, taps)."""

    passive: NDArray[np.int64]
    active: NDArray[np.int64]


def belief_cases(study: Study, engine: Engine, settings: ExperimentSettings) -> tuple[BeliefCase, BeliefCase]:
    """One clear and one ambiguous passive sequence of 20 taps.

    Clear is the one in which the right class leads for good the earliest, ties go to the surer end; ambiguous the
    one in which the runner-up is believed in most, on average over the taps.
    """
    cases, prior = [], fold(np.exp(engine.model.log_prior), engine.model.grid.M)
    for where, what, rig in _rigs(study, _CANDIDATES, settings.seed, _CASE_TAPS):
        episode = perceive(rig, engine, 1.0, passive(), deadline=_CASE_TAPS)
        cases.append(BeliefCase(np.exp(episode.log_beliefs), prior, where, what))
    return max(cases, key=_clarity), max(cases, key=_ambiguity)


def trajectories(study: Study, settings: ExperimentSettings, fixation_index: int) -> Trajectories:
    """A hundred trials each, passive and active, from the same random starts up to their decisions."""
    table = study.table
    rule = make_rule(settings.thresholds[settings.shown], settings.play, settings.seed)
    player = LoopPlayer(table, rule)
    plan = checked_plan(plan_trials(table.pool, TRAJECTORIES, settings.seed, fixation_index), table.pool)

    def positions(theta_x: float) -> NDArray[np.int64]:
        at_taps = []
        for tap in range(1, settings.play.deadline + 1):  # trials tell where they end, so they end at each tap
            cut = play_plan(player.under(rule._replace(theta_x=theta_x, deadline=tap)), plan, 1, 1)
            there = cut.taps[:, 0] == tap
            if not there.any():
                break
            at_taps.append(np.where(there, cut.true_where[:, 0], -1))
        return np.stack(at_taps, axis=1)

    return Trajectories(positions(1.0), positions(settings.play.theta_x))


def example_episode(study: Study, engine: Engine, settings: ExperimentSettings, fixation_index: int | None) -> Embedded:
    """The first of a hundred trials with three taps and a move, to be played; else the first one.

    Without a fixation point it is passive, and needs no move.
    """
    theta, deadline, grid = settings.thresholds[settings.shown], settings.play.deadline, study.model.grid
    still = fixation_index is None
    move = passive() if still else fixation(fixation_index, settings.play.theta_x)

    def play(n: int) -> Iterator[tuple[Episode, Truth]]:
        for _, what, rig in _rigs(study, n, settings.seed, deadline):
            episode = perceive(rig, engine, theta, move, deadline)
            yield episode, Truth(grid.what_name[what], float(grid.where_value[rig.where_index]))

    telling = (one for one in play(TRAJECTORIES) if one[0].taps >= _EXAMPLE_TAPS and (still or one[0].realised.any()))
    episode, truth = next(telling, None) or next(play(1))
    kind = "passive" if still else "active"
    caption = (
        f"The first {kind} trial on test taps of {study.name} with at least {_EXAMPLE_TAPS} taps"
        f"{'' if still else ' and a move'} (the first of all, if there is none), at threshold {theta:g}. It was not "
        "chosen by its result. Play it, or move through it with the arrow keys."
    )
    return Embedded(example(episode, f"test taps of {study.name}, {kind} perception", truth), caption)


def _rigs(study: Study, n: int, seed: int, taps: int) -> Iterator[tuple[int, int, ReplayRig]]:
    """Position, object and rig of trials of at most so many taps."""
    plan = plan_trials(study.table.pool, n, seed)
    for where, what, _, stream, session in zip(*(column.tolist() for column in plan), strict=True):
        chance = iter(trial_uniforms(seed, stream, taps).tolist())
        recorded = study.table.recorded_session(session)
        yield where, what, ReplayRig(study.test, study.model.grid, where, what, chance, session=recorded)


def _clarity(case: BeliefCase) -> tuple[int, float]:
    leaders = _leaders(case)
    true = case.where * case.beliefs.shape[2] + case.what
    wrong = np.flatnonzero(leaders != true)
    return -(int(wrong[-1]) + 1 if len(wrong) else 0), float(case.beliefs[-1].ravel()[true])


def _ambiguity(case: BeliefCase) -> float:
    beliefs = np.sort(case.beliefs.reshape(len(case.beliefs), -1), axis=1)
    return float(beliefs[:, -2:].min(axis=1).mean()) if beliefs.shape[1] > 1 else 0.0


def _leaders(case: BeliefCase) -> NDArray[np.intp]:
    return case.beliefs.reshape(len(case.beliefs), -1).argmax(axis=1)
