"""Wrong arguments of the public names: one sentence says what is wrong, before any work is done."""

from typing import NamedTuple

import numpy as np
import pytest

import solidtouch as st


class Case(NamedTuple):
    """What is right in every call."""

    taps: st.TapSet
    model: st.TapModel
    rig: st.ReplayRig


@pytest.fixture(scope="module")
def taps(make_taps):
    return make_taps(sessions=2)


@pytest.fixture(scope="module")
def model(taps):
    return st.fit(taps, bins=12)


@pytest.fixture
def rig(taps, model):
    return st.ReplayRig(taps, model.grid, 0, 1)


THRESHOLD = "threshold on a belief must be a number from 0 to 1, got"
GRID = "of a class grid must be"
CALLS = {
    "a number as model": (
        lambda _: st.Filter(7),
        "A model is a fitted model or the path of its file, got int",
    ),
    "no such model": (lambda _: st.Filter("no.nc"), "no.nc: no such file"),
    "no such model to perceive with": (
        lambda case: st.perceive(case.rig, "no.nc", 0.9, st.passive()),
        "no.nc: no such",
    ),
    "a rig as model": (lambda case: st.perceive(case.model, case.rig, 0.9, st.passive()), "A sensor needs 'step'"),
    "a number to perceive with": (lambda case: st.steps(case.rig, 7, 0.9, st.passive()), "A model is .*, got int"),
    "an engine of nothing": (lambda _: st.make_engine("numpy", 7), "A model is .*, got int"),
    "a number as file": (lambda _: st.load_model(7), "A model is .*, got int"),
    "stop above 1": (lambda case: st.Filter(case.model, stop=1.5), f"{THRESHOLD} 1.5"),
    "stop below 0": (lambda case: st.Filter(case.model, stop=-0.1), f"{THRESHOLD} -0.1"),
    "stop NaN": (lambda case: st.Filter(case.model, stop=np.nan), f"{THRESHOLD} nan"),
    "stop in words": (lambda case: st.Filter(case.model, stop="high"), f"{THRESHOLD} 'high'"),
    "perceive above 1": (lambda case: st.perceive(case.rig, case.model, 95, st.passive()), f"{THRESHOLD} 95"),
    "perceive NaN": (lambda case: st.steps(case.rig, case.model, np.nan, st.passive()), f"{THRESHOLD} nan"),
    "a place as strategy": (
        lambda case: st.perceive(case.rig, case.model, 0.9, 7),
        "move must be a control strategy .* got 7",
    ),
    "half a deadline": (
        lambda case: st.perceive(case.rig, case.model, 0.9, st.passive(), 2.5),
        "deadline must be an integer of at least 1, got 2.5",
    ),
    "a seed as chance": (
        lambda case: st.perceive(case.rig, case.model, 0.9, st.passive(), chance=3),
        "Random numbers are an iterator or a NumPy generator, got int",
    ),
    "a fixation point in words": (lambda _: st.fixation("middle"), "index from 0, got 'middle'"),
    "theta_x NaN": (lambda _: st.fixation(1, np.nan), "theta_x must be a number from 0 to 1, got nan"),
    "a reach in words": (lambda _: st.random_step("far"), "at least 1 position, got 'far'"),
    "a move in words": (lambda case: st.Filter(case.model).move("up"), "integer number of positions, got 'up'"),
    "half a start": (
        lambda case: st.ReplayRig(case.taps, case.model.grid, 0.5, 1),
        r"Class \(0.5, 1\) is outside the grid",
    ),
    "a place in words": (lambda _: st.ClassGrid(["left"], "mm", None, ["a"]), f"where_value {GRID}"),
    "an infinite place": (lambda _: st.ClassGrid([np.inf], "mm", None, ["a"]), f"where_value {GRID}"),
    "places in a table": (lambda _: st.ClassGrid([[1, 2]], "mm", None, ["a"]), f"where_value {GRID}"),
    "one name": (lambda _: st.ClassGrid([1, 2], "mm", None, "ball"), f"what_members {GRID}"),
    "numbers as names": (lambda _: st.ClassGrid([1, 2], "mm", None, [1, 2]), f"what_members {GRID}"),
}


@pytest.mark.parametrize("case", CALLS)
def test_a_wrong_argument_is_refused_in_a_sentence(taps, model, rig, case):
    call, message = CALLS[case]
    with pytest.raises(st.InputError, match=message):
        call(Case(taps, model, rig))


def test_a_model_may_be_named_by_its_file(rig, model, taps, tmp_path):
    path = tmp_path / "model.nc"
    model.save(path)
    again = st.ReplayRig(taps, model.grid, 0, 1)

    episode = st.perceive(rig, str(path), 0.9, st.passive())
    np.testing.assert_array_equal(episode.log_beliefs, st.perceive(again, model, 0.9, st.passive()).log_beliefs)
    assert st.Filter(path).engine.model.grid.shape == model.grid.shape
    assert st.make_engine("numpy", path).name == "numpy"


def test_a_grid_may_be_made_of_lists():
    grid = st.ClassGrid([1, 2, 3], "mm", [0.5, 1.5, 2.5, 3.5], ["ball", ["rod", "bar"]], [4, 8], "mm")

    assert grid.shape == (3, 2)
    assert grid.what_name == ("ball", "rod … bar")
    assert grid.where_index([0.7, 3.4]).tolist() == [0, 2]
    assert grid.what_error([0], [1]).tolist() == [4.0]
    assert st.ClassGrid.from_dict(grid.to_dict()).differences(grid) == []


def test_random_numbers_may_be_a_generator(taps, model):
    """Of a replay as of a strategy; the same generator gives the same episode."""

    def play(numbers):
        rig = st.ReplayRig(taps, model.grid, 0, 1, numbers(1))
        return st.perceive(rig, model, 1.0, st.random_place(), 8, chance=numbers(2))

    drawn = play(np.random.default_rng), play(lambda seed: iter(np.random.default_rng(seed).random(8)))
    assert drawn[0].moves.tolist() == drawn[1].moves.tolist()
    np.testing.assert_array_equal(drawn[0].log_beliefs, drawn[1].log_beliefs)
