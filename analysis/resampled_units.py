"""Units of a comparison where there is one data set: resamples of its test taps.

Trials on the same taps are no units, however many: they say nothing of what other taps would give. So the same trials
are played on resampled taps too (see `inference.resampling`), under all options alike, so that differences pair.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..inference.resampling import spread, too_few
from ..inference.selections import resampled_pools
from ..inference.trial_plan import TapTable
from ..models.classes import ClassGrid
from ..models.taps import TapSet

RESAMPLES = 40
"""Of the test taps of a single data set; with so many an interval is 3 % wider than with any number."""


def resampled_tables(table: TapTable, resamples: int, seed: int) -> list[TapTable]:
    """Test taps as they are, then resamples of them within class and session.

    Args:
        table: Test taps.
        resamples: How many, or 0.
        seed: Of the resamples.
    """
    return [table._replace(pool=pool) for pool in resampled_pools(table, resamples, seed)]


def units_of(samples: Sequence[NDArray[np.float64]], tables: Sequence[TapTable]) -> NDArray[np.float64]:
    """Units with the mean of the estimate and, as their standard error, the spread of its resamples.

    So what is computed from means of data sets, and their jackknife, also is from resamples of one.

    Args:
        samples: Means of trials on each of the tables.
        tables: From `resampled_tables`.

    Returns:
        One unit for each resample, or for each session that is left out in turn; the estimate as the only one where
        there are none. Shape (units, ...).
    """
    first, drawn = np.asarray(samples[0]), np.asarray(samples[1:])
    if not len(drawn):
        return first[np.newaxis]
    how = spread(tables[0])
    if how.sessions > 1:  # a unit for each session, from the resamples without it
        without = np.array([drawn[s :: how.sessions].mean(axis=0) for s in range(min(how.sessions, len(drawn)))])
        return first + (how.sessions - 1) * (without.mean(axis=0) - without)
    return first + how.factor * np.sqrt(len(drawn)) * (drawn - drawn.mean(axis=0))


def resampled_sentence(test: TapSet, grid: ClassGrid) -> str:
    """What the units of a single data set are, and whether its taps are too few for them.

    Args:
        test: Its test taps.
        grid: The classes.
    """
    where, what = test.indices(grid)
    inside = (where >= 0) & (what >= 0)
    _, count = np.unique(where[inside] * grid.M + what[inside], return_counts=True)
    sessions = len(np.unique(test.session[inside]))
    few = too_few(int(np.median(count)), sessions=sessions)
    if sessions > 1:
        return (
            f"Units are the {sessions} test sessions, each left out in turn, so intervals hold how other sessions "
            f"would differ, not another recording.{' ' * bool(few)}{few}"
        )
    return (
        f"Units are {RESAMPLES} resamples of the test taps within class and session, so intervals hold how other taps "
        f"of these sessions would differ, not another session or recording.{' ' * bool(few)}{few}"
    )
