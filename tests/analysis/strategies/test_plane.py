"""Ways of a sensor between places in a plane."""

from types import SimpleNamespace

import numpy as np
from solidtouch.analysis.strategies.curves import travelled
from solidtouch.models.grid import ClassGrid


def test_ways_are_distances_in_the_plane():
    """Not differences of the numbers of places."""
    grid = ClassGrid(range(3), "mm", None, ["rod"], where_place=[[0, 0], [3, 4], [3, 0]])
    record = SimpleNamespace(at=np.array([[0, 1, 2, 2], [2, 0, 0, 1]]))

    assert travelled(record, grid).tolist() == [[0, 5, 9, 9], [0, 3, 3, 8]]
