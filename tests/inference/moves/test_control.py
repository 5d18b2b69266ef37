"""Control strategies."""

import numpy as np
import pytest
from solidtouch.inference import reference
from solidtouch.inference.moves.control import (
    bounded,
    check_fixation,
    default_fixation,
    fixation,
    passive,
    random_place,
    random_step,
)
from solidtouch.models.errors import InputError

BELIEF = np.outer([0.125, 0.25, 0.5, 0.125], [0.5, 0.25, 0.25])
SOME = np.array(0.3)
L, M = 5, 3
POLICIES = {
    "passive": passive(),
    "fixation": fixation(1),
    "fixation when sure": fixation(4, 0.35),
    "random place": random_place(),
    "random step": random_step(2),
    "bounded": bounded(fixation(0), 2),
}


def test_passive_never_moves():
    """Whatever is believed."""
    assert passive()(BELIEF, SOME) == 0


@pytest.mark.parametrize("index", range(4))
def test_fixation_brings_the_believed_position_to_the_fixation_point(index):
    """theta_X = 0 always moves by the difference."""
    assert fixation(index)(BELIEF, SOME) == index - 2


@pytest.mark.parametrize(("theta_x", "move"), [(0.0, -2), (0.499, -2), (0.5, 0), (0.9, 0), (1.0, 0)])
def test_fixation_needs_more_belief_than_its_threshold(theta_x, move):
    """A belief of exactly theta_X stays."""
    assert fixation(0, theta_x)(BELIEF, SOME) == move


def test_fixation_at_theta_one_stays_though_certain():
    """Also where rounding lifts the marginal above one."""
    assert fixation(1, 1.0)(np.array([[1.0000000000000002], [0.0]]), SOME) == 0


@pytest.mark.parametrize("name", POLICIES)
def test_a_batch_moves_as_its_beliefs_one_by_one(rng, name):
    """Any leading axes, none included; moves are whole numbers."""
    beliefs, chance = rng.dirichlet(np.ones(L * M), size=(4, 7)).reshape(4, 7, L, M), rng.random((4, 7))
    moves = POLICIES[name](beliefs, chance)
    single = [[POLICIES[name](beliefs[i, j], chance[i, j]) for j in range(7)] for i in range(4)]

    assert moves.dtype == np.int64
    assert moves.shape == (4, 7)
    assert np.shape(single[0][0]) == ()
    assert moves.tolist() == np.array(single).tolist()


@pytest.mark.parametrize("name", POLICIES)
def test_moves_do_not_depend_on_how_objects_are_numbered(rng, name):
    beliefs, chance = rng.dirichlet(np.ones(L * M), size=50).reshape(-1, L, M), rng.random(50)

    assert POLICIES[name](beliefs, chance).tolist() == POLICIES[name](beliefs[..., ::-1], chance).tolist()


@pytest.mark.parametrize("theta_x", [0.0, 0.3, 0.5, 1.0])
def test_fixation_decides_as_the_reference(rng, theta_x):
    """Eq. 8 and 10, belief by belief."""
    beliefs = rng.dirichlet(np.full(L * M, 0.3), size=200).reshape(-1, L, M)
    where = [reference.where_decision(belief, theta_x) for belief in beliefs]
    expected = [0 if place is None else reference.fixation_move(place, 3) for place in where]

    assert fixation(3, theta_x)(beliefs, np.zeros(200)).tolist() == expected


def test_a_place_at_random_is_any_place_as_often():
    """Wherever the sensor is believed to be."""
    belief, chance = np.broadcast_to(BELIEF, (400, *BELIEF.shape)), np.arange(400) / 400
    targets = 2 + random_place()(belief, chance)

    assert np.bincount(targets).tolist() == [100] * 4


@pytest.mark.parametrize(
    ("here", "reach", "counts"),
    [
        (2, 1, [0, 50, 0, 50, 0]),
        (2, 2, [25, 25, 0, 25, 25]),
        (0, 1, [0, 100, 0, 0, 0]),
        (4, 2, [0, 0, 50, 50, 0]),
        (1, 2, [25, 0, 25, 50, 0]),
        (1, 4, [25, 0, 13, 25, 37]),
    ],
)
def test_small_steps_go_to_either_side_and_stay_in_the_range(here, reach, counts):
    """A step beyond an end goes to the other side, or to the end where the range is too short for it."""
    belief = np.zeros((5, 2))
    belief[here, 1] = 1.0
    targets = here + random_step(reach)(np.broadcast_to(belief, (100, 5, 2)), np.arange(100) / 100)
    found = np.bincount(targets, minlength=5)

    assert np.abs(found - counts).max() <= 1
    assert found[here] == 0


def test_steps_in_a_range_of_one_place_stay():
    assert random_step(3)(np.ones((4, 1, 2)) / 2, np.array([0.0, 0.3, 0.6, 0.99])).tolist() == [0, 0, 0, 0]


def test_bounded_moves_go_the_same_way_and_no_further():
    belief = np.eye(L)[:, :, np.newaxis]

    assert bounded(fixation(1), 2)(belief, np.zeros(L)).tolist() == [1, 0, -1, -2, -2]


@pytest.mark.parametrize("make", [random_step, lambda reach: bounded(passive(), reach)])
def test_a_reach_of_no_class_is_refused(make):
    with pytest.raises(InputError, match="at least 1 position, got 0"):
        make(0)


def test_parts_of_a_position_are_refused():
    """As fixation point, at once, and as reach; whole floats are taken."""
    for index in (2.5, -1, float("nan")):
        with pytest.raises(InputError, match=f"must be an index from 0, got {index}"):
            fixation(index)
    with pytest.raises(InputError, match=r"at least 1 position, got 1\.5"):
        random_step(1.5)
    with pytest.raises(InputError, match=r"from 0 to 4, got 2\.5"):
        check_fixation(2.5, 5)
    assert fixation(np.int64(1)) is not None


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
    with pytest.raises(InputError, match=f"index from 0 to 2, got {index}"):
        check_fixation(index, 3)


def test_a_fixation_point_outside_the_range_is_refused_at_the_first_move():
    with pytest.raises(InputError, match="must be an index from 0 to 2, got 3"):
        fixation(3)(np.full((3, 2), 1 / 6), SOME)
