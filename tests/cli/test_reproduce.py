"""The main job from beginning to end."""

import contextlib
import html
import json
import os
import pty
import re
import signal
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.experiment.crosscheck import crosscheck_model
from solidtouch.analysis.experiment.study import study
from solidtouch.analysis.page import ahead
from solidtouch.models.errors import InputError
from solidtouch.models.seeds import data_set_seed
from solidtouch.models.setting_file import Setting

FIGURES = ("fig3", "fig4", "fig5_passive", "fig5_active", "fig6", "fig7", "confusion", "contacts")
ACTIVE = ("fig5_passive", "fig5_active", "fig6")
FAST = ("--quick", "--trials", 20, "--deadline", 30)
SMALL = (*FAST, "--data-sets", 2)


def summary_of(folder):
    return json.loads((folder / "summary.json").read_text())


def test_simulated_data_give_the_whole_folder(command, tmp_path, sketched, monkeypatch):
    """Figures in both formats, every curve with its interval, a summary and one page, and nothing else.

    Routes are compared on short episodes, as on long ones in tests of the cross-check; figures are drawn meanwhile.
    """
    asked = {}

    def compared(*models, **more):
        asked.update(more, begun=len(ahead._AHEAD.get().begun))
        return crosscheck_model(*models, **{**more, "episodes": 2, "length": 5, "sequence_taps": 0})

    monkeypatch.setattr("solidtouch.analysis.reproduce.results.crosscheck_model", compared)
    done = command("reproduce", *SMALL, "--out", tmp_path / "run")

    assert done.code == 0
    assert f"Report saved to {tmp_path / 'run' / 'report.html'}" in done.out
    files = {path.name for path in (tmp_path / "run").iterdir()}
    assert files == {f"{name}.svg" for name in FIGURES} | {
        "results.nc", "summary.json", "report.html",
    }  # fmt: skip
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    episode = json.loads(re.search(r'<script type="application/json"[^>]*>(.*?)</script>', page, re.DOTALL)[1])
    assert episode["header"]["heading"] == "test taps of data set 0, active perception"
    assert len(episode["taps"]) == episode["ends"][0]["taps"] >= 3
    assert any(tap["arrived"] for tap in episode["taps"])
    assert len(page) < 3e6
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page)
    summary = summary_of(tmp_path / "run")
    assert [row["policy"] for row in summary["results"]] == ["passive"] * 13 + ["active"] * 13
    for row in summary["results"]:
        for name in ("what_error", "where_error", "taps"):
            assert row[f"{name}_low"] <= row[name] <= row[f"{name}_high"]
    assert summary["crosscheck"]["passed"]
    assert (asked["episodes"], asked["sequence_taps"], asked["begun"]) == (4, 8, 1)
    assert summary["fixation"] == {"index": 7, "value": 7.5}
    with xr.open_datatree(tmp_path / "run" / "results.nc", engine="h5netcdf") as tree:
        assert tree["active/by_fixation"]["what_error_low"].dims == ("place", "theta")
        curve = tree["passive/curve"]["taps"].values
    np.testing.assert_allclose([row["taps"] for row in summary["results"][:13]], curve)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_numbers(command, tmp_path):
    """And another seed others."""
    runs = {}
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        words = ("--preset", "hold2", "--seed", seed, "--thresholds", "0.5,0.9")
        assert command("reproduce", *SMALL, *words, "--out", tmp_path / name).code == 0
        runs[name] = summary_of(tmp_path / name)["results"]

    assert runs["a"] == runs["b"]
    assert runs["a"] != runs["c"]


@pytest.mark.slow
def test_options_reach_the_numbers(command, tmp_path):
    """A single threshold, another fixation point and the clamp border."""
    words = ("--thresholds", "0.8", "--fixation", "0", "--border", "clamp", "--where-cell", "4mm")
    done = command("reproduce", *SMALL, *words, "--out", tmp_path / "run")

    assert done.code == 0
    summary = summary_of(tmp_path / "run")
    assert [row["theta"] for row in summary["results"]] == [0.8, 0.8]
    assert summary["grid"]["L"] == 4
    assert summary["fixation"]["index"] == 0
    assert summary["options"]["border"] == "clamp"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("profile", "The model profile (a mean and a variance for each time of a tap; likelihoods over 9 bins)"),
        ("session", "A histogram model with 9 bins with a gain and offset shared by all taps of an episode was fitted"),
    ],
)
def test_any_model_of_the_catalogue_is_reproduced_and_named(command, tmp_path, make_taps, name, said):
    """In the summary, the page, the file of curves and what is printed."""
    make_taps().save(tmp_path / "taps.nc")
    words = (*FAST, "--model", name, "--bins", 9, "--thresholds", "0.9", "--out", tmp_path / "run")
    done = command("reproduce", "--data", tmp_path / "taps.nc", *words)
    summary = summary_of(tmp_path / "run")

    assert done.code == 0
    assert f"Model {name}\n" in done.out
    assert summary["model"] == summary["options"]["model"] == name
    assert said in summary["what_was_run"][0]
    assert said in html.unescape((tmp_path / "run" / "report.html").read_text())
    assert summary["crosscheck"]["passed"]
    with xr.open_datatree(tmp_path / "run" / "results.nc", engine="h5netcdf") as tree:
        assert tree.attrs["model"] == name


@pytest.mark.slow
def test_a_setting_is_reproduced(command, tmp_path, make_taps):
    """All of it is in the summary; its threshold joins the others and is the one shown; options win over it."""
    taps = make_taps(L=4, repeats=9, where_edges=[-0.75, 0.75, 2.25, 3.75, 5.25])
    where = taps.where + 1.5 * (np.random.default_rng(0).random(len(taps)) - 0.5)
    type(taps)(taps.dataset.assign_coords(where=("tap", where, {"units": "mm"}))).save(tmp_path / "taps.nc")
    setting = Setting.of(
        model="gaussian",
        power=0.2,
        saturation=1.5,
        bins=9,
        value_range="taxel",
        where_cell="0.75mm",
        threshold=0.83,
        border="clamp",
        theta_x=0.1,
        fixation=6,
        deadline=30,
        note="by hand",
    )
    setting.save(tmp_path / "setting.json")
    base = (
        "reproduce",
        "--data",
        tmp_path / "taps.nc",
        "--quick",
        "--trials",
        20,
        "--setting",
        tmp_path / "setting.json",
    )
    done = command(*base, "--out", tmp_path / "run")
    summary = summary_of(tmp_path / "run")

    assert done.code == 0
    assert "Setting: by hand\nModel gaussian\n" in done.out
    assert "At threshold 0.83, compared with passive perception" in done.out
    assert summary["shown_theta"] == 0.83
    assert summary["grid"]["L"] == 8
    assert len(summary["options"]["thresholds"]) == 14
    assert summary["crosscheck"]["passed"]
    saved = json.loads((tmp_path / "setting.json").read_text())
    for name in ("model", "power", "saturation", "bins", "value_range", "border", "theta_x", "fixation", "deadline"):
        assert summary["options"][name] == saved[name]

    words = (
        "--model",
        "histogram",
        "--saturation",
        4,
        "--where-cell",
        "1.5mm",
        "--fixation",
        2,
        "--thresholds",
        "0.5,0.9",
    )
    assert command(*base, *words, "--border", "uniform", "--out", tmp_path / "other").code == 0
    options = summary_of(tmp_path / "other")["options"]
    given = ("model", "saturation", "fixation", "thresholds", "border")
    assert [options[name] for name in given] == ["histogram", 4, 2, [0.5, 0.9], "uniform"]
    assert (options["power"], options["deadline"]) == (0.2, 30)
    assert summary_of(tmp_path / "other")["grid"]["L"] == 4


def test_a_broken_setting_is_named(command, tmp_path):
    (tmp_path / "setting.json").write_text('{"format": 1}')
    done = command("reproduce", "--setting", tmp_path / "setting.json", "--out", tmp_path / "run")

    assert done.code == 2
    assert "setting.json: missing key 'model'" in done.err
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_a_learned_power_is_told(command, tmp_path, make_taps):
    """The number of each data set, and after how many taps."""
    make_taps(sessions=3, repeats=4).save(tmp_path / "taps.nc")
    words = (*FAST, "--power", "learned:2", "--bins", 9, "--thresholds", "0.9", "--out", tmp_path / "run")
    done = command("reproduce", "--data", tmp_path / "taps.nc", *words)
    *_, sentence = summary_of(tmp_path / "run")["what_was_run"]

    assert done.code == 0
    assert sentence.startswith("The exponent of the likelihood was learned by leaving out one training session")
    assert 1e-4 <= float(sentence.rsplit(": ", 1)[1].rstrip(".")) <= 1


@pytest.mark.slow
def test_passive_and_active_agree_where_decisions_take_one_tap(command, tmp_path, make_taps):
    """Recorded taps that are sure, and a quarter of them wrong: the same errors in all digits, and a sentence."""
    taps = make_taps(L=3, M=3, repeats=12)
    rng = np.random.default_rng(1)
    other = np.where(rng.random(len(taps)) < 0.25, rng.permutation(len(taps)), np.arange(len(taps)))
    swapped = taps.dataset.assign(taps=(taps.dataset["taps"].dims, taps.taps[other]))
    type(taps)(swapped).save(tmp_path / "taps.nc")
    words = ("--quick", "--trials", 40, "--power", 1, "--bins", 9, "--pseudocount", 0.5, "--thresholds", "0.3,0.8")
    done = command("reproduce", "--data", tmp_path / "taps.nc", *words, "--out", tmp_path / "run")
    summary = summary_of(tmp_path / "run")
    rows = {(row["policy"], row["theta"]): row for row in summary["results"]}
    sentence = "taps on average, so the finger hardly moves and passive and active perception can"

    assert done.code == 0
    assert rows["active", 0.3] == rows["passive", 0.3] | {"policy": "active"}
    assert rows["passive", 0.3]["taps"] == 1.0
    for name in ("what_error", "where_error"):
        for row in rows.values():
            assert 0 < row[f"{name}_low"] < row[name] < row[f"{name}_high"]
    for row in summary["differences"]:
        assert row["what_error_low"] <= row["what_error"] <= row["what_error_high"]
        assert abs(row["what_error"]) < 0.05
    assert summary["differences"][0]["what_error_high"] == 0.0
    assert sentence in summary["headline"]["still"]
    said = " ".join(done.out.split())
    assert sentence in said
    assert sentence in html.unescape((tmp_path / "run" / "report.html").read_text())
    assert "At threshold 0.8, compared with passive perception" in said
    assert " ".join(summary["headline"]["answer"]) in said
    assert "from trials on test taps of each class, drawn with replacement" in said
    for side in ("stored", "fresh"):
        policies = [part["policy"] for part in summary["headline"][side]["rows"]]
        assert policies == ["passive", "active", "passive - active"]


@pytest.mark.slow
def test_one_test_tap_of_a_class_gives_no_interval(command, tmp_path, make_taps):
    """Nothing says how other taps would differ; the run says so, in the place of intervals."""
    make_taps(repeats=1).save(tmp_path / "taps.nc")
    done = command("reproduce", "--data", tmp_path / "taps.nc", *FAST, "--bins", 9, "--out", tmp_path / "run")
    summary = summary_of(tmp_path / "run")

    assert done.code == 0
    assert summary["interval"] == "Most classes have a single test tap, too few for an interval."
    assert " ".join(done.out.split()).count(summary["interval"]) == 1
    assert {row["what_error_low"] for row in summary["results"]} == {None}
    assert {row["joint_high"] for row in summary["accuracy"]} == {None}
    assert summary["headline"]["used_up"] > 0


@pytest.mark.slow
def test_one_position_leaves_the_active_part_out(command, tmp_path, make_taps):
    """A sentence says so, and the error in the object has no position beside it."""
    make_taps(L=1).save(tmp_path / "taps.nc")
    done = command("reproduce", "--data", tmp_path / "taps.nc", *FAST, "--out", tmp_path / "run")

    assert done.code == 0
    assert "a single position" in " ".join(done.out.split())
    assert not {f"{name}.svg" for name in ACTIVE} & {path.name for path in (tmp_path / "run").iterdir()}
    assert {row["policy"] for row in summary_of(tmp_path / "run")["results"]} == {"passive"}


@pytest.mark.slow
def test_one_object_leaves_the_active_part_out(command, tmp_path, make_taps):
    make_taps(M=1).save(tmp_path / "taps.nc")
    done = command("reproduce", "--data", tmp_path / "taps.nc", *FAST, "--out", tmp_path / "run")

    assert done.code == 0
    assert "a single object" in " ".join(done.out.split())
    assert "All taps are of one object, rod 2 mm" in " ".join(done.out.split())
    assert summary_of(tmp_path / "run")["skipped"]


@pytest.mark.slow
def test_two_files_train_and_test_and_empty_cells_are_named(command, tmp_path, make_taps):
    """A cell without a training tap is left out, a cell without a test tap is replaced by its neighbour."""
    train, test = make_taps(seed=1), make_taps(seed=2)
    train.select((train.what != 1) | (train.where > 0)).save(tmp_path / "train.nc")
    test.select((test.what != 2) | (test.where != 1.5)).save(tmp_path / "test.nc")
    done = command("reproduce", "--data", tmp_path / "train.nc", tmp_path / "test.nc", *FAST, "--out", tmp_path / "run")

    assert done.code == 0
    summary = summary_of(tmp_path / "run")
    assert summary["split"]["method"] == "files"
    assert summary["grid"]["left_out"] == ["rod 4 mm at 0 mm"]
    assert any("their classes have no training tap" in text for text in summary["warnings"])
    assert max(row["substituted_fraction"] for row in summary["results"]) > 0


def test_an_interrupted_run_leaves_nothing(tmp_path):
    """Ctrl-C in the middle of the trials: exit code 130, a sentence, no file."""
    words = ["reproduce", "--data-sets", "2", "--trials", "100000", "--out", str(tmp_path / "run")]
    screen, terminal = pty.openpty()
    child = subprocess.Popen([sys.executable, "-m", "solidtouch.cli", *words], cwd=tmp_path, stderr=terminal)
    os.close(terminal)
    with os.fdopen(screen, "rb", buffering=0) as shown:
        err = shown.read(1000)
        while b"Playing trials" not in err:
            err += shown.read(1000)
        child.send_signal(signal.SIGINT)
        with contextlib.suppress(OSError):  # a terminal without a writer is an error on Linux
            while rest := shown.read(1000):
                err += rest
    child.wait(60)

    assert child.returncode == 130
    assert b"interrupted" in err
    assert b"Traceback" not in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_an_unwritable_folder_is_named(command, tmp_path):
    tmp_path.chmod(0o500)
    done = command("reproduce", *SMALL, "--out", tmp_path / "run")
    tmp_path.chmod(0o700)

    assert done.code == 2
    assert "cannot be written" in done.err


@pytest.mark.slow
def test_active_perception_beats_passive_on_the_simulated_paper(command, tmp_path):
    """Over 12 data sets at threshold .95: at most half the rod error and a quarter of the position error."""
    assert command("reproduce", "--out", tmp_path / "run").code == 0

    summary = summary_of(tmp_path / "run")
    rows = {row["policy"]: row for row in summary["results"] if row["theta"] == 0.95}
    assert rows["active"]["what_error"] <= rows["passive"]["what_error"] / 2
    assert rows["active"]["where_error"] <= rows["passive"]["where_error"] / 4
    assert 1.0 < rows["passive"]["what_error"] < 2.2
    assert 0.2 < rows["active"]["what_error"] < 0.9
    with xr.open_datatree(tmp_path / "run" / "results.nc", engine="h5netcdf") as tree:
        by_position = tree["passive/by_position"].to_dataset().sel(theta=0.95)
    centre, ends = slice(6, 10), [0, 1, 14, 15]
    assert by_position["what_error"][centre].max() < 0.8
    assert by_position["what_error"][ends].min() > 1.5
    assert by_position["where_error"][1:-1].max() < 0.3


RECORDED = {
    # file, options: joint accuracy after one contact with the default smoothing, and what grows
    "eflesh_grid": (("--where-cell", "3mm", "--what-cell", "3mm"), 0.43, True),
    "braille_icub": (("--pseudocount", "0.51"), 0.63, True),
    "icub_grasp": ((), 0.92, False),
    "barrett_ballcyl": (("--split", "leave-one-session-out"), 0.30, False),
    "barrett_boxes": (("--split", "leave-one-session-out", "--pseudocount", "0.48"), 0.50, False),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDED)
def test_recorded_data_run_and_come_near_their_baselines(name, command, tmp_path, shared_data):
    """A plain histogram classifier with 1e-3 on each normalised bin gives these accuracies; ours lie within .04."""
    words, baseline, grows = RECORDED[name]
    done = command("reproduce", "--data", shared_data / f"{name}.npz", *words, *FAST, "--out", tmp_path / "run")

    assert done.code == 0
    summary = summary_of(tmp_path / "run")
    accuracy = [row["joint"] for row in summary["accuracy"]]
    assert accuracy[0] == pytest.approx(baseline, abs=0.04)
    assert summary["crosscheck"]["passed"]
    if grows:
        assert accuracy[:4] == sorted(accuracy[:4])
        assert accuracy[3] > accuracy[0] + 0.15
    if name.startswith("barrett"):
        assert [row["contacts"] for row in summary["accuracy"]] == [1]
        assert "All test classes have only one test tap, which a trial draws repeatedly" in " ".join(done.out.split())
    assert ("Recorded in blocks" in done.out) == (name != "eflesh_grid")


def test_data_sets_draw_their_own_random_numbers(command, tmp_path, monkeypatch):
    """The first that of the command; shared ones would hide the sampling of trials from their spread."""
    seeds = []

    def watched(fold, grid, settings, *more):
        seeds.append(settings.seed)
        if len(seeds) == 2:
            raise InputError("seen enough")
        return study(fold, grid, settings, *more)

    monkeypatch.setattr("solidtouch.analysis.reproduce.report.study", watched)
    done = command("reproduce", *SMALL, "--seed", 5, "--out", tmp_path / "run")

    assert "seen enough" in done.err
    assert seeds == [5, data_set_seed(5, 1)]
