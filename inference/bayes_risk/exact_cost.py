"""Exact cost of a strategy with a stopping rule on a small problem, over all sequences of symbols.

Strategies depend on beliefs only, so equal beliefs after the same number of taps are merged and their probabilities
added.
"""

from collections.abc import Callable, Sequence
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
    """Actions after a tap in n cases.

    Attributes:
        moves: Moves in positions if tapping goes on, shape (n,).
        answer: `GO_ON`, `DECIDE` or `GIVE_UP`, shape (n,).
    """

    moves: Integers
    answer: NDArray[np.int8]


class Course(Protocol):
    """Control of moves and stopping; unlike a `MovePolicy` it may depend on the number of taps."""

    def __call__(self, number: int, beliefs: Floats, chance: Floats) -> Acts:
        """Actions after tap `number`, counted from 1, for beliefs (n, L, M), with a random number (n,) for each."""
        ...


class Cost(NamedTuple):
    """Expected cost of a strategy and its components.

    Attributes:
        total: Total cost, in the unit of the loss.
        loss: Expected loss of the decisions, including giving up.
        taps: Mean number of taps.
        steps: Mean number of positions actually moved.
        gave_up: Probability of giving up.
    """

    total: float
    loss: float
    taps: float
    steps: float
    gave_up: float


def course(policy: MovePolicy, rule: StopRule, watch: Watch | None = None) -> Course:
    """Course of a policy with a stopping rule; `watch` computes the gain that `lookahead` needs."""

    def act(number: int, beliefs: Floats, chance: Floats) -> Acts:
        moves = np.asarray(policy(beliefs, chance), dtype=np.int64)
        return Acts(moves, rule(_moment(number, beliefs, moves, watch)))

    return act


def _moment(number: int, beliefs: Floats, moves: Integers, watch: Watch | None) -> Moment:
    """What a rule knows after tap `number`."""
    gain = np.full(len(beliefs), np.nan) if watch is None else watch(beliefs, moves)["gain"]
    return Moment(beliefs.sum(axis=1), beliefs.sum(axis=2).max(axis=1), np.full(len(beliefs), number), gain)


def expected_cost(problem: RiskProblem, act: Course, chances: int = 1) -> Cost:
    """Exact expected cost of a strategy.

    Decisions are for the object of minimum expected loss. At the last tap, all that have not given up decide.

    Args:
        problem: The problem.
        act: Actions after each tap.
        chances: Number of equal parts of the random number; the result is exact for strategies that are constant on
            each part.

    Raises:
        InputError: `chances` is below 1, or the strategy gives up but the problem has no loss for that.
    """

    def acts(number: int, beliefs: Floats, chance: Floats) -> tuple[Integers, NDArray[np.int8]]:
        moves, answer = act(number, beliefs, chance)
        return moves, answer[np.newaxis]

    return _costs(problem, acts, 1, chances)[0]


def expected_costs(
    problem: RiskProblem,
    policy: MovePolicy,
    rules: Sequence[StopRule],
    watch: Watch | None = None,
    chances: int = 1,
) -> list[Cost]:
    """`expected_cost` of a policy with each of several stopping rules, which share its beliefs and moves.

    Args:
        problem: The problem.
        policy: Control strategy.
        rules: Stopping rules.
        watch: Computes the gain that `lookahead` needs.
        chances: As in `expected_cost`.

    Raises:
        InputError: As `expected_cost`.
    """

    def acts(number: int, beliefs: Floats, chance: Floats) -> tuple[Integers, NDArray[np.int8]]:
        moves = np.asarray(policy(beliefs, chance), dtype=np.int64)
        moment = _moment(number, beliefs, moves, watch)
        return moves, np.array([rule(moment) for rule in rules])

    return _costs(problem, acts, len(rules), chances)


type _ActsOfRules = Callable[[int, Floats, Floats], tuple[Integers, NDArray[np.int8]]]
"""As `Course`, but with the answers of R rules, shape (R, n)."""


def _costs(problem: RiskProblem, acts: _ActsOfRules, R: int, chances: int) -> list[Cost]:
    if chances < 1:
        raise InputError(f"chances must be at least 1, got {chances}.")
    belief, weight = _reached(problem, problem.prior[np.newaxis], np.ones((R, 1)))
    middles = (np.arange(chances) + 0.5) / chances
    loss, steps, gave_up, taps = np.zeros(R), np.zeros(R), np.zeros(R), np.ones(R)
    for number in range(1, problem.most_taps + 1):
        belief, weight = np.repeat(belief, chances, axis=0), np.repeat(weight / chances, chances, axis=1)
        moves, answer = acts(number, belief, np.tile(middles, len(belief) // chances))
        if number == problem.most_taps:
            answer = np.where(answer == GO_ON, DECIDE, answer)
        loss += _loss_of(problem, belief, weight, answer)
        gave_up += (weight * (answer == GIVE_UP)).sum(axis=1)
        weight = np.where(answer == GO_ON, weight, 0.0)
        on = weight.any(axis=0)
        if not on.any():
            break
        belief, weight, moves = belief[on], weight[:, on], np.asarray(moves)[on, np.newaxis]
        taps += weight.sum(axis=1)
        steps += weight @ expected_steps(belief, moves)[:, 0]
        belief, weight = _reached(problem, shifted(belief, moves, "clamp")[:, 0], weight)
    total = loss + problem.tap_cost * taps + problem.class_cost * steps
    return [Cost(*costs) for costs in np.column_stack([total, loss, taps, steps, gave_up]).tolist()]


def _reached(problem: RiskProblem, belief: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Beliefs after the next tap, equal ones merged, and their probabilities under each rule, shape (R, n)."""
    distinct, index = merged(belief)
    weight = _summed(weight, index, len(distinct))
    probability, after = after_taps(problem.channel, distinct)
    reached = probability > 0
    belief, index = merged(after[reached])
    return belief, _summed((weight[:, :, np.newaxis] * probability)[:, reached], index, len(belief))


def _summed(weight: Floats, index: Integers, n: int) -> Floats:
    """Sums of weights (R, ...) of equal index, shape (R, n)."""
    return np.array([np.bincount(index, row, n) for row in weight])


def _loss_of(problem: RiskProblem, belief: Floats, weight: Floats, answer: NDArray[np.int8]) -> Floats:
    """Expected loss of the cases that stop, shape (R,)."""
    M = problem.channel.shape[1]
    given_up = weight * (answer == GIVE_UP)
    if given_up.any() and len(problem.loss) == M:
        raise InputError("The strategy gives up, but the loss has no row for giving up.")
    loss = (weight * (answer == DECIDE)) @ decision_loss(belief, problem.loss[:M])
    return loss + given_up @ decision_loss(belief, problem.loss[M:]) if given_up.any() else loss
