"""Reports of studies: what they show, draw and save, and that commands save the same."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from solidtouch.analysis.experiment.crosscheck import CrossCheck, RouteDifference
from solidtouch.analysis.validation.checks import Planned

import solidtouch as st


@pytest.fixture(scope="module")
def taps():
    return st.simulate("ideal", sessions=2, seed=1)


@pytest.fixture(scope="module")
def few_taps(make_taps):
    """Two sessions of 3 x 4 classes."""
    taps = make_taps()
    return [taps.select(taps.session == session) for session in (0, 1)]


@pytest.fixture(scope="module")
def report(few_taps):
    return st.compare(*few_taps, models=["histogram", "gaussian"], draws=0, trials=200, thresholds=[0.9, 0.5], seed=3)


def test_a_report_says_its_gist_and_a_notebook_shows_it(report):
    shown = repr(report)
    assert report.page.title in report._repr_html_()
    assert report.summary["headline"] in " ".join(shown.split())
    assert "<table" in report._repr_html_()
    assert "<html" not in report._repr_html_()


def test_every_figure_is_drawn_alone_or_into_a_part_of_another(report):
    for name in report.figures:
        assert report.plot(name).axes
    whole = Figure(figsize=(12, 5), layout="constrained")
    left, right = whole.subfigures(1, 2)
    assert report.plot("decisions", left) is left
    assert report.plot("miscalibration", right) is right
    whole.canvas.draw()
    alone = report.plot("decisions")
    assert len(left.axes) == len(alone.axes)
    assert len(whole.axes) == len(left.axes) + len(right.axes)
    np.testing.assert_array_equal(left.axes[0].lines[0].get_ydata(), alone.axes[0].lines[0].get_ydata())


def test_a_figure_that_is_not_there_is_refused(report):
    with pytest.raises(st.InputError, match=r"no figure 'decision'; its figures are .*decisions"):
        report.plot("decision")


@pytest.mark.slow
def test_the_function_finds_and_saves_what_the_command_does(report, few_taps, command, tmp_path, sketched):
    """But for the names of the taps, the command line and seconds."""
    for name, part in zip(("train", "test"), few_taps, strict=True):
        part.save(tmp_path / f"{name}.nc")
    done = command(
        *("compare", tmp_path / "train.nc", tmp_path / "test.nc", "--models", "histogram,gaussian", "--draws", 0),
        *("--trials", 200, "--thresholds", "0.5,0.9", "--seed", 3, "--out", tmp_path / "command"),
    )
    report.save(tmp_path / "function")
    ours, theirs = (json.loads((tmp_path / of / "summary.json").read_text()) for of in ("function", "command"))
    differing = {key for key in theirs if ours[key] != theirs[key]}

    assert done.code == 0
    assert ours.keys() == theirs.keys()
    assert differing <= {"title", "command", "elapsed_s", "models"}  # models: seconds of the fits
    files = [{path.name for path in (tmp_path / of).iterdir()} for of in ("function", "command")]
    assert files[0] == files[1]
    xr.testing.assert_identical(
        xr.open_datatree(tmp_path / "function" / "compare.nc")["decisions"].to_dataset().load(),
        xr.open_datatree(tmp_path / "command" / "compare.nc")["decisions"].to_dataset().load(),
    )


def test_a_study_refuses_with_the_sentence_of_the_command(taps):
    with pytest.raises(st.InputError, match="--draws must be 0, or 100 or more to look at tails, got 5"):
        st.compare(*taps, draws=5)
    with pytest.raises(st.InputError, match="--models must name different models"):
        st.compare(*taps, models=["histogram", "histogram"])
    with pytest.raises(st.InputError, match="--permutations must be 99 or more, got 7"):
        st.audit(*taps, permutations=7)
    with pytest.raises(st.InputError, match="--thresholds must be distinct numbers"):
        st.trials(st.fit(taps[0]), taps[1], 10, stop=[0.5, 0.5])
    with pytest.raises(st.InputError, match="--preset requires simulated taps"):
        st.reproduce(*taps, preset="paper")
    with pytest.raises(st.InputError, match="--presets names one twice"):
        st.strategies(presets=["paper", "paper"])
    with pytest.raises(st.InputError, match="--data-sets 0 requires"):
        st.sensitivity(data_sets=0)
    with pytest.raises(st.InputError, match="one tap set or more"):
        st.audit()
    with pytest.raises(st.InputError, match="Taps are a TapSet or the path of a file or folder, got list"):
        st.compare([*taps])
    with pytest.raises(st.InputError, match="Taps are a TapSet or the path of a file or folder, got int"):
        st.fit(3)
    with pytest.raises(st.InputError, match="move must be 'fixation' or 'passive', got 'random'"):
        st.trials(st.fit(taps[0]), taps[1], 10, move="random")


def test_trials_are_labelled(taps):
    train, test = taps
    heard = []
    found = st.trials(st.fit(train), test, 300, play=st.PlaySettings(fixation=7), stop=0.9, hear=heard.append)
    assert found.results["taps"].dims == ("theta",)
    assert (
        float(found.results["taps_low"][0]) <= float(found.results["taps"][0]) <= float(found.results["taps_high"][0])
    )
    assert heard[-1].found.trials == found.found.trials == 300
    assert "300 of 300 trials, active" in repr(found)
    moved = st.trials(st.fit(train), test, 300, move="passive", stop=0.9)
    played = st.trials(st.fit([train]), test, 300, play=st.PlaySettings(passive=True), stop=[0.9])
    xr.testing.assert_identical(moved.results, played.results)
    assert moved.about["policy"] == "passive"


def test_a_reproduction_is_labelled(monkeypatch):
    """With the numbers of its summary, on stored and on fresh taps."""
    agreeing = CrossCheck((RouteDifference("posterior", "numpy, filter", 0.0, 1e-10),), 1, 5, 0, 0, 0, 0, ())
    monkeypatch.setattr("solidtouch.analysis.reproduce.results.crosscheck_model", lambda *_, **__: agreeing)
    report = st.reproduce(data_sets=2, trials=10, thresholds=[0.9, 0.5], episodes=1, sequence_taps=0, seed=1)
    decisions, summary = report.decisions, report.summary
    shown = [("", row) for row in (*summary["results"], *summary["differences"])]
    shown += [("fresh_", row) for row in summary["headline"]["fresh"]["rows"]]
    for prefix, row in shown:
        differs = "_difference" if row["policy"] == "passive - active" else ""
        at = decisions.sel(theta=row["theta"]) if differs else decisions.sel(theta=row["theta"], policy=row["policy"])
        for name in ("what_error", "where_error", "taps"):
            for end in ("", "_low", "_high"):
                assert float(at[f"{prefix}{name}{differs}{end}"]) == row[f"{name}{end}"]
    assert decisions["fresh_what_error_difference_low"].attrs["units"] == summary["units"]["what"]
    assert decisions["taps"].attrs["units"] == "taps"

    tree = report.tree
    for table, dim, group in (
        (report.positions, "where", "passive/by_position"),
        (report.fixations, "fixation", "active/by_fixation"),
    ):
        assert table is not None
        assert table["what_error_low"].dims == (dim, "theta")
        assert table[dim].attrs["units"] == table["where_error"].attrs["units"] == summary["units"]["where"]
        np.testing.assert_array_equal(table["taps_high"], tree[group]["taps_high"])
        assert not tree[group]["taps_high"].attrs
    assert float(report.fixations["fixation"][summary["fixation"]["index"]]) == summary["fixation"]["value"]


@pytest.fixture
def files(taps, tmp_path, monkeypatch):
    """The taps as files, and a terminal as wide as a report in print."""
    monkeypatch.setenv("COLUMNS", "110")
    paths = [tmp_path / f"{name}.nc" for name in ("train", "test")]
    for part, path in zip(taps, paths, strict=True):
        part.save(path)
    return paths


def test_an_inspection_prints_what_the_command_does(files, command):
    done = command("inspect", files[0], "--where-cell", "2mm")
    report = st.inspect(files[0], where_cell="2mm")

    assert done.code == 0
    assert done.out.rstrip() == repr(report)
    assert report.counts.dims == ("session", "where", "what")
    assert int(report.counts.sum()) == len(st.load_taps(files[0]))
    assert report.taxels["low"].attrs["units"] == report.found.units
    np.testing.assert_array_equal(report.taxels["high"], report.found.high)
    assert not report.taxels["constant"].any()
    assert all(sentence[:40] in repr(report) for sentence in report.warnings)


@pytest.mark.parametrize("names", [["histogram"], pytest.param(["histogram", "gaussian"], marks=pytest.mark.slow)])
def test_a_crosscheck_prints_what_the_command_does(files, command, monkeypatch, names):
    monkeypatch.setattr("solidtouch.cli.crosscheck.NAMES", names)
    short = ("--episodes", 1, "--length", 3, "--sequence-taps", 2, "--seed", 5)
    done = command("crosscheck", *files, *short, "--model", names[0] if len(names) == 1 else "all")
    report = st.crosscheck(*files, models=names, episodes=1, length=3, sequence_taps=2, seed=5)

    assert done.code == 0
    assert done.out.rstrip() == repr(report)
    assert "All routes agree." in done.out
    assert "numpyro sequence" in done.out
    assert report.passed
    assert report.differences["largest"].dims == ("model", "routes", "quantity")
    for name, check in report.found.items():
        for row in check.rows:
            at = report.differences.sel(model=name, routes=row.routes, quantity=row.quantity)
            assert (float(at["largest"]), float(at["allowed"])) == (row.largest, row.allowed)
        assert int(report.differences["allowed"].sel(model=name).notnull().sum()) == len(check.rows)


def test_a_crosscheck_of_models_that_cannot_be_fitted_says_why(make_taps):
    taps = make_taps(J=1)
    with pytest.raises(st.InputError, match="profile needs more than one sample per tap"):
        st.crosscheck(taps, models=["profile"])
    with pytest.raises(st.InputError, match=r"No model could be checked\. profile: .*one sample.* profile-ar: "):
        st.crosscheck(taps, models=["profile", "profile-ar"])


def test_a_validation_prints_what_the_command_does(command, monkeypatch):
    """With checks that take no time."""
    monkeypatch.setenv("COLUMNS", "110")
    found = dict.fromkeys(("all routes", "engine"), ("nothing differs", True)) | {"beliefs": ("3 of 9 fail", False)}
    planned = [Planned(name, "each other", lambda _seed, name=name: found[name]) for name in found]
    monkeypatch.setattr("solidtouch.analysis.validation.report.checks", lambda: planned)
    for words, options in (((), {}), (("--verbose",), {"seconds": True})):
        done, report = command("validate", "--workers", 1, *words), st.validate(workers=1, **options)
        assert done.code == 1
        assert done.out.rstrip() == repr(report)
        assert ("seconds" in done.out) == bool(options)
    assert repr(report).endswith("1 of 3 checks FAILED: beliefs.")
    assert report.checks["check"].values.tolist() == [*found]
    assert report.checks["passed"].sel(check="beliefs").item() is report.passed is False


def test_tuning_chooses_what_the_command_does(few_taps, command, tmp_path):
    for name, part in zip(("train", "test"), few_taps, strict=True):
        part.save(tmp_path / f"{name}.nc")
    done = command(
        *("tune", tmp_path / "train.nc", tmp_path / "test.nc", "--trials", 100, "--thresholds", "0.5,0.9", "--seed", 2),
        *("--out", tmp_path / "command.json"),
    )
    report = st.tune(*few_taps, trials=100, thresholds=[0.9, 0.5], seed=2)
    report.save(tmp_path / "function.json")

    assert done.code == 0
    assert (tmp_path / "function.json").read_text() == (tmp_path / "command.json").read_text()
    assert report.setting.play.fixation == report.found.fixation.chosen
    assert all(sentence[:40] in " ".join(repr(report).split()) for sentence in report.found.sentences)


@pytest.mark.parametrize("rig", [None, pytest.param("simulated:ideal", marks=pytest.mark.slow)])
def test_learning_on_line_finds_and_keeps_what_the_command_does(rig, taps, command, tmp_path):
    """The setting, the learner and, on a rig, the episodes."""
    for name, part in zip(("train", "test"), taps, strict=True):
        part.save(tmp_path / f"{name}.nc")
    options = ("--online", 12, "--thresholds", "0.5,0.9", "--seed", 2, *(("--rig", rig) if rig else ()))
    done = command(
        *("tune", tmp_path / "train.nc", tmp_path / "test.nc", *options, "--state", tmp_path / "state.json"),
        *("--out", tmp_path / "command.json", "--targets", tmp_path / "targets.json", "--trials", 100),
    )
    heard, said = [], []
    report = st.tune_online(
        *taps,
        episodes=12,
        thresholds=[0.9, 0.5],
        rig=rig,
        seed=2,
        state=tmp_path / "own.json",
        hear=heard.append,
        note=said.append,
    )
    report.save(tmp_path / "function.json")
    report.save_targets(tmp_path / "own-targets.json", 100, 2)

    assert done.code == 0, done.err
    for ours, theirs in (("function", "command"), ("own", "state"), ("own-targets", "targets")):
        assert (tmp_path / f"{ours}.json").read_text() == (tmp_path / f"{theirs}.json").read_text()
    episodes = [] if rig is None else [*map(repr, heard)]
    assert done.out.splitlines()[:-4] == [said[0], *episodes]
    assert done.out.splitlines()[-3] == report.sentence
    assert len(heard) == report.found.episodes == int(report.results["episodes"].sum()) == 12
    assert report.results.sizes == {"fixation": taps[0].grid().L, "theta": 2}
    cost = (report.results["episodes"] * report.results["cost"]).sum()
    assert float(cost) == pytest.approx(sum(episode.cost for episode in heard))
    assert " ".join(repr(report).split()) == report.sentence
    assert said[0].endswith("Only training taps are used.")
    assert "Warning: this pair was played only" in report.sentence
    often = replace(report, found=replace(report.found, count=report.found.count * 20))
    assert "Warning" not in often.sentence


def test_a_rig_of_the_caller_is_learned_on(taps, tmp_path):
    """And what was learned on it is not gone on with on another one."""
    names = [rod.name for rod in st.PRESETS["ideal"].rods]

    def bench(episode):
        what = episode % len(names)
        return st.SimulatedRig("ideal", seed=1, session=2, position_mm=0.5, what=what, run=episode), names[what]

    def nobody_knows(episode):
        return bench(episode)[0], None

    heard, options = [], {"episodes": 6, "thresholds": [0.5], "state": tmp_path / "state.json"}
    st.tune_online(*taps, **options, rig=bench, hear=heard.append)

    assert [episode.what for episode in heard] == (names * 6)[:6]
    with pytest.raises(st.InputError, match="the rig was bench, not held-out taps"):
        st.tune_online(*taps, **options)
    with pytest.raises(st.InputError, match="The true object is unknown; name it with --object, one of"):
        st.tune_online(*taps, episodes=6, rig=nobody_knows)
    with pytest.raises(st.InputError, match="--online must be an integer of at least 2, got 1"):
        st.tune_online(*taps, episodes=1)
    with pytest.raises(st.InputError, match="--home requires --rig"):
        st.tune_online(*taps, rig=bench, home=True)
    with pytest.raises(st.InputError, match="--training-taps requires --rig replay:FILE"):
        st.tune_online(*taps, rig="simulated", training_taps=True)
