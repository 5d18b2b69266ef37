"""Taps of a small grid whose classes have different numbers of them, one class none."""

import numpy as np
from solidtouch.inference.trials.records import TapTable
from solidtouch.models.grid import TapPool, tap_pool

L, M = 3, 2
COUNT = np.array([[4, 1], [0, 7], [5, 2]])


def table_of(seed=0, count=COUNT, session=None, skill=1.0):
    """Taps of classes in no order, of which two lie outside the grid."""
    rng = np.random.default_rng(seed)
    where, what = np.repeat(np.argwhere(count >= 0), count.ravel(), axis=0).T
    order = rng.permutation(len(where))
    where, what = np.append(where[order], [-1, -1]), np.append(what[order], [0, 1])
    values = rng.normal(size=(len(where), *count.shape))
    inside = where >= 0
    values[np.flatnonzero(inside), where[inside], what[inside]] += skill
    flat = np.full(count.shape, -np.log(count.size))
    session = None if session is None else session(np.arange(len(where)))
    return TapTable(values, tap_pool(where, what, count.shape), flat, session=session)


def taps_of(pool: TapPool, l: int, m: int):
    return pool.taps(l, m)
