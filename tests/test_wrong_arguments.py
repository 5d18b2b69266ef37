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


def tapset(samples, **more):
    return st.TapSet.from_arrays(samples, [0], ["a"], preprocessing=st.Preprocessing(samples=1), **more)


def replay(case, numbers):
    rig = st.ReplayRig(case.taps, case.model.grid, 0, 1, iter(numbers))
    return st.perceive(rig, case.model, 1.0, st.passive(), 8)


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
COUNT = "must be an integer of at least"
CALLS = {
    "data sets below 0": (lambda _: st.reproduce(data_sets=-1), f"--data-sets {COUNT} 1, got -1"),
    "no trials": (lambda case: st.reproduce(case.taps, trials=0), f"--trials {COUNT} 1, got 0"),
    "half a trial": (lambda case: st.trials(case.model, case.taps, 1.5), f"--trials {COUNT} 1, got 1.5"),
    "draws in words": (lambda case: st.compare(case.taps, draws="many"), f"--draws {COUNT} 0, got 'many'"),
    "a seed below 0": (lambda case: st.tune(case.taps, seed=-1), f"--seed {COUNT} 0, got -1"),
    "no episodes": (lambda case: st.crosscheck(case.taps, episodes=0), f"--episodes {COUNT} 1, got 0"),
    "half a permutation": (lambda case: st.audit(case.taps, permutations=99.5), f"--permutations {COUNT} 0, got 99.5"),
    "no workers": (lambda case: st.sensitivity(case.taps, workers=0), f"--workers {COUNT} 1, got 0"),
    "sets below 0": (lambda _: st.strategies(data_sets=-1), f"--data-sets {COUNT} 1, got -1"),
    "one episode": (lambda case: st.tune_online(case.taps, episodes=1), f"--online {COUNT} 2, got 1"),
    "no models": (lambda case: st.compare(case.taps, models=[]), "--models must name at least one model"),
    "trials above 1": (
        lambda case: st.trials(case.model, case.taps, 10, stop=1.5),
        "--thresholds must be distinct",
    ),
    "trials NaN": (
        lambda case: st.trials(case.model, case.taps, 10, stop=[0.5, np.nan]),
        "got .0.5,nan.",
    ),
    "thresholds below 0": (lambda case: st.reproduce(case.taps, thresholds=[-0.1]), "--thresholds .* got '-0.1'"),
    "thresholds in words": (lambda case: st.reproduce(case.taps, thresholds="high"), "--thresholds must hold numbers"),
    "a number as episode": (lambda _: st.view(7), "view needs an episode of perceive, .* got int"),
    "no episode to view": (lambda _: st.view([]), "view needs at least one episode"),
    "no file of episodes": (lambda _: st.view("none.json"), "none.json: cannot read: No such file"),
    "no sessions": (lambda _: st.simulate("ideal", 0), f"sessions {COUNT} 1, got 0"),
    "a seed in words": (lambda _: st.simulate("ideal", seed="x"), f"seed {COUNT} 0, got 'x'"),
    "a number as rig": (lambda _: st.simulate(7), "name of a preset or RigSettings, got int"),
    "a session below 0": (lambda _: st.SimulatedRig("ideal", 1, -1, 2.5, 1), f"session {COUNT} 0, got -1"),
    "half an object": (lambda _: st.SimulatedRig("ideal", 1, 0, 2.5, 0.5), "Unknown object 0.5"),
    "a place of the rig in words": (
        lambda _: st.SimulatedRig("ideal", 1, 0, "left", 1),
        "position_mm must hold",
    ),
    "ragged taps": (lambda _: tapset([[[1.0, 2.0], [1.0]]]), "taps: rows differ in length"),
    "taps in words": (lambda _: tapset([[["a", "b"]]]), "taps must hold numbers"),
    "places of taps in words": (lambda _: tapset([[[1.0]]], where=["left"]), "where must hold numbers"),
    "no record": (lambda _: st.TapSet.from_arrays([[[1.0]]], [0], ["a"], preprocessing={}), "must be a Preprocessing"),
    "no dataset": (lambda _: st.TapSet(None), "A TapSet holds an xarray dataset, got NoneType"),
    "an index too far": (lambda case: case.taps.select([10**6]), "by a mask or by indices from 0 to 167"),
    "a mask too short": (lambda case: case.taps.select([True]), r"must have shape \(168,\), got \(1,\)"),
    "an index in words": (lambda case: case.taps.select("a"), "by a mask or by indices"),
    "a number as path": (lambda case: case.taps.save(3), "A file is named by its path, got int"),
    "samples in words": (lambda _: st.Preprocessing(samples="5"), f"samples {COUNT} 1, got '5'"),
    "a rate in words": (lambda _: st.Preprocessing(samples=5, rate_hz="fast"), "rate_hz must hold numbers"),
    "no taps": (lambda _: st.fit([]), "There are no taps"),
    "a number as model name": (lambda case: st.fit(case.taps, 3), "a name or a NumPyro function, got 3"),
    "a word as grid": (lambda case: st.fit(case.taps, grid="fine"), "grid must be a ClassGrid, got str"),
    "a grid in another unit": (
        lambda case: st.fit(case.taps, grid=st.ClassGrid([0.0], "cm", None, ["rod 2 mm"])),
        "The grid has positions in 'cm', the taps in 'mm'",
    ),
    "edges in words": (lambda case: st.fit(case.taps, edges="fine"), "edges must hold numbers"),
    "a ragged tap": (lambda case: st.Filter(case.model).update([[1.0], [1.0, 2.0]]), "A tap: rows differ in length"),
    "a complex tap": (lambda case: st.Filter(case.model).update(case.taps.taps[0] * 1j), "A tap must hold numbers"),
    "an endless move": (lambda case: st.Filter(case.model).move(10**30), "integer number of positions"),
    "half a step": (lambda case: case.rig.move(0.5), "integer number of positions, got 0.5"),
    "a replay of nothing": (lambda case: st.ReplayRig(None, case.model.grid, 0, 0), "Taps are a TapSet or the path"),
    "a replay without grid": (lambda case: st.ReplayRig(case.taps, None, 0, 0), "grid must be a ClassGrid"),
    "too few numbers": (lambda case: replay(case, [0.5]), "fewer random numbers than taps or moves"),
    "numbers above 1": (lambda case: replay(case, [1.5]), r"Random numbers must lie in \[0, 1\), got 1.5"),
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
    "a place in words": (lambda _: st.ClassGrid(["left"], "mm", None, ["a"]), "where_value of a class grid must hold"),
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


def test_an_audit_checks_its_samples_before_its_stages(taps, monkeypatch):
    monkeypatch.setattr("solidtouch.analysis.audit.run.StageClock", None)

    with pytest.raises(st.InputError, match="--pre 999: taps have "):
        st.audit(*[taps.select(taps.session == session) for session in (0, 1)], pre=999)


THERE, GONE = __file__, "no.nc"
READ = "solidtouch.models.splits.taps_of"
SIMULATED = "solidtouch.analysis.reproduce.report.simulated_split"
SIMULATED_NEXT = "solidtouch.analysis.reproduce.report.in_order"
BEFORE = {
    "a model without taps": (READ, lambda: st.compare(THERE, models=["histogram", "no.py:f"]), "no.py: no such file."),
    "a model to fit": (
        "solidtouch.inference.fit.all_taps_of",
        lambda: st.fit(THERE, model="no.py:f"),
        "no.py: no such",
    ),
    "a model to tune": (READ, lambda: st.tune(THERE, model="no.py:f"), "no.py: no such file."),
    "a model to tune online": (READ, lambda: st.tune_online(THERE, episodes=9, model="nosuch"), "Unknown model"),
    "a model to reproduce with": (READ, lambda: st.reproduce(THERE, model="nosuch"), "Unknown model 'nosuch'"),
    "a second file": (READ, lambda: st.compare(THERE, GONE), "no.nc: no such file."),
    "a third file": ("solidtouch.analysis.experiment.parts.taps_of", lambda: st.audit(THERE, THERE, GONE), "no.nc: no"),
    "a file behind simulations": (
        "solidtouch.analysis.sensitivity.report.simulated_source",
        lambda: st.sensitivity(GONE),
        "no.nc: no such file.",
    ),
    "a split of two files": (
        READ,
        lambda: st.compare(THERE, THERE, division=st.Division(split="parity")),
        "--split splits one file",
    ),
    "sessions in words": (READ, lambda: st.compare(THERE, division=st.Division(train="one")), "--train"),
    "a model of simulated taps": (SIMULATED, lambda: st.reproduce(model="no.py:f"), "no.py: no such file."),
    "a fixation point": (SIMULATED_NEXT, lambda: st.reproduce(play=st.PlaySettings(fixation=99)), "index from 0 to 15"),
    "a cell": (SIMULATED_NEXT, lambda: st.reproduce(division=st.Division(where_cell="x")), "--where-cell"),
}


@pytest.mark.parametrize("case", BEFORE)
def test_what_is_wrong_is_found_before_taps_are_read_or_simulated(monkeypatch, case):
    work, call, message = BEFORE[case]
    monkeypatch.setattr(work, None)

    with pytest.raises(st.InputError, match=message):
        call()


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
