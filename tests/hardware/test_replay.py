"""The rig that replays recorded taps."""

import numpy as np
import pytest
from solidtouch.hardware.replay import ReplayRig, as_uniforms
from solidtouch.models.errors import InputError
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet

WHERE = [0, 3, 0, 4, 0, 0, 3]
"""Where class of the recorded taps below: of `thin` there are taps in the classes 0, 3 and 4 of 5."""


@pytest.fixture
def recording():
    """Seven taps of `thin` whose samples all hold the number of the tap, and none of `thick`."""
    taps = np.broadcast_to(np.arange(7)[:, np.newaxis, np.newaxis], (7, 3, 2))
    where = np.array(WHERE) + 0.5
    return TapSet.from_arrays(
        taps,
        np.zeros(7, dtype=int),
        ["thin", "thick"],
        preprocessing=Preprocessing(samples=3),
        where=where,
        where_unit="mm",
    )


def replay(recording, grid, start, numbers=(0.0,), what=0):
    return ReplayRig(recording, grid, start, what, iter(numbers))


def test_a_number_picks_the_tap_at_its_share_of_the_class(recording, grid):
    """`floor(u * count)` counts through the taps of the class in file order."""
    rig = replay(recording, grid, 0, [0.0, 0.24, 0.25, 0.5, 0.999])

    assert [int(rig.tap()[0, 0]) for _ in range(5)] == [0, 0, 2, 4, 5]


def test_uniforms_are_those_of_the_generator():
    """The endless numbers are the generator's, one by one."""
    numbers = as_uniforms(np.random.default_rng(4))

    assert np.random.default_rng(4).random(3).tolist() == [next(numbers) for _ in range(3)]


def test_a_class_without_a_tap_is_replaced_by_the_nearest(recording, grid):
    """The sensor then stands there; the move returned includes the detour, and it is counted."""
    rig = replay(recording, grid, 4, [0.0])

    assert rig.move(-2) == -1
    assert (rig.where_index, rig.substituted, rig.clamped) == (3, 1, 0)
    assert rig.tap()[0, 0] == 1.0


def test_a_start_without_a_tap_is_replaced_and_counted(recording, grid):
    """Class 1 is replaced by class 0."""
    rig = replay(recording, grid, 1)

    assert (rig.where_index, rig.substituted) == (0, 1)


def test_moves_beyond_the_range_are_counted(recording, grid):
    """Only moves that are cut short count as clamped, also when no step is left."""
    rig = replay(recording, grid, 0)
    rig.move(4)
    rig.move(1)
    rig.move(-9)
    rig.move(0)

    assert (rig.where_index, rig.clamped, rig.substituted) == (0, 2, 0)


@pytest.mark.parametrize(("start", "what"), [(5, 0), (-1, 0), (0, 2)])
def test_a_start_off_the_grid_is_refused(recording, grid, start, what):
    """The message names the class and the size of the grid."""
    with pytest.raises(InputError, match=rf"Class \({start}, {what}\) is outside the grid of 5 x 2"):
        replay(recording, grid, start, what=what)


def test_an_object_without_any_tap_is_refused(recording, grid):
    """The message names the object."""
    with pytest.raises(InputError, match="no tap of thick"):
        replay(recording, grid, 0, what=1)
