"""Units of a comparison with a single data set: resamples of its test taps.

Trials on the same taps are no units, however many: they say nothing of what other taps would give. So the same trials
are played on resampled taps too (see `inference.trials.resampling`), under all options alike, so that differences pair.
"""

from collections.abc import Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ...inference.trials.records import TapTable
from ...inference.trials.resampling import CONFIDENCE, Spread, spread
from ...inference.trials.selections import resampled_pools
from ...models.grid import ClassGrid, episode_sessions, tap_pool
from ...models.taps import TapSet
from .jackknife import shared_training

RESAMPLES = 40
"""Of the test taps of a single data set; with so many an interval is 3% wider than with any number."""


def resampled_tables(table: TapTable, resamples: int, seed: int) -> list[TapTable]:
    """Test taps as they are, then resamples of them within class and session.

    Args:
        table: Test taps.
        resamples: How many, or 0.
        seed: Of the resamples.
    """
    return [table._replace(pool=pool) for pool in resampled_pools(table, resamples, seed)]


def resampled_table(table: TapTable, number: int, seed: int) -> TapTable:
    """One of `resampled_tables`; 0 is that of the test taps as they are.

    Args:
        table: Test taps.
        number: Which resample, from 1 on.
        seed: Of all of them.
    """
    return table._replace(pool=next(islice(resampled_pools(table, number, seed), number, None)))


def units_of(samples: Sequence[NDArray[np.float64]], how: Spread) -> NDArray[np.float64]:
    """Units with the mean of the estimate and, as their standard error, the spread of its resamples.

    So what is computed from means of data sets, and their jackknife, also is from resamples of one.

    Args:
        samples: Means of trials on each of the tables.
        how: How resamples vary, from `spread` of the first table.

    Returns:
        One unit for each resample, or for each session that is left out in turn, further apart where their sizes leave
        fewer degrees of freedom than so many units have; the estimate as the only one where there is no interval.
        Shape (units, ...).
    """
    first, drawn = np.asarray(samples[0]), np.asarray(samples[1:])
    if not len(drawn) or np.isnan(how.factor):
        return first[np.newaxis]
    if how.sessions > 1:  # a unit for each session, from the resamples without it
        without = np.array([drawn[s :: how.sessions].mean(axis=0) for s in range(min(how.sessions, len(drawn)))])
        return first + unit_factor(how) * np.sqrt(how.sessions - 1) * (without.mean(axis=0) - without)
    return first + unit_factor(how) * np.sqrt(len(drawn)) * (drawn - drawn.mean(axis=0))


def left_out_units(means: NDArray[np.float64]) -> NDArray[np.float64]:
    """Units of sessions that are tested with the model of the others, as far apart as `shared_training` says.

    Args:
        means: Of each session, shape (F, ...).
    """
    mean = means.mean(axis=0)
    return mean + shared_training(len(means)) * (means - mean)


def unit_factor(how: Spread) -> float:
    """By which deviations of resamples are enlarged where their number gives the degrees of freedom.

    Args:
        how: How resamples vary; sessions of unequal sizes, and lone taps, leave fewer.
    """
    taken = how.sessions - 1 if how.sessions > 1 else np.inf
    wanted, used = stdtrit([how.freedom, taken], 0.5 + CONFIDENCE / 2)
    return how.factor * float(wanted / used)


def spread_of_taps(test: TapSet, grid: ClassGrid) -> Spread:
    """How resamples of test taps turn into intervals, and why they may be off."""
    nothing, (where, what) = np.empty((len(test), 0, 0)), test.indices(grid)
    pool = tap_pool(where, what, grid.shape, episode_sessions(where, what, test.session))
    return spread(TapTable(nothing, pool, nothing[0], session=test.session))


def resampled_sentence(test: TapSet, grid: ClassGrid) -> str:
    """What the units of a single data set are, and whether its taps are too few for them."""
    how = spread_of_taps(test, grid)
    few = " " * bool(how.few) + how.few
    if how.sessions > 1:
        return (
            f"Units are the {how.sessions} test sessions, left out one at a time, so intervals cover other sessions "
            f"but not another recording.{few}"
        )
    return (
        f"Units are {RESAMPLES} resamples of the test taps within class and session, so intervals cover other taps of "
        f"these sessions but not another session or recording.{few}"
    )
