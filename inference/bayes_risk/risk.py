"""Exact rule: when to stop and where to move, at minimum expected cost of taps, moves and errors.

Dynamic programming over all reachable beliefs of a small problem, level by level: beliefs after each number of taps,
equal ones merged, then values from the last level back. With a bound as the value at the last level, instead of that of
deciding there, the same recursion gives a bound; see `bayes_risk.bounds`.
"""

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ...models.errors import InputError
from ..information import shifted
from ..moves.expected_gain import expected_steps
from ..stopping.stopping import DECIDE, GIVE_UP, GO_ON
from .exact_cost import Acts
from .problem import Floats, Integers, RiskProblem, after_taps, joint_after_taps, merged, stop_loss

type Leaf = Callable[[Floats], Floats]
"""Further cost of beliefs (..., L, M), shape (...); linear in the scale of a belief."""

_CHUNK = 1 << 20  # probabilities of classes and symbols at a time
_FOUND = 1e-9  # largest distance of a belief from the stored one


class Level(NamedTuple):
    """Beliefs after a number of taps, n of them; k beliefs after a move.

    Attributes:
        belief: Beliefs, shape (n, L, M).
        moved: Index of the belief after each move, shape (n, D).
        probability: Probability of each symbol then, shape (k, S).
        child: Index of the belief that follows in the next level, shape (k, S); undefined for impossible symbols.
    """

    belief: Floats
    moved: Integers
    probability: Floats
    child: Integers


class BestAct(NamedTuple):
    """Best actions for n beliefs.

    Attributes:
        value: Expected further cost, including the loss of the decision, shape (n,).
        stop: Whether to stop, shape (n,).
        move: Best move otherwise, shape (n,).
    """

    value: Floats
    stop: NDArray[np.bool_]
    move: Integers


class ExactRule:
    """Rule of minimum expected cost; a `Course` for `expected_cost`.

    Attributes:
        problem: The problem.
        value: Expected cost, from before the first tap.
        belief: Reachable beliefs after each number of taps except the last, shapes (n, L, M).
        choice: Best actions for them.
    """

    def __init__(self, problem: RiskProblem, value: float, belief: list[Floats], choice: list[BestAct]) -> None:
        self.problem, self.value, self.belief, self.choice = problem, value, belief, choice

    @cached_property
    def _trees(self) -> list[KDTree]:
        return [KDTree(belief.reshape(len(belief), -1)) for belief in self.belief]

    def __call__(self, number: int, beliefs: Floats, chance: Floats) -> Acts:  # noqa: ARG002
        """Actions after tap `number`, counted from 1.

        Raises:
            InputError: A belief cannot be reached after `number` taps.
        """
        n = len(beliefs)
        answer = np.where(stop_with_object(self.problem, beliefs), DECIDE, GIVE_UP).astype(np.int8)
        if number >= self.problem.most_taps:
            return Acts(np.zeros(n, np.int64), answer)
        distance, index = self._trees[number - 1].query(beliefs.reshape(n, -1))
        if (distance > _FOUND).any():
            raise InputError(f"A belief cannot be reached after {number} taps.")
        choice = self.choice[number - 1]
        return Acts(choice.move[index], np.where(choice.stop[index], answer, GO_ON).astype(np.int8))


def stop_with_object(problem: RiskProblem, beliefs: Floats) -> NDArray[np.bool_]:
    """Whether deciding for an object costs no more than giving up, shape (...)."""
    M = problem.channel.shape[1]
    return stop_loss(problem._replace(loss=problem.loss[:M]), beliefs) <= stop_loss(problem, beliefs)


def exact_rule(problem: RiskProblem) -> ExactRule:
    """Rule of minimum expected cost.

    Time and memory grow as (moves times symbols) to the power of the number of taps, reduced by merging: 3 positions,
    4 symbols and 6 taps take seconds.
    """
    return solved(problem, problem.most_taps, lambda beliefs: stop_loss(problem, beliefs))


def solved(problem: RiskProblem, depth: int, leaf: Leaf) -> ExactRule:
    """Best rule if the further cost after `depth` taps is `leaf`.

    Raises:
        InputError: The depth is below one.
    """
    if depth < 1:
        raise InputError(f"depth must be at least 1, got {depth}.")
    probability, after = after_taps(problem.channel, problem.prior[np.newaxis])
    if depth == 1:
        first = leaf(joint_after_taps(problem.channel, problem.prior[np.newaxis]))
        return ExactRule(problem, problem.tap_cost + float(first.sum()), [], [])
    possible = probability[0] > 0
    belief, root = merged(after[0, possible])
    levels = [_level(problem, belief)]
    while len(levels) < depth - 1:
        last = levels[-1]
        belief, index = merged(_following(problem, last))
        levels[-1] = last._replace(child=index.reshape(last.probability.shape))
        levels.append(_level(problem, belief))
    choices: list[BestAct] = []
    for level in reversed(levels):
        further = _leaves(problem, level, leaf) if not choices else _mean(level, choices[-1].value)
        choices.append(_choice(problem, level, further))
    choices.reverse()
    value = problem.tap_cost + float(probability[0, possible] @ choices[0].value[root])
    return ExactRule(problem, value, [level.belief for level in levels], choices)


def _after_moves(problem: RiskProblem, level: Level) -> Floats:
    """The k beliefs that `level.moved` indexes, shape (k, L, M)."""
    flat = level.moved.ravel()
    first = np.zeros(len(level.probability), np.int64)
    first[flat[::-1]] = np.arange(len(flat))[::-1]
    row, move = np.divmod(first, level.moved.shape[1])
    return shifted(level.belief[row], problem.deltas[move, np.newaxis], "clamp")[:, 0]


def _following(problem: RiskProblem, level: Level) -> Floats:
    """Beliefs after each move and symbol, shape (k S, L, M); where the symbol is impossible, some other one."""
    _, after = after_taps(problem.channel, _after_moves(problem, level))
    flat = after.reshape(-1, *after.shape[2:])
    impossible = level.probability.ravel() == 0
    flat[impossible] = flat[np.flatnonzero(~impossible)[0]]
    return flat


def _level(problem: RiskProblem, belief: Floats) -> Level:
    """Level without its children."""
    n, D = len(belief), len(problem.deltas)
    moved = shifted(belief, problem.deltas, "clamp").reshape(n * D, *belief.shape[1:])
    distinct, index = merged(moved)
    probability = np.einsum("nlm,lms->ns", distinct, problem.channel)
    return Level(belief, index.reshape(n, D), probability, np.zeros((0, 0), np.int64))


def _mean(level: Level, value: Floats) -> Floats:
    """Expected further cost after a tap of beliefs after a move, shape (k,)."""
    return (level.probability * value[level.child]).sum(axis=1)


def _leaves(problem: RiskProblem, level: Level, leaf: Leaf) -> Floats:
    """As `_mean`, at the last level, without stored children."""
    moved = _after_moves(problem, level)
    step = max(1, _CHUNK // problem.channel.size)
    parts = [
        leaf(joint_after_taps(problem.channel, moved[i : i + step])).sum(axis=1) for i in range(0, len(moved), step)
    ]
    return np.concatenate(parts)


def _choice(problem: RiskProblem, level: Level, further: Floats) -> BestAct:
    """Best actions, from the expected further cost of the next taps."""
    way = problem.class_cost * expected_steps(level.belief, problem.deltas)
    going = problem.tap_cost + way + further[level.moved]
    best = going.argmin(axis=1)
    going, now = going[np.arange(len(best)), best], stop_loss(problem, level.belief)
    return BestAct(np.minimum(now, going), now <= going, problem.deltas[best])
