"""Between which values the means of decisions lie, so that no interval goes beyond."""

from typing import NamedTuple

import numpy as np

from ...models.grid import ClassGrid


class Range(NamedTuple):
    """Of a mean over decisions.

    Attributes:
        least: What it cannot be below.
        most: Nor above; infinite where the two would be the same.
        step: By how much a single decision that is not at the least value exceeds it; 0 where none can.
    """

    least: float = 0.0
    most: float = np.inf
    step: float = 1.0


SHARE = Range(0.0, 1.0)


def of_taps(deadline: int) -> Range:
    """Of reaction times with a deadline."""
    return Range(1.0, float(deadline) if deadline > 1 else np.inf)


def ranges(grid: ClassGrid, deadline: int) -> dict[str, Range]:
    """Of errors and reaction times, by name.

    Args:
        grid: The classes.
        deadline: Taps after which a trial ends at the latest.
    """
    found = {"taps": of_taps(deadline)}
    for name, error, n in (("where_error", grid.where_error, grid.L), ("what_error", grid.what_error, grid.M)):
        errors = error(*np.triu_indices(n, 1))
        above = errors[errors > 0]
        found[name] = Range(0.0, float(above.max()), float(above.min())) if len(above) else Range(step=0.0)
    return found
