"""What moves cost with the tap that follows."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.inference.moves.strategies import distances_mm, time_costs, way_costs
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid

GRID = ClassGrid(np.array([0.0, 1.0, 3.0, 7.0]), "mm, of the rig", None, (("a",),))


def test_ways_are_those_between_places_and_the_tap():
    """Also where places are not equally far apart."""
    assert distances_mm(GRID)[1].tolist() == [1.0, 0.0, 2.0, 6.0]
    assert way_costs(GRID, 2.5)[3].tolist() == [9.5, 8.5, 6.5, 2.5]


def test_times_are_those_of_the_stage_and_the_tap():
    """At 2 mm/s and 4 mm/s^2 it takes 1 mm to get up to speed and down again: 1 s for that, 0.5 s for each mm more."""
    np.testing.assert_allclose(time_costs(GRID, 0.25, 2.0, 4.0)[0], [0.25, 1.25, 2.25, 4.25])


def test_no_move_is_free():
    """A tap alone costs something, so information per cost is finite; the nearer the cheaper."""
    for costs in (way_costs(GRID), time_costs(GRID)):
        assert (np.diag(costs) > 0).all()
        assert (np.diff(costs[0]) > 0).all()
        np.testing.assert_array_equal(costs, costs.T)


def test_places_must_be_millimetres():
    with pytest.raises(InputError, match="needs positions in mm, but these are in 'deg'"):
        way_costs(replace(GRID, where_unit="deg"))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: way_costs(GRID, 0), "distance of a tap must be above 0, got 0"),
        (lambda: time_costs(GRID, -1.0), "duration of a tap must be above 0, got -1"),
        (lambda: time_costs(GRID, 1.0, 0.0), "speed of moves must be above 0"),
        (lambda: time_costs(GRID, 1.0, 1.0, np.inf), "acceleration of moves must be above 0, got inf"),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
