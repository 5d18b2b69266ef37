"""Interpolation over probabilities of M objects from values at the points of a grid.

The weights are the barycentric coordinates in the cell around the probabilities, so the interpolation is continuous,
exact for linear functions and not above a concave function.
"""

from typing import NamedTuple

import numpy as np

from ...models.errors import InputError
from .problem import Floats, Integers


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
