"""Lower bounds on the cost of any strategy, for problems too large for the exact rule.

Each reveals more to the strategy than it may know. QMDP: object and position, after the next tap. Known position: the
position of the sensor, from some tap on. The fast informed bound knows the class before but not after a tap; as objects
stay and moves are certain, that equals knowing it now, so here it is not better than QMDP.

With the position known, the belief is over M objects and the minimum cost is a concave function of it. Between the
points of a grid, a concave function lies above its linear interpolation, so the recursion on the grid stays below.

References: Littman, Cassandra and Kaelbling (1995) for QMDP; Hauskrecht, "Value-function approximations for partially
observable Markov decision processes" (2000), for the fast informed bound.

The weights of the interpolation are the barycentric coordinates in the cell around the probabilities, so it is
continuous, exact for linear functions and not above a concave function.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...models.errors import InputError
from .problem import Floats, Integers, RiskProblem, stop_loss
from .risk import solved


class Simplex(NamedTuple):
    """A grid of G points on the simplex of M probabilities, cut into small simplices (Freudenthal's triangulation).

    Attributes:
        parts: Number of parts of an edge.
        point: Probabilities, shape (G, M).
        number: Index of the point with given partial sums from the end, shape (parts + 1,) times M - 1.
    """

    parts: int
    point: Floats
    number: Integers


def simplex(M: int, parts: int) -> Simplex:
    """Grid of all probabilities that are multiples of 1 / parts.

    Raises:
        InputError: `parts` is below 1, or M below 2.
    """
    if parts < 1 or M < 2:
        raise InputError(f"A grid needs at least 1 part and 2 objects, got {parts} and {M}.")
    sums = np.stack(np.meshgrid(*[np.arange(parts + 1)] * (M - 1), indexing="ij"), axis=-1).reshape(-1, M - 1)
    sums = sums[(np.diff(sums, axis=1) <= 0).all(axis=1)]
    number = np.full((parts + 1,) * (M - 1), -1)
    number[tuple(sums.T)] = np.arange(len(sums))
    ends = np.pad(sums, ((0, 0), (1, 1)), constant_values=((0, 0), (parts, 0)))
    return Simplex(parts, -np.diff(ends, axis=1) / parts, number)


def corners(grid: Simplex, p: Floats) -> tuple[Integers, Floats]:
    """Grid points around probabilities (..., M) and their interpolation weights, both of shape (..., M)."""
    M = p.shape[-1]
    sums = grid.parts * np.cumsum(p[..., ::-1], axis=-1)[..., ::-1][..., 1:]
    sums = np.minimum.accumulate(np.clip(sums, 0, grid.parts), axis=-1)
    base = np.floor(sums)
    order = np.argsort(base - sums, axis=-1, kind="stable")
    rest = np.take_along_axis(sums - base, order, axis=-1)
    weight = -np.diff(rest, axis=-1, prepend=1.0, append=0.0)
    added = order[..., np.newaxis, :] == np.arange(M - 1)[:, np.newaxis]
    above = np.concatenate([np.zeros((*added.shape[:-1], 1), np.int64), added.cumsum(axis=-1)], axis=-1)
    vertex = np.minimum(base.astype(np.int64)[..., np.newaxis] + above, grid.parts)
    return grid.number[tuple(np.moveaxis(vertex, -2, 0))], weight


_CONVERGED = 1e-14


class KnownPlace(NamedTuple):
    """Minimum further cost if the position is known, after a number of taps; a `Leaf`.

    Attributes:
        grid: Grid of beliefs over objects.
        value: Lower bound on that cost at each position and grid point, shape (L, G).
    """

    grid: Simplex
    value: Floats

    def __call__(self, beliefs: Floats) -> Floats:
        """Lower bound on the further cost of beliefs (..., L, M), shape (...)."""
        total = beliefs.sum(axis=-1)
        point, weight = corners(self.grid, beliefs / np.where(total > 0, total, 1.0)[..., np.newaxis])
        value = self.value[np.arange(len(self.value))[:, np.newaxis], point]
        return (total * (weight * value).sum(axis=-1)).sum(axis=-1)


def known_place(problem: RiskProblem, taps: int, parts: int) -> KnownPlace:
    """Minimum further cost after `taps` taps, if the position is known from now on before each decision or move.

    Args:
        problem: The problem.
        taps: Number of taps so far.
        parts: Parts of the grid; more give a tighter bound.

    Raises:
        InputError: More taps than the problem allows, or a grid without parts.
    """
    if not 1 <= taps <= problem.most_taps:
        raise InputError(f"taps must be 1 to {problem.most_taps}, got {taps}.")
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
    """Lower bound on the cost of any strategy: the position becomes known after `depth` taps; more are usually tighter.

    Raises:
        InputError: As `known_place`.
    """
    if depth == problem.most_taps:
        return solved(problem, depth, lambda beliefs: stop_loss(problem, beliefs)).value
    return solved(problem, depth, known_place(problem, depth, parts)).value


def qmdp(problem: RiskProblem) -> Floats:
    """Cost of each decision and move in each class if the class becomes known after it, shape (A + D, L, M).

    The mean of a row under a belief is a lower bound on the cost of that action; see `alpha_bound` for their minimum.
    """
    return _iterated(problem, _known_after)


def fast_informed(problem: RiskProblem) -> Floats:
    """Fast informed bound, shape (A + D, L, M): the best action after a tap must suit all classes before it."""
    return _iterated(problem, _best_per_symbol)


def alpha_bound(alphas: Floats, beliefs: Floats) -> Floats:
    """Lower bound on the further cost of beliefs (..., L, M), shape (...); a `Leaf`."""
    return np.einsum("...lm,alm->...a", beliefs, alphas).min(axis=-1)


def alpha_cost_bound(problem: RiskProblem, alphas: Floats, depth: int = 1) -> float:
    """Lower bound on the cost of any strategy: after `depth` taps the cost is that of `alpha_bound`."""
    return solved(problem, depth, lambda beliefs: alpha_bound(alphas, beliefs)).value


def _known_after(_: RiskProblem, moves: Floats, alphas: Floats) -> Floats:
    """Further cost of each move in each class, from that of all actions, if the class is then revealed."""
    return np.einsum("dij,jm->dim", moves, alphas.min(axis=0))


def _best_per_symbol(problem: RiskProblem, moves: Floats, alphas: Floats) -> Floats:
    """As `_known_after`, if the class before and the symbol are known."""
    after = np.einsum("dij,jms,ajm->adims", moves, problem.channel, alphas)
    return after.min(axis=0).sum(axis=-1)


def _iterated(problem: RiskProblem, further: Callable[[RiskProblem, Floats, Floats], Floats]) -> Floats:
    """Costs iterated from 0 to convergence; each round is a bound, and rounds do not decrease."""
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
