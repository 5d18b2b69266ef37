"""Between which values means of decisions lie."""

import numpy as np
import pytest
from solidtouch.analysis.stats.ranges import Range, ranges
from solidtouch.models.grid import ClassGrid

OBJECTS = (("a",), ("b",), ("c",))


@pytest.mark.parametrize(
    ("sizes", "expected"),
    [
        (np.array([4.0, 9.0, 6.0]), Range(0.0, 5.0, 2.0)),
        (np.array([4.0, 4.0, 6.0]), Range(0.0, 2.0, 2.0)),
        (np.array([4.0, 4.0, 4.0]), Range(0.0, np.inf, 0.0)),
        (None, Range(0.0, 1.0, 1.0)),
    ],
)
def test_errors_lie_between_none_and_the_farthest_classes(sizes, expected):
    """The step is the smallest error; where all objects are alike there is none, and no greatest."""
    found = ranges(ClassGrid(np.array([0.0, 1.0, 4.0]), "mm", None, OBJECTS, sizes, "" if sizes is None else "mm"), 50)
    assert found["what_error"] == expected
    assert found["where_error"] == Range(0.0, 4.0, 1.0)


def test_reaction_times_lie_between_a_tap_and_the_deadline():
    one_place = ClassGrid(np.zeros(1), "mm", None, OBJECTS)
    assert ranges(one_place, 50) == {"taps": Range(1, 50), "where_error": Range(step=0), "what_error": Range(0, 1)}
    assert ranges(one_place, 1)["taps"] == Range(1, np.inf)
