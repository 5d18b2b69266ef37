"""`solidtouch tune`."""

import json
from functools import partial

import numpy as np
import pytest
import typer
from solidtouch.analysis.tuning.run import shown_threshold
from solidtouch.cli.tune import tune
from solidtouch.inference.moves.table import held_out_tables, learn_table, load_table
from solidtouch.inference.tuning.online import load_learner
from solidtouch.models.errors import InputError
from solidtouch.models.io.load import load_taps
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.setting_file import load_setting
from solidtouch.models.taps import TapSet
from typer.testing import CliRunner

import solidtouch as st

COMMON = ("--bins", 12, "--pseudocount", 0.5, "--trials", 100, "--deadline", 20)


@pytest.fixture
def call():
    """A function that runs the command with some words."""
    app = typer.Typer()
    app.command()(tune)
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture
def recorded(make_taps, tmp_path):
    """A file of three sessions, 3 places by 4 objects."""
    make_taps(sessions=3).save(tmp_path / "taps.nc")
    return tmp_path / "taps.nc"


def test_targets_are_learned_from_the_same_held_out_taps(call, recorded, tmp_path):
    """In both ways of tuning; a file that is there stays."""
    out, table = tmp_path / "setting.json", tmp_path / "table.json"
    result = call(recorded, "--out", out, *COMMON, "--targets", table, "--border", "clamp", "--seed", 3)
    assert result.exit_code == 0, result.output
    taps = load_taps(recorded)
    known = taps.select(taps.session < 2)
    tables = held_out_tables(known, taps.grid(), partial(fit, bins=12, pseudocount=0.5, value_range="global"))
    expected = learn_table(tables, taps.grid(), border="clamp", trials=100, seed=3)
    found = load_table(table)
    assert found.target.tolist() == expected.target.tolist()
    np.testing.assert_array_equal(found.loss, expected.loss)

    online = (recorded, "--out", tmp_path / "b.json", *COMMON, "--online", 5, "--border", "clamp", "--seed", 3)
    refused = call(*online, "--targets", table)
    assert isinstance(refused.exception, InputError)
    assert "exists" in str(refused.exception)
    assert call(*online, "--targets", tmp_path / "again.json").exit_code == 0
    assert (tmp_path / "again.json").read_bytes() == table.read_bytes()


@pytest.fixture
def files(make_taps, tmp_path):
    """Seven files of a session each."""
    taps = make_taps(sessions=7, repeats=4)
    for s in range(7):
        taps.select(taps.session == s).save(tmp_path / f"session-{s}.nc")
    return [tmp_path / f"session-{s}.nc" for s in range(7)]


def test_the_setting_holds_both_choices_and_how_they_were_made(call, recorded, tmp_path):
    """And the curves stand in the terminal."""
    out = tmp_path / "setting.json"
    result = call(recorded, "--out", out, *COMMON, "--theta-x", 0.2, "--border", "clamp")
    assert result.exit_code == 0, result.output
    setting = load_setting(out)
    assert setting.play.fixation in range(3)
    assert 0.25 <= setting.play.threshold < 1
    assert (setting.fit.bins, setting.play.theta_x, setting.play.border, setting.play.deadline) == (
        12,
        0.2,
        "clamp",
        20,
    )
    assert "2 training sessions" in setting.note
    for words in (
        "Fixation points",
        "Thresholds",
        "chosen",
        "Each of 2 training sessions",
        f"class {setting.play.fixation}",
    ):
        assert words in result.output
    assert f"Threshold {shown_threshold(setting.play.threshold)}: error" in result.output


def test_perceive_takes_the_setting(call, command, recorded, tmp_path):
    """With the model of the same training taps, which can be written along with it."""
    out, model = tmp_path / "setting.json", tmp_path / "model.nc"
    assert call(recorded, "--out", out, "--model-file", model, *COMMON).exit_code == 0
    done = command("perceive", model, "--rig", f"replay:{recorded}", "--setting", out, "--engine", "filter", "--json")
    assert done.code == 0, done.err
    taps = load_taps(recorded)
    assert "no p-value" not in command("perceive", model, "--setting", out, "--rig", f"replay:{recorded}").out
    assert load_model(model).trained_with(taps.select(taps.session < 2)) == len(taps) * 2 // 3


def test_taps_that_test_do_not_train(call, recorded, tmp_path):
    """Whatever the last session holds, the setting is the same; the first sessions it depends on."""
    settings = []
    for changed in (None, 2, 0):
        taps = load_taps(recorded)
        samples = taps.taps.copy()
        if changed is not None:
            samples[taps.session == changed] = samples[taps.session == changed][::-1]
        path = tmp_path / f"changed-{changed}.nc"
        TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, samples))).save(path)
        result = call(path, "--out", tmp_path / "setting.json", "--force", *COMMON)
        assert result.exit_code == 0, result.output
        settings.append(result.output.partition("Fixation points")[2])
    assert settings[0] == settings[1] != settings[2]


def test_a_target_needs_sessions_and_says_what_a_new_one_will_do(call, files, tmp_path):
    """Six of seven files train."""
    result = call(*files, "--out", tmp_path / "setting.json", "--target-error", 0.3, *COMMON)
    assert result.exit_code == 0, result.output
    assert "6 files train; session-6.nc is kept for tests" in result.output
    assert "90% prediction interval" in result.output
    result = call(*files[:4], "--out", tmp_path / "other.json", "--target-error", 0.3, *COMMON)
    assert isinstance(result.exception, InputError)
    assert "at least 5 training sessions, got 3" in str(result.exception)
    assert not (tmp_path / "other.json").exists()


def test_one_session_is_halved(call, make_taps, tmp_path):
    """And it is said what that cannot show."""
    make_taps(sessions=1, repeats=12).save(tmp_path / "one.nc")
    result = call(tmp_path / "one.nc", "--out", tmp_path / "setting.json", *COMMON, "--by", "passive", "--wrong")
    assert result.exit_code == 0, result.output
    assert "A new session would differ more" in result.output


def test_a_learner_goes_on_where_it_stopped(call, recorded, tmp_path):
    """Two halves end as the whole does, and the setting is what it recommends."""
    words = (recorded, *COMMON, "--learner", "thompson", "--thresholds", "0.6,0.9", "--force")
    whole = tmp_path / "whole.json"
    result = call(*words, "--online", 24, "--state", whole, "--out", tmp_path / "a.json")
    assert result.exit_code == 0, result.output
    assert "After 24 episodes: fixation point" in result.output
    for _ in range(2):
        assert (
            call(*words, "--online", 12, "--state", tmp_path / "half.json", "--out", tmp_path / "b.json").exit_code == 0
        )
    assert json.loads(whole.read_text()) == json.loads((tmp_path / "half.json").read_text())
    assert load_setting(tmp_path / "a.json") == load_setting(tmp_path / "b.json")
    assert load_setting(tmp_path / "a.json").play.threshold in (0.6, 0.9)


def test_learning_on_a_rig_plays_its_episodes(call, recorded, tmp_path):
    """Here recorded taps behind the interface of a rig."""
    state = tmp_path / "state.json"
    words = ("--online", 8, "--rig", f"replay:{recorded}", "--state", state, "--out", tmp_path / "setting.json")
    result = call(recorded, *COMMON, *words)
    assert result.exit_code == 0, result.output
    assert np.sum(json.loads(state.read_text())["count"]) == 8
    assert result.output.count(", fixation point ") == 8
    assert ": 8 episodes saved; the same options with --online N add N more" in " ".join(result.output.split())


def test_what_was_learned_is_kept_when_it_is_interrupted(recorded, tmp_path):
    """After three of twenty episodes, on a rig and on held-out taps."""
    for rig in (f"replay:{recorded}", None):
        state, ended, said = tmp_path / f"{rig is None}.json", [], []

        def hear(episode, ended=ended):
            ended.append(episode)
            if len(ended) == 3:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            st.tune_online(
                recorded, episodes=20, rig=rig, state=state, fit=st.FitSettings(bins=12), hear=hear, note=said.append
            )
        assert load_learner(state).episodes == 3
        assert [episode.number for episode in ended] == [1, 2, 3]
        assert said[-1] == f"{state}: 3 episodes saved; the same options with --online N add N more."


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--cost-error", -1), "cost of an error must be a number of taps, 0 to 1e+09"),
        (("--target-error", 2), "target error must lie between 0 and 1"),
        (("--theta", 1.5), "--theta must be a number from 0 to 1"),
        (("--rig", "simulated"), "--rig requires --online"),
        (("--state", "s.json"), "--state requires --online"),
        (("--online", 9, "--target-error", 0.1), "--target-error cannot be combined with --online"),
        (("--learner", "thompson"), "--learner requires --online"),
        (("--online", 9, "--home"), "--home requires --rig"),
        (("--online", 9, "--by", "passive"), "--by cannot be combined with --online"),
        (("--target-error", 0.1, "--cost-error", 9), "--target-error cannot be combined with --cost-error"),
        (("--target-error", 0.1), "at least 5 training sessions, got 2"),
        (("--object", "rod"), "--object requires --rig"),
        (("--cost-error", 1e300), "cost of an error must be a number of taps"),
        (("--split", "leave-one-session-out"), "has no one training part"),
        (("--thresholds", "0.5,x"), "--thresholds must be numbers"),
        (("--online", 9, "--thresholds", "0.5,1"), "must be between 0 and 1"),
        (("--power", "learned"), "power"),
        (("--model", "guess"), "Unknown model 'guess'"),
    ],
)
def test_nonsense_is_refused_in_a_sentence(call, recorded, tmp_path, words, said):
    """Before anything is written."""
    result = call(recorded, "--out", tmp_path / "setting.json", *COMMON, *words)
    assert isinstance(result.exception, InputError), result.output
    assert said in str(result.exception)
    assert not (tmp_path / "setting.json").exists()


def test_a_learner_that_is_not_there_is_refused_with_those_that_are(call, recorded, tmp_path):
    result = call(recorded, "--out", tmp_path / "setting.json", *COMMON, "--online", 9, "--learner", "gp")
    assert result.exit_code == 2
    assert "'gp' is not one of 'thompson'" in " ".join(result.output.split())
    assert not (tmp_path / "setting.json").exists()


def test_one_object_leaves_nothing_to_tune(call, make_taps, tmp_path):
    make_taps(M=1).save(tmp_path / "one.nc")
    result = call(tmp_path / "one.nc", "--out", tmp_path / "setting.json")
    assert "There is only one object" in str(result.exception)


def test_one_place_has_a_threshold_to_tune(call, make_taps, tmp_path):
    make_taps(L=1, M=2).save(tmp_path / "one.nc")
    result = call(tmp_path / "one.nc", "--out", tmp_path / "setting.json", *COMMON)
    assert result.exit_code == 0, result.output
    assert load_setting(tmp_path / "setting.json").play.fixation == 0


def test_what_was_learned_for_other_pairs_is_not_gone_on_with(call, recorded, tmp_path):
    """Nor with another seed; the file stays as it is."""
    state = tmp_path / "state.json"
    words = (recorded, "--out", tmp_path / "setting.json", "--force", "--online", 4, "--state", state, *COMMON)
    assert call(*words, "--thresholds", "0.6,0.9").exit_code == 0
    before = state.read_bytes()
    assert "the candidate fixation points or thresholds were different" in str(
        call(*words, "--thresholds", "0.6,0.8").exception
    )
    same = (*words, "--thresholds", "0.6,0.9")
    for more, said in (
        (("--seed", 1), "the seed was 0, not 1"),
        (("--cost-error", 10), "the cost of an error was 50 taps, not 10 taps"),
        (("--wrong",), "the kind of error was"),
        (("--deadline", 19), "the deadline was 20, not 19"),
        (("--border", "clamp"), "the border was uniform, not clamp"),
        (("--rig", f"replay:{recorded}"), "the rig was held-out taps, not replay:"),
        (("--train", "0"), "the training data was"),
    ):
        assert said in str(call(*same, *more).exception)
    assert state.read_bytes() == before
    assert call(*same).exit_code == 0


def test_a_setting_is_not_replaced_without_force(call, recorded, tmp_path):
    (tmp_path / "setting.json").write_text("mine")
    result = call(recorded, "--out", tmp_path / "setting.json")
    assert "--force" in str(result.exception)
    assert (tmp_path / "setting.json").read_text() == "mine"


def test_files_that_are_one_are_refused(call, recorded, tmp_path):
    """Before the setting could replace what was learned."""
    same = tmp_path / "same.json"
    for words in (("--online", 5, "--state", same), ("--targets", tmp_path / "." / "same.json")):
        result = call(recorded, "--out", same, *COMMON, *words)
        assert "are the same file" in str(result.exception)
        assert not same.exists()
