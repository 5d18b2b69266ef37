"""Cases played as whole Monte Carlo trials, which draw taps and moves themselves.

Taps are scripted by a pool in which the random numbers of one stream find them in order.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...inference.trials.records import TapTable, TrialPlan, Trials, trial_uniforms
from ...inference.trials.run import run_trials
from ...models.grid import TapPool
from ...models.settings import PlaySettings
from .answers import Answer
from .case import Case
from .comparison import Difference
from .routes import case_model
from .tolerance import Tolerance, allowed_decisions, allowed_moves

_ROOM = 1 << 16
_STREAMS = 50


def trial_difference(case: Case, expected: Sequence[Answer], tolerances: dict[str, Tolerance]) -> Difference | None:
    """What a trial decides otherwise than the answers say; `None` also where no trial is like the case.

    Args:
        case: The case.
        expected: Its right answers.
        tolerances: Of the case.
    """
    if case.strategy or not _own_moves(case, expected, tolerances):
        return None
    script = _script(case)
    if script is None:
        return None
    order, stream = script
    with np.errstate(divide="ignore"):
        log_prior = np.log(case.prior)
    shape = case.prior.shape
    nearest = np.tile(np.arange(shape[0])[:, np.newaxis], shape[1])
    pool = TapPool(order, np.zeros((1, *shape), np.intp), np.full((1, *shape), _ROOM), nearest[np.newaxis])
    model = case_model(case)
    table = TapTable(model.log_likelihood(case.taps), pool, log_prior, given_trained=model.trained)
    plan = TrialPlan(*(np.array([value]) for value in (0, 0, case.fixation, stream, 0)))
    thresholds = np.array(case.thresholds)
    trials = run_trials(
        table,
        plan,
        thresholds,
        play=PlaySettings(theta_x=case.theta_x, border=case.border, deadline=len(case.taps)),
        workers=1,
    )
    return _differs(case, expected, trials, tolerances)


def _own_moves(case: Case, expected: Sequence[Answer], tolerances: dict[str, Tolerance]) -> bool:
    """Whether the moves of the case are those that a trial makes, and every tap has its answer."""
    if len(expected) != len(case.taps) or any(answer.error for answer in expected):
        return False
    made = zip(expected[:-1], case.moves[1:].tolist(), strict=True)
    return all(allowed_moves(case, answer, tolerances["where"]) == {move} for answer, move in made)


def _script(case: Case) -> tuple[NDArray[np.intp], int] | None:
    """Places of the taps in the pool, and the stream whose numbers find them."""
    T = len(case.taps)
    for stream in range(_STREAMS):
        number = (trial_uniforms(0, stream, T) * _ROOM).astype(np.intp)
        if len(np.unique(number)) == T:
            order = np.zeros(_ROOM, dtype=np.intp)
            order[number] = np.arange(T)
            return order, stream
    return None


def _differs(
    case: Case, expected: Sequence[Answer], trials: Trials, tolerances: dict[str, Tolerance]
) -> Difference | None:
    last = len(expected)
    for h, theta in enumerate(case.thresholds):
        tap, what, where = (int(values[0, h]) for values in (trials.taps, trials.what, trials.where))
        stopped = bool(trials.stopped[0, h])
        passed = [allowed_decisions(case, answer, tolerances["what"])[h] for answer in expected]
        right = expected[tap - 1].values
        near = {name: _near(right[name], tolerances[name]) for name in ("where", "what")}
        fine = (
            all(-1 in allowed for allowed in passed[: tap - 1])
            and (what if stopped else -1) in passed[tap - 1]
            and (stopped or tap == last)
            and what in near["what"]
            and where in near["where"]
            and abs(trials.belief[0, h] - right["what"][what]) <= tolerances["what"].absolute
        )
        if not fine:
            said = f"object {what} at place {where} after {tap} taps with belief {trials.belief[0, h]:.17g}"
            return Difference(tap, "decisions", f"at threshold {theta:g} a whole trial decides {said}")
    return None


def _near(marginal: NDArray[np.float64], tolerance: Tolerance) -> set[int]:
    return set(np.flatnonzero(marginal >= marginal.max() - tolerance.absolute).tolist())
