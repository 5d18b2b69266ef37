"""Commands on recordings in which objects were not tapped at every position."""

import json

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.analysis.experiment.crosscheck import crosscheck_model
from solidtouch.inference.reference import BORDERS
from solidtouch.inference.trials.records import plan_trials, tap_table
from solidtouch.inference.trials.run import run_trials
from solidtouch.models.io.load import load_taps
from solidtouch.models.measurement.histogram import fit, trim
from solidtouch.models.settings import PlaySettings
from solidtouch.models.splits import split

RECORDED = ("barrett_boxes", "barrett_ballcyl", "eflesh_grid")
"""Sets in which objects were tapped at several positions."""


def cut(taps, grid, pattern):
    """The taps without those of some classes: every second one, half the positions of an object, or a single class."""
    where, what = taps.indices(grid)
    gone = {
        "checkerboard": (where + what) % 2 == 1,
        "half": (what == 0) & (where % 2 == 1),
        "one": (what == grid.M - 1) & (where == grid.L // 2),
    }
    return taps.select(~gone[pattern])


@pytest.fixture
def boards(make_taps, tmp_path):
    """Three files of a session each, 6 positions and 3 objects, every second class empty."""
    files = []
    for s in range(3):
        taps = make_taps(L=6, M=3, J=5, K=4, sessions=1, repeats=20, seed=s, session=np.full(360, s))
        files.append(tmp_path / f"session-{s}.nc")
        cut(taps, taps.grid(), "checkerboard").save(files[-1])
    return files


@pytest.mark.slow
def test_reproduce_and_audit_run_through_on_a_checkerboard(command, boards, tmp_path):
    """Nothing is impossible, with the pseudocount as it is."""
    done = command("reproduce", "--data", *boards[:2], "--quick", "--trials", 60, "--out", tmp_path / "run")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))

    assert done.code == 0
    assert summary["crosscheck"]["passed"]
    assert {row["no_class_left_fraction"] for row in summary["results"]} == {0.0}
    assert "no class left" not in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert command("audit", *boards, "--out", tmp_path / "audit").code == 0


def test_trials_without_a_pseudocount_count_those_with_no_class_left(command, boards, tmp_path):
    """And say what would help; with one there are none and nothing is said."""
    for pseudocount, says in ((0, True), (0.01, False)):
        model = tmp_path / f"{pseudocount}.nc"
        command("fit", boards[0], boards[1], "--pseudocount", pseudocount, "--out", model)
        done = command("trials", model, boards[1], "--trials", 200, "--deadline", 10)

        assert done.code == 0
        assert ("no class" in done.out) == says
        assert ("use --pseudocount above 0" in " ".join(done.out.split())) == says


def test_perceive_ends_with_no_class_left(command, boards, tmp_path):
    """A sentence and exit code 0, as for a deadline; JSON has no infinity."""
    model = tmp_path / "model.nc"
    command("fit", boards[0], boards[1], "--pseudocount", 0, "--out", model)
    words = ("perceive", model, "--rig", f"replay:{boards[1]}", "--engine", "numpy", "--theta", 1, "--episodes", 3)
    done, as_json = command(*words), command(*words, "--json")
    lines = [json.loads(line) for line in as_json.out.splitlines()]

    assert (done.code, as_json.code) == (0, 0)
    assert "(no class left)" in done.out
    assert any(line.get("reason") == "no class left" for line in lines)
    assert any(line.get("log_evidence", 0) is None for line in lines)


CUTS = [(name, pattern) for name in RECORDED for pattern in ("checkerboard", "half", "one")]
EACH_SET = [
    ("barrett_boxes", "checkerboard"),
    ("barrett_boxes", "one"),
    ("barrett_ballcyl", "half"),
    ("barrett_ballcyl", "one"),
    ("eflesh_grid", "checkerboard"),
    ("eflesh_grid", "half"),
]
"""Each set and each pattern of holes twice."""


@pytest.mark.parametrize(("name", "pattern"), slow_but(EACH_SET, CUTS))
def test_recorded_sets_with_holes_are_played(shared_data, name, pattern):
    """Under every border, and belief stays in trained classes: no trial is left without a class."""
    taps = load_taps(shared_data / f"{name}.npz")
    fold = split(cut(taps, taps.grid(), pattern), taps.grid()).folds[0]
    grid, _ = trim(taps.grid(), [fold.train])
    model = fit(fold.train, grid)
    table = tap_table(model, model.usable(fold.test))
    plan = plan_trials(table.pool, 300, 0, grid.L // 2)

    assert not model.trained.all()
    for border in BORDERS:
        trials = run_trials(table, plan, (0.9, 1.0), play=PlaySettings(theta_x=0.0, border=border, deadline=15))
        assert not trials.no_class_left.any()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["barrett_boxes", "eflesh_grid"])
def test_all_routes_agree_on_a_recorded_set_with_holes(shared_data, name):
    taps = load_taps(shared_data / f"{name}.npz")
    fold = split(cut(taps, taps.grid(), "checkerboard"), taps.grid()).folds[0]
    grid, _ = trim(taps.grid(), [fold.train])
    model = fit(fold.train, grid)

    assert crosscheck_model(model, model.usable(fold.test), episodes=3, length=10, sequence_taps=5).passed
