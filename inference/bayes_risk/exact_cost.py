"""What any strategy with any stopping rule costs on a small problem: exact, over all sequences of symbols.

Strategies see beliefs only, so what led to a belief does not matter: equal beliefs after as many taps are merged and
their probabilities added.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ..information import shifted
from ..moves.control import MovePolicy
from ..moves.expected_gain import decision_loss, expected_steps
from ..stopping.stopping import DECIDE, GIVE_UP, GO_ON, Moment, StopRule, Watch
from .problem import Floats, Integers, RiskProblem, after_taps, merged


class Acts(NamedTuple):
    """What is done after a tap in n cases.

    Attributes:
        moves: Where classes to move by if one goes on, shape (n,).
        answer: `GO_ON`, `DECIDE` or `GIVE_UP`, shape (n,).
    """

    moves: Integers
    answer: NDArray[np.int8]


class Course(Protocol):
    """Moves and stops together; unlike a `MovePolicy` it may count taps."""

    def __call__(self, number: int, beliefs: Floats, chance: Floats) -> Acts:
        """What to do after tap `number`, counted from 1, with beliefs (n, L, M) and a random number (n,) for each."""
        ...


class Cost(NamedTuple):
    """Expected cost of a strategy and what it is made of.

    Attributes:
        total: All of it, in the unit of the loss.
        loss: Of the decisions, of giving up included.
        taps: Mean number of taps.
        steps: Mean number of where classes really moved.
        gave_up: Probability to give up.
    """

    total: float
    loss: float
    taps: float
    steps: float
    gave_up: float


def course(policy: MovePolicy, rule: StopRule, watch: Watch | None = None) -> Course:
    """A policy that stops by a rule; `watch` computes the gain that `lookahead` asks for."""

    def act(number: int, beliefs: Floats, chance: Floats) -> Acts:
        moves = np.asarray(policy(beliefs, chance), dtype=np.int64)
        gain = np.full(len(beliefs), np.nan) if watch is None else watch(beliefs, moves)["gain"]
        where_belief = beliefs.sum(axis=2).max(axis=1)
        moment = Moment(beliefs.sum(axis=1), where_belief, np.full(len(beliefs), number), gain)
        return Acts(moves, rule(moment))

    return act


def expected_cost(problem: RiskProblem, act: Course, chances: int = 1) -> Cost:
    """What a strategy costs, exactly.

    Who decides, decides for the object of least expected loss. At the last tap all who have not given up decide.

    Args:
        problem: With symbols and costs.
        act: What is done after each tap.
        chances: Into how many equal parts the random number is cut; the result is exact for strategies that do the same
            throughout each part.

    Raises:
        InputError: There is no chance, or a strategy gives up where that has no loss.
    """
    if chances < 1:
        raise InputError(f"A random number has at least one part, got {chances}.")
    belief, weight = _reached(problem, problem.prior[np.newaxis], np.ones(1))
    middles = (np.arange(chances) + 0.5) / chances
    loss = steps = gave_up = 0.0
    taps = 1.0
    for number in range(1, problem.most_taps + 1):
        belief, weight = np.repeat(belief, chances, axis=0), np.repeat(weight / chances, chances)
        moves, answer = act(number, belief, np.tile(middles, len(belief) // chances))
        if number == problem.most_taps:
            answer = np.where(answer == GO_ON, DECIDE, answer)
        loss += _loss_of(problem, belief, weight, answer)
        gave_up += float(weight[answer == GIVE_UP].sum())
        on = answer == GO_ON
        if not on.any():
            break
        belief, weight, moves = belief[on], weight[on], np.asarray(moves)[on, np.newaxis]
        taps += float(weight.sum())
        steps += float(weight @ expected_steps(belief, moves)[:, 0])
        belief, weight = _reached(problem, shifted(belief, moves, "clamp")[:, 0], weight)
    total = loss + problem.tap_cost * taps + problem.class_cost * steps
    return Cost(total, loss, taps, steps, gave_up)


def _reached(problem: RiskProblem, belief: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Beliefs after the next tap, equal ones merged, and their probabilities."""
    distinct, index = merged(belief)
    weight = np.bincount(index, weight)
    probability, after = after_taps(problem.channel, distinct)
    reached = probability > 0
    belief, index = merged(after[reached])
    return belief, np.bincount(index, (weight[:, np.newaxis] * probability)[reached])


def _loss_of(problem: RiskProblem, belief: Floats, weight: Floats, answer: NDArray[np.int8]) -> float:
    """Expected loss of those that stop."""
    M = problem.channel.shape[1]
    given_up = answer == GIVE_UP
    if given_up.any() and len(problem.loss) == M:
        raise InputError("A strategy gives up, and the problem has no loss for that.")
    decided = answer == DECIDE
    loss = float(weight[decided] @ decision_loss(belief[decided], problem.loss[:M]))
    return loss + (float(weight[given_up] @ decision_loss(belief[given_up], problem.loss[M:])) if given_up.any() else 0)


def sampled_costs(problem: RiskProblem, act: Course, trials: int, generator: np.random.Generator) -> Floats:
    """Cost of single trials of a strategy, drawn, shape (trials,); what `expected_cost` is the mean of."""
    (L, M, S), rows = problem.channel.shape, np.arange(trials)
    cell = generator.choice(L * M, size=trials, p=problem.prior.ravel())
    where, what = np.divmod(cell, M)
    cumulative = problem.channel.cumsum(axis=-1)
    belief = np.broadcast_to(problem.prior, (trials, L, M))
    cost = np.zeros(trials)
    for number in range(1, problem.most_taps + 1):
        drawn = generator.random(len(rows))[:, np.newaxis] * cumulative[where, what, -1:]
        symbol = (drawn >= cumulative[where, what]).sum(axis=1).clip(0, S - 1)
        joint = belief * np.moveaxis(problem.channel, -1, 0)[symbol]
        belief = joint / joint.sum(axis=(1, 2), keepdims=True)
        cost[rows] += problem.tap_cost
        moves, answer = act(number, belief, generator.random(len(rows)))
        if number == problem.most_taps:
            answer = np.where(answer == GO_ON, DECIDE, answer)
        for said, losses in ((DECIDE, problem.loss[:M]), (GIVE_UP, problem.loss[M:])):
            at = answer == said
            if at.any():
                chosen = (belief[at].sum(axis=1) @ losses.T).argmin(axis=1)
                cost[rows[at]] += losses[chosen, what[at]]
        on = answer == GO_ON
        rows, where, what, moves = rows[on], where[on], what[on], np.asarray(moves)[on]
        reached = np.clip(where + moves, 0, L - 1)
        cost[rows] += problem.class_cost * np.abs(reached - where)
        where, belief = reached, shifted(belief[on], moves[:, np.newaxis], "clamp")[:, 0]
        if not len(rows):
            break
    return cost
