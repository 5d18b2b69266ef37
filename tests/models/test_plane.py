"""Positions that are places in a plane."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet, concatenate, in_plane


def planar(places, unit="mm", session=0):
    """Two taps of one object at each place."""
    places = np.asarray(places, dtype=float)
    every, number = in_plane(places)
    samples = np.random.default_rng(session).normal(size=(2 * len(places), 3, 2))
    return TapSet.from_arrays(
        samples,
        np.zeros(2 * len(places), dtype=int),
        ["rod"],
        preprocessing=Preprocessing(samples=3),
        where=np.repeat(number, 2),
        where_value=np.arange(len(every)),
        where_place=every,
        where_unit=unit,
        session=np.full(2 * len(places), session),
    )


@given(st.integers(1, 4), st.integers(1, 5), st.integers(1, 3), st.randoms())
def test_neighbours_in_number_are_neighbours_in_a_full_grid(nx, ny, angles, random):
    """With an angle as well: exactly one of the three changes, by one step."""
    grid = [(x, 2.0 * y, 30.0 * a) for x in range(nx) for y in range(ny) for a in range(angles)]
    random.shuffle(grid)
    every, number = in_plane(np.array(grid))
    steps = np.abs(np.diff(every, axis=0)) / [1.0, 2.0, 30.0]

    assert every[number].tolist() == [list(place) for place in grid]
    assert (steps.sum(axis=1) == 1).all()


def test_errors_are_distances_in_the_plane():
    grid = ClassGrid(range(3), "mm", None, ["rod"], where_place=[[0, 0, 10], [3, 4, 10], [3, 4, 90]])

    assert grid.where_error([0, 1, 2], [1, 0, 1]).tolist() == [5, 5, 0]
    assert [grid.where_label(l) for l in range(3)] == ["(0, 0) mm at 10", "(3, 4) mm at 10", "(3, 4) mm at 90"]
    assert grid.axis_unit == ""
    assert ClassGrid.from_dict(grid.to_dict()).differences(grid) == []


def test_a_selection_keeps_its_places():
    grid = ClassGrid(range(3), "mm", None, ["rod"], where_place=[[0, 0], [3, 4], [6, 8]])

    assert grid.select([1, 2], [0]).where_error(0, 1) == 5


def test_other_places_are_a_difference():
    grid, other = (ClassGrid(range(2), "mm", None, ["rod"], where_place=[[0, 0], [x, 4]]) for x in (3, 4))

    assert grid.differences(other) == ["the places of the positions differ"]
    assert grid.differences(ClassGrid(range(2), "mm", None, ["rod"])) == ["the places of the positions differ"]


def test_sessions_at_other_places_have_the_places_of_all():
    """Every tap stays at its place."""
    first, second = planar([(0, 0), (0, 1)]), planar([(0, 1), (2, 0)], session=1)
    both = concatenate([first, second])
    grid = both.grid()

    assert grid.where_place.tolist() == [[0, 0], [0, 1], [2, 0]]
    assert grid.where_place[both.where.astype(int)].tolist() == [[0, 0]] * 2 + [[0, 1]] * 4 + [[2, 0]] * 2


def test_a_file_keeps_the_places(tmp_path):
    taps = planar([(0, 0, 5), (1, 1, 5)])
    taps.save(tmp_path / "taps.nc")

    assert TapSet.load(tmp_path / "taps.nc").grid().where_place.tolist() == [[0, 0, 5], [1, 1, 5]]


def test_cells_of_a_line_are_none_of_a_plane():
    with pytest.raises(InputError, match="places in a plane"):
        planar([(0, 0), (1, 1)]).grid(where_cell="2mm")


@pytest.mark.parametrize("places", [[[0.0], [1.0]], [[0, 0]], [[0, 0], [0, np.nan]], [[0, 0, 0, 0], [1, 1, 1, 1]]])
def test_places_of_another_shape_are_refused(places):
    with pytest.raises(InputError, match="where_place"):
        ClassGrid(range(2), "mm", None, ["rod"], where_place=places)


def test_a_plane_and_a_line_do_not_join():
    line = TapSet.from_arrays(
        np.zeros((2, 3, 2)) + np.arange(2)[:, None, None],
        [0, 0],
        ["rod"],
        preprocessing=Preprocessing(samples=3),
        where_unit="mm",
    )
    with pytest.raises(InputError, match="places in a plane"):
        concatenate([planar([(0, 0), (1, 1)]), line])
