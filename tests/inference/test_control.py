"""Control strategies."""

import numpy as np
import pytest
from solidtouch.inference.control import check_fixation, default_fixation, fixation, passive
from solidtouch.models.errors import InputError

BELIEF = np.outer([0.125, 0.25, 0.5, 0.125], [0.5, 0.25, 0.25])


def test_passive_never_moves():
    """Whatever is believed."""
    assert passive(BELIEF) == 0


@pytest.mark.parametrize("index", range(4))
def test_fixation_brings_the_believed_position_to_the_fixation_point(index):
    """theta_X = 0 always moves by the difference."""
    assert fixation(index)(BELIEF) == index - 2


@pytest.mark.parametrize(("theta_x", "move"), [(0.0, -2), (0.499, -2), (0.5, 0), (0.9, 0), (1.0, 0)])
def test_fixation_needs_more_belief_than_its_threshold(theta_x, move):
    """A belief of exactly theta_X stays."""
    assert fixation(0, theta_x)(BELIEF) == move


def test_fixation_at_theta_one_stays_though_certain():
    """Also where rounding lifts the marginal above one."""
    assert fixation(1, 1.0)(np.array([[1.0000000000000002], [0.0]])) == 0


def test_moves_are_whole_numbers():
    """As rigs and beliefs take them."""
    assert type(fixation(3)(BELIEF)) is int


@pytest.mark.parametrize(("L", "index"), [(1, 0), (2, 0), (3, 1), (4, 1), (5, 2), (16, 7)])
def test_default_fixation_is_the_lower_middle(L, index):
    """7 of the paper's 16."""
    assert default_fixation(L) == index
    assert check_fixation(None, L) == index


def test_fixation_points_inside_the_range_are_taken():
    """Both ends included."""
    assert [check_fixation(index, 3) for index in range(3)] == [0, 1, 2]


@pytest.mark.parametrize("index", [-1, 3])
def test_fixation_points_outside_the_range_are_refused(index):
    """The message names the range."""
    with pytest.raises(InputError, match=f"class index from 0 to 2, got {index}"):
        check_fixation(index, 3)


def test_a_fixation_point_outside_the_range_is_refused_at_the_first_move():
    with pytest.raises(InputError, match="must be a class index from 0 to 2, got 3"):
        fixation(3)(np.full((3, 2), 1 / 6))
