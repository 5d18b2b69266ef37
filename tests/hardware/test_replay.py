"""The rig that replays recorded taps."""

import numpy as np
import pytest
from solidtouch.hardware.named_rigs import Wish, choose_rig
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


def test_a_rig_may_stay_in_a_session(recording, grid):
    """It then draws its taps alone, and stands where these are; a session or object without a tap is refused."""
    dataset = recording.dataset.copy(deep=True)
    dataset["session"] = dataset["session"].copy(data=[0, 0, 1, 1, 1, 0, 1])
    taps, numbers = TapSet(dataset), [0.0, 0.49, 0.51, 0.99]
    rig = ReplayRig(taps, grid, 0, 0, iter(numbers), session=1)
    assert [int(rig.tap()[0, 0]) for _ in numbers] == [2, 2, 4, 4]
    alone = ReplayRig(taps.select(taps.session == 0), grid, 4, 0, iter(numbers))
    rig = ReplayRig(taps, grid, 4, 0, iter(numbers), session=0)
    assert rig.where_index == alone.where_index == 3
    assert [rig.tap().tolist() for _ in numbers] == [alone.tap().tolist() for _ in numbers]
    with pytest.raises(InputError, match="no tap of session 2 inside the class grid"):
        ReplayRig(taps, grid, 0, 0, session=2)
    with pytest.raises(InputError, match="no tap of thick in session 1"):
        ReplayRig(taps, grid, 0, 1, session=1)


@pytest.mark.parametrize(("repeats", "apart"), [(10, True), (9, False)])
def test_a_named_replay_stays_in_a_session_that_can_stand_alone(make_taps, tmp_path, repeats, apart):
    """Each episode draws one of them, and all are drawn; with fewer than ten taps of a class in a session taps mix."""
    taps = make_taps(sessions=3, repeats=repeats, M=1, J=2, K=1)
    dataset = taps.dataset.copy(deep=True)
    dataset["taps"] = dataset["taps"] * 0 + dataset["session"]
    TapSet(dataset).save(tmp_path / "taps.nc")
    with choose_rig(f"replay:{tmp_path / 'taps.nc'}", taps.grid(), Wish(None, None, 3))(False, None) as source:
        sensors = [source.place(episode).sensor for episode in range(20)]
        drawn = [{float(sensor.tap()[0, 0]) for _ in range(20)} for sensor in sensors]
    assert {len(of) for of in drawn} == ({1} if apart else {3})
    assert set.union(*drawn) == {0.0, 1.0, 2.0}


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
