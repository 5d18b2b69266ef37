"""Probabilities of M objects between the points of a grid, for values that are known at the points only.

Weights of the points around are those of the small simplex that the probabilities lie in, so the interpolation is
continuous, exact for linear functions and not above a concave one.
"""

from typing import NamedTuple

import numpy as np

from ...models.errors import InputError
from .problem import Floats, Integers


class Simplex(NamedTuple):
    """A grid of G points on the simplex of M probabilities, cut into small simplices (Freudenthal's triangulation).

    Attributes:
        parts: Into how many parts an edge is cut.
        point: Probabilities, shape (G, M).
        number: Of the point with given partial sums from the end, shape (parts + 1,) times M - 1.
    """

    parts: int
    point: Floats
    number: Integers


def simplex(M: int, parts: int) -> Simplex:
    """The grid of all probabilities that are multiples of 1 / parts.

    Raises:
        InputError: There is no part, or a single object, of which nothing is to be believed.
    """
    if parts < 1 or M < 2:
        raise InputError(f"A grid needs at least one part and two objects, got {parts} and {M}.")
    sums = np.stack(np.meshgrid(*[np.arange(parts + 1)] * (M - 1), indexing="ij"), axis=-1).reshape(-1, M - 1)
    sums = sums[(np.diff(sums, axis=1) <= 0).all(axis=1)]
    number = np.full((parts + 1,) * (M - 1), -1)
    number[tuple(sums.T)] = np.arange(len(sums))
    ends = np.pad(sums, ((0, 0), (1, 1)), constant_values=((0, 0), (parts, 0)))
    return Simplex(parts, -np.diff(ends, axis=1) / parts, number)


def corners(grid: Simplex, p: Floats) -> tuple[Integers, Floats]:
    """Points of the grid around probabilities (..., M), and the weights that mix them, both of shape (..., M)."""
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
