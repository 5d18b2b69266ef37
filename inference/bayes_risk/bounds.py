"""Lower bounds on what any strategy costs, where beliefs are too many for the exact rule.

Each tells the strategy more than it may know. QMDP: object and place, after the next tap. The known place: where the
sensor stands, from some tap on. The fast informed bound knows the class before and not after a tap; as objects stay and
moves are certain, that is the same as knowing it now, so it cannot be better than QMDP here, and is not.

With the place known the belief is one in M objects and the least cost a concave function of it. Between the points of a
grid on that simplex a concave function lies above its linear interpolation, so the recursion on the grid stays below.

References: Littman, Cassandra and Kaelbling (1995) for QMDP; Hauskrecht, "Value-function approximations for partially
observable Markov decision processes" (2000), for the fast informed bound.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...models.errors import InputError
from .belief_grid import Simplex, corners, simplex
from .problem import Floats, RiskProblem, stop_loss
from .risk import solved

_CONVERGED = 1e-14


class KnownPlace(NamedTuple):
    """Least further cost if the place is known, after so many taps; a `Leaf`.

    Attributes:
        grid: Beliefs in objects.
        value: Not above that cost, at each place and point, shape (L, G).
    """

    grid: Simplex
    value: Floats

    def __call__(self, beliefs: Floats) -> Floats:
        """Bound on the further cost of beliefs (..., L, M), shape (...)."""
        total = beliefs.sum(axis=-1)
        point, weight = corners(self.grid, beliefs / np.where(total > 0, total, 1.0)[..., np.newaxis])
        value = self.value[np.arange(len(self.value))[:, np.newaxis], point]
        return (total * (weight * value).sum(axis=-1)).sum(axis=-1)


def known_place(problem: RiskProblem, taps: int, parts: int) -> KnownPlace:
    """Least further cost after `taps` taps, if from now on the place is known before one decides or moves.

    Args:
        problem: With symbols and costs.
        taps: Made so far.
        parts: Of the grid; the more the closer.

    Raises:
        InputError: More taps than the problem allows, or a grid without parts.
    """
    if not 1 <= taps <= problem.most_taps:
        raise InputError(f"The problem has 1 to {problem.most_taps} taps, got {taps}.")
    L, M = problem.prior.shape
    grid = simplex(M, parts)
    joint = grid.point[:, np.newaxis] * np.swapaxes(problem.channel, 1, 2)[:, np.newaxis]
    probability = joint.sum(axis=-1)
    point, weight = corners(grid, joint / np.where(probability > 0, probability, 1.0)[..., np.newaxis])
    weight *= probability[..., np.newaxis]
    way = problem.class_cost * np.abs(np.subtract.outer(np.arange(L), np.arange(L)))
    now = np.broadcast_to((grid.point @ problem.loss.T).min(axis=1), (L, len(grid.point)))
    value, place = now, np.arange(L)[:, np.newaxis, np.newaxis, np.newaxis]
    for _ in range(problem.most_taps - taps):
        further = problem.tap_cost + (weight * value[place, point]).sum(axis=(2, 3))
        value = np.minimum(now, (way[:, :, np.newaxis] + further).min(axis=1))
    return KnownPlace(grid, value)


def known_place_bound(problem: RiskProblem, depth: int, parts: int = 40) -> float:
    """Lower bound on the cost of any strategy: the place becomes known after `depth` taps; deeper is higher as a rule.

    Raises:
        InputError: As `known_place`.
    """
    if depth == problem.most_taps:
        return solved(problem, depth, lambda beliefs: stop_loss(problem, beliefs)).value
    return solved(problem, depth, known_place(problem, depth, parts)).value


def qmdp(problem: RiskProblem) -> Floats:
    """Costs of every decision and every move in each class if the class becomes known after it, shape (A + D, L, M).

    The mean of a row under a belief is what that action costs at least, the least of them a bound; see `alpha_bound`.
    """
    return _iterated(problem, _known_after)


def fast_informed(problem: RiskProblem) -> Floats:
    """The fast informed bound, shape (A + D, L, M): what is best after a tap must be best for all classes before it."""
    return _iterated(problem, _best_per_symbol)


def alpha_bound(alphas: Floats, beliefs: Floats) -> Floats:
    """Bound on the further cost of beliefs (..., L, M), shape (...); a `Leaf`."""
    return np.einsum("...lm,alm->...a", beliefs, alphas).min(axis=-1)


def alpha_cost_bound(problem: RiskProblem, alphas: Floats, depth: int = 1) -> float:
    """Lower bound on the cost of any strategy: after `depth` taps the cost is that of `alpha_bound`."""
    return solved(problem, depth, lambda beliefs: alpha_bound(alphas, beliefs)).value


def _known_after(_: RiskProblem, moves: Floats, alphas: Floats) -> Floats:
    """Further cost of each move in each class, from that of all actions, if the class is seen then."""
    return np.einsum("dij,jm->dim", moves, alphas.min(axis=0))


def _best_per_symbol(problem: RiskProblem, moves: Floats, alphas: Floats) -> Floats:
    """The same if the class before is known, and the symbol."""
    after = np.einsum("dij,jms,ajm->adims", moves, problem.channel, alphas)
    return after.min(axis=0).sum(axis=-1)


def _iterated(problem: RiskProblem, further: Callable[[RiskProblem, Floats, Floats], Floats]) -> Floats:
    """Costs from none on, until they stay; each round is a bound and none is below the one before."""
    L, M = problem.prior.shape
    classes, deltas = np.arange(L), problem.deltas
    reached = np.clip(classes + deltas[:, np.newaxis], 0, L - 1)
    moves = (reached[..., np.newaxis] == classes).astype(np.float64)
    way = problem.tap_cost + problem.class_cost * np.abs(reached - classes)
    decisions = np.broadcast_to(problem.loss[:, np.newaxis], (len(problem.loss), L, M))
    alphas = np.concatenate([decisions, np.zeros((len(deltas), L, M))])
    for _ in range(problem.most_taps):
        going = way[..., np.newaxis] + further(problem, moves, alphas)
        new = np.concatenate([decisions, going])
        if np.abs(new - alphas).max() <= _CONVERGED:
            break
        alphas = new
    return alphas
