"""`solidtouch perceive` on simulated and replayed rigs."""

import json
import os
import pty
import re
import signal
import sys
from contextlib import contextmanager, suppress
from dataclasses import replace
from threading import Thread

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.analysis.live.saved import load_episodes
from solidtouch.hardware.errors import NoAnswer
from solidtouch.hardware.simulator.rig import SimulatedRig
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference import episode
from solidtouch.inference.engines.engine import NumpyEngine
from solidtouch.inference.information import tap_outcomes
from solidtouch.inference.moves.strategies import make_policy
from solidtouch.inference.moves.table import held_out_tables, learn_table, save_table
from solidtouch.inference.stopping.rules import make_rule, parse_stopping
from solidtouch.inference.stopping.stopping import DECIDE, GO_ON, Moment
from solidtouch.inference.trials.records import trial_chances
from solidtouch.models.blocks import tap_digests
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.setting_file import Setting
from solidtouch.models.settings import FitSettings


@pytest.fixture(scope="module")
def session():
    return simulate_session(preset("paper"), 4, 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, session):
    """A folder with a recording and the model fitted to half of it."""
    from solidtouch.cli.fit import fit as fit_command

    folder = tmp_path_factory.mktemp("perceive")
    session.save(folder / "taps.nc")
    fit_command([folder / "taps.nc"], folder / "model.nc", split="parity")
    fit(session, session.grid()).save(folder / "old.nc")
    return folder


RIGS = {"simulated": [], "replayed": ["--rig", "replay:TAPS"]}


def words(folder, rig):
    return [word.replace("TAPS", str(folder / "taps.nc")) for word in RIGS[rig]]


def records(out):
    return [json.loads(line) for line in out.splitlines()]


@pytest.mark.parametrize("rig", RIGS)
def test_taps_become_lines_and_a_decision(command, folder, rig):
    """One line per tap, then the answer with the truth, then how long the updates took."""
    done = command("perceive", folder / "model.nc", *words(folder, rig), "--seed", 4, "--engine", "filter")
    lines = done.out.splitlines()

    assert done.code == 0
    assert "engine filter, warmed up in" in lines[0]
    assert [re.match(r"tap (\d+): \d+ mm rod 0\.\d+, ", line)[1] for line in lines[1:-2]] == [
        str(n + 1) for n in range(len(lines) - 3)
    ]
    assert re.fullmatch(r"Episode 1: .* rod at .* mm after \d+ taps? \(threshold\)\. Truth: .*", lines[-2])
    assert re.match(r"Update latency: median \d+\.\d\d ms, 99th percentile", lines[-1])


@pytest.mark.parametrize("name", [pytest.param("profile", marks=pytest.mark.slow), "session"])
def test_any_fitted_model_perceives(command, folder, session, name):
    """All engines come to the same decision; new things need a histogram, and states another border than prior."""
    settings = FitSettings(gain_sd=0.02, offset_sd=0.0)
    fit_model(name, session, session.grid(), settings).model.save(folder / f"{name}.nc", force=True)
    words = ("perceive", folder / f"{name}.nc", "--seed", 4, "--json", "--deadline", 8)
    decisions = []
    for engine in ("numpy", *["numpyro"] * (name == "session"), "filter"):
        done = command(*words, "--engine", engine)
        assert done.code == 0
        decisions.append({key: records(done.out)[-1][key] for key in ("decision", "reason", "taps")})
    unknown = command(*words, "--unknown", 0.1)
    prior = command(*words, "--border", "prior", "--engine", "filter")

    assert all(decision == decisions[0] for decision in decisions)
    assert unknown.code == 2
    assert "--unknown requires a fitted histogram model" in unknown.err
    assert prior.code == (2 if name == "session" else 0)


@pytest.mark.parametrize("rig", RIGS)
def test_json_is_all_there_is_on_standard_output(command, folder, rig):
    """One object per tap, the last one the decision; the same for all engines and with a shadow."""
    outs = []
    for options in (["--engine", "numpy"], ["--engine", "numpyro", "--shadow"], ["--engine", "filter"]):
        done = command("perceive", folder / "model.nc", *words(folder, rig), "--seed", 4, "--json", *options)
        assert done.code == 0
        assert "Update latency" in done.err
        outs.append(records(done.out))
    *taps, decision = outs[0]

    assert [tap["tap"] for tap in taps] == list(range(1, len(taps) + 1))
    assert set(decision) >= {"decision", "reason", "taps", "true_what", "true_where", "right"}
    assert decision["taps"] == len(taps)
    assert decision["right"] == (decision["decision"] == decision["true_what"])
    for other in outs[1:]:
        assert [row.get("move") for row in other] == [row.get("move") for row in outs[0]]
        assert other[-1] == decision


def test_the_seed_of_an_episode_leaves_the_sensor_as_it_is(command, folder):
    """The rig has the sensor that trained the model, which the seed of another does not change unless it is named."""
    base = ("perceive", folder / "model.nc", "--json", "--engine", "filter", "--episodes", 20, "--seed")
    done = command(*base, 3)
    other = command(*base, 3, "--sensor-seed", 3)
    same = command(*base, 3, "--sensor-seed", 4)
    right, wrong = (sum(record.get("right", False) for record in records(run.out)) for run in (done, other))

    assert right > wrong + 5
    assert same.out == done.out
    assert "Warning: the model was trained on taps of the simulated sensor of seed 4, and this rig" in other.err
    assert "Warning" not in done.err


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (("--object", "7 mm rod"), "--object must be one of 4 mm rod,"),
        (("--start", 99), "--start must be an index from 0 to 15"),
        (("--start", "900mm"), "Position 900.0 mm is outside the range"),
        (("--rig", "nosuch"), "--rig must be simulated,"),
        (("--rig", "simulated:nosuch"), "Unknown preset 'nosuch'"),
        (("--rig", "replay:none.nc"), "none.nc: no such file."),
        (("--rig", "replay:TAPS", "--object", "7 mm rod"), "--object must be one of 4 mm rod,"),
        (("--rig", "replay:TAPS", "--start", "900mm"), "--start 900mm is outside the classes of the model."),
        (("--rig", "replay:TAPS", "--sensor-seed", 1), "--sensor-seed requires --rig simulated."),
        (("--rig", "none.toml"), "none.toml: cannot read"),
        (("--unknown", 2), "--unknown must be between 0 and 1, got 2.0."),
    ],
)
def test_wrong_names_are_refused_before_an_engine_is_made(command, folder, monkeypatch, wrong, sentence):
    """Compiling one takes the longest."""
    monkeypatch.setattr("solidtouch.inference.engines.engine.make_engine", None)
    given = [str(word).replace("TAPS", str(folder / "taps.nc")) for word in wrong]
    done = command("perceive", folder / "model.nc", *given)

    assert done.code == 2
    assert sentence in done.err


def test_start_object_and_policy_are_obeyed(command, folder):
    """Passive perception stays at its class; active perception comes to the fixation point."""
    base = ["perceive", folder / "model.nc", "--json", "--engine", "numpy", "--object", "8 mm rod", "--theta", "1"]
    still = records(command(*base, "--start", "3", "--passive", "--deadline", "3").out)
    active = records(command(*base, "--start", "3.2mm", "--fixation", "10", "--deadline", "6").out)

    assert [tap["move"] for tap in still[:-1]] == [0, 0, None]
    assert still[-1]["true_where"] == 3.5
    assert still[-1]["true_what"] == "8 mm rod"
    assert still[-1]["reason"] == "deadline"
    assert active[-1]["true_where"] == pytest.approx(10.2)
    assert active[-1]["where"] == 10.5


def test_several_episodes_differ_and_are_summed_up(command, folder):
    """The same seed gives the same episodes."""
    base = ["perceive", folder / "model.nc", "--engine", "numpy", "--episodes", 4, "--deadline", 5, "--json"]
    first, again = command(*base, "--seed", 1), command(*base, "--seed", 1)
    decisions = [row for row in records(first.out) if "decision" in row]

    assert first.out == again.out
    assert [row["episode"] for row in decisions] == [1, 2, 3, 4]
    assert len({(row["true_what"], row["true_where"]) for row in decisions}) > 1
    assert re.search(r"4 episodes of \d\.\d taps on average, \d of 4 objects right\.", first.err)


def test_an_object_that_the_model_does_not_know_is_unknown(command, tmp_path, session):
    """Contact that was never trained: p-values are small and the episode ends with `unknown`, which is right."""

    known = session.select(session.what != 4)
    grid = session.grid().select(range(16), range(4))
    model = fit(known, grid)
    model.with_scores(known).save(tmp_path / "model.nc")
    dataset = session.dataset.copy(deep=True)
    dataset["taps"] = dataset["taps"].where(dataset["what"] < 4, -dataset["taps"])
    type(session)(dataset).save(tmp_path / "taps.nc")

    base = ["perceive", tmp_path / "model.nc", "--rig", f"replay:{tmp_path / 'taps.nc'}", "--engine", "numpy"]
    base += ["--start", 7, "--json", "--unknown", 0.05, "--training-taps"]
    strange, usual = (records(command(*base, "--object", what).out) for what in ("12 mm rod", "6 mm rod"))

    assert strange[0]["unusual"]
    assert (strange[-1]["decision"], strange[-1]["reason"], strange[-1]["right"]) == ("unknown", "unknown", True)
    assert strange[-1]["taps"] < 10
    assert usual[-1]["reason"] == "threshold"


def test_a_model_without_scores_perceives_without_p_values(command, folder):
    done = command("perceive", folder / "old.nc", "--engine", "numpy", "--deadline", 1)

    assert done.code == 0
    assert "no p-value" in done.out


def test_fit_stores_scores(folder, session):
    """One for each calibration tap, half of the training taps."""
    assert len(load_model(folder / "model.nc").novelty.misfit) == len(session) // 4


def test_the_picture_is_kept(command, folder, tmp_path):
    """Complete, and never over an existing file."""
    base = ["perceive", folder / "model.nc", "--engine", "numpy", "--deadline", 1, "--picture", tmp_path / "p.svg"]

    assert command(*base).code == 0
    text = (tmp_path / "p.svg").read_text()
    assert text.startswith("<svg")
    assert "12&#160;mm&#160;rod" in text
    assert "already exists" in command(*base).err
    assert command(*base, "--force").code == 0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--rig", "simulate"], "--rig must be simulated, simulated:PRESET, replay:FILE or a .toml file"),
        (["--rig", "simulated:papre"], "Unknown preset 'papre'"),
        (["--rig", "replay:none.nc"], "none.nc: no such file"),
        (["--rig", "none.toml"], "none.toml"),
        (["--start", "16"], "--start must be an index from 0 to 15 or a position in mm, such as 0.5mm, got '16'"),
        (["--start", "2cm"], "--start must be an index"),
        (["--start", "17mm"], "17.0 mm is outside the range"),
        (["--object", "9 mm rod"], "--object must be one of 4 mm rod, "),
        (["--object", "5"], "or an index from 0 to 4, got '5'"),
        (["--fixation", "16"], "fixation point must be an index from 0 to 15"),
        (["--passive", "--fixation", "3"], "--passive cannot be combined with --fixation or --theta-x"),
        (["--passive", "--move", "random"], "--move cannot be combined with --passive"),
        (["--move", "step", "--theta-x", "0.5"], "--move cannot be combined with --passive or --theta-x"),
        (["--stop", "soon"], "--stop: Unknown stopping rule 'soon'"),
        (["--stop", "taps:3", "--theta", "0.9"], "--stop cannot be combined with --theta"),
        (["--stop", "lookahead:1"], "--stop lookahead:1 requires --training with the taps that trained the model"),
        (["--stop", "taps:3", "--training", "taps.nc"], "--training requires a --move that looks ahead"),
        (["--give-up", "soon"], "--give-up: Giving up needs a number of taps"),
        (["--give-up", "9", "--deadline", "8"], "--give-up 9 exceeds the deadline of 8 taps"),
        (["--move", "lazy"], "--move: Unknown control strategy 'lazy'"),
        (["--move", "two-taps"], "--move: Unknown control strategy 'two-taps'; choose from passive, fixation, "),
        (["--move", "step:0"], "--move: The number of a strategy must be an integer from 1 to 1000, got 'step:0'"),
        (["--move", "info-what"], "--move info-what requires --training with the taps that trained the model"),
        (["--move", "table"], "--move table requires --targets with a learned table"),
        (["--move", "random", "--training", "taps.nc"], "--training requires a --move that looks ahead"),
        (["--targets", "t.json"], "--targets requires --move table"),
        (["--move", "random", "--fixation", "3"], "--fixation cannot be combined with --move random"),
        (["--move", "table", "--targets", "t.json"], "t.json: cannot read"),
        (["--move", "info-what", "--training", "none.nc"], "--training none.nc: none.nc: no such file"),
        (["--theta", "1.5"], "--theta must be a number from 0 to 1, got 1.5"),
        (["--theta-x", "nan"], "--theta-x must be a number from 0 to 1"),
        (["--unknown", "2"], "--unknown must be between 0 and 1, got 2.0"),
        (["--picture", "p.png"], "--picture must name an .svg file"),
        (["--save-episode", "e.txt"], "e.txt: the name of a file of episodes must end in .json"),
        (["--save-episode", "none/e.json"], "none/e.json: cannot write: no folder none"),
        (["--view-port", "8000"], "--view-port requires --view"),
        (["--no-browser"], "--no-browser requires --view"),
        (["--view", "--view-port", "70000"], "--view-port must be at most 65535, got 70000"),
        (["--pace", "-1"], "--pace must be at least 0, got -1"),
        (["--engine", "numpyro", "--border", "prior"], "not a Markov kernel"),
    ],
)
def test_bad_options_are_one_sentence_and_exit_code_2(command, folder, options, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = command("perceive", folder / "model.nc", "--engine", "numpy", *options)

    assert done.code == 2
    assert said in " ".join(done.err.split())
    assert "Traceback" not in done.err
    assert not list(tmp_path.iterdir())


MOVES = [
    "passive",
    "fixation",
    "fixation:0.3",
    "random",
    "step:2",
    "info-what",
    "info-joint-per-mm",
    "table",
]


@pytest.fixture(scope="module")
def ahead(folder, session):
    """What strategies that look ahead know: the model, a learned table and what taps may come of."""
    model = load_model(folder / "model.nc")
    known = session.select(np.isin(tap_digests(session.taps), model.training))
    table = learn_table(held_out_tables(known, model.grid, fit), model.grid, trials=50)
    save_table(table, folder / "targets.json")
    return model, table, tap_outcomes(model.log_likelihood(known.taps))


@pytest.mark.parametrize("name", slow_but(("random", "info-joint-per-mm", "table"), MOVES))
def test_an_episode_moves_as_the_strategy_says(command, folder, ahead, monkeypatch, name):
    """The moves are those that the strategy has for the beliefs shown; the same command moves the same."""
    model, table, outcomes = ahead
    more = {"table": ["--targets", folder / "targets.json"]}.get(name, [])
    more += ["--training", folder / "taps.nc"] if name.startswith("info") else []
    base = ("perceive", folder / "model.nc", "--engine", "filter", "--seed", 4, "--theta", 1, "--deadline", 4, "--json")
    done = command(*base, "--move", name, *more)
    policy = make_policy(name, model.grid, outcomes=outcomes, table=table)
    chance = trial_chances(4, 0, 4)
    seen, real = [], episode.steps
    monkeypatch.setattr(episode, "steps", lambda *a, **k: (seen.append(step) or step for step in real(*a, **k)))
    again = command(*base, "--move", name, *more)

    assert done.code == again.code == 0
    assert done.out.splitlines()[:4] == again.out.splitlines()[:4]
    expected = [int(policy(np.exp(step.log_belief), chance[t])) for t, step in enumerate(seen[:3])]
    assert [row["move"] for row in records(done.out)[:4]] == [*expected, None]


STOPS = ["where:0.5", "both:0.6,0.5", "taps:3", "error:0.3", "each-error:0.3", "msprt:0.1", "lookahead:0.1"]


@pytest.mark.parametrize("name", STOPS)
def test_an_episode_stops_as_the_rule_says(command, folder, session, name):
    """After the first tap at which the rule says so for the beliefs shown."""
    model = load_model(folder / "model.nc")
    more = ["--training", folder / "taps.nc"] if name.startswith("lookahead") else []
    base = ("perceive", folder / "model.nc", "--engine", "filter", "--seed", 4, "--json", *more)
    done = command(*base, "--stop", name)
    *taps, decision = records(done.out)

    assert done.code == 0
    assert (decision["reason"], decision["taps"]) == ("rule", len(taps))
    rule = make_rule(parse_stopping(name), model, 7)
    if not more:
        what, where = (np.array([tap[f"{kind}_marginal"] for tap in taps]) for kind in ("what", "where"))
        number = np.arange(1, len(taps) + 1)
        said = rule(Moment(what, where.max(axis=1), number, np.full(len(taps), np.nan)))
        assert said.tolist() == [GO_ON] * (len(taps) - 1) + [DECIDE]


def test_a_null_decision_is_neither_right_nor_wrong(command, folder):
    base = ("perceive", folder / "model.nc", "--engine", "filter", "--theta", 1, "--give-up", 2, "--episodes", 2)
    *_, last = records(command(*base, "--json").out)
    text = command(*base).out

    assert (last["decision"], last["reason"], last["taps"], last["right"]) == (None, "gave up", 2, None)
    assert "Episode 2: no decision after 2 taps (gave up). Truth:" in text
    assert "given up: no decision" in text
    assert "2 episodes of 2.0 taps on average, 2 null decisions." in text


def test_random_moves_differ_between_episodes_and_seeds(command, folder):
    base = (
        "perceive",
        folder / "model.nc",
        "--engine",
        "filter",
        "--theta",
        1,
        "--deadline",
        6,
        "--json",
        "--start",
        3,
    )

    def moves(*more):
        rows = records(command(*base, "--move", "random", *more).out)
        return [[row["move"] for row in rows if row.get("episode") == number and "move" in row] for number in (1, 2)]

    first, second = moves("--seed", 4, "--episodes", 2)
    assert first != second
    assert moves("--seed", 5)[0] != first


def test_some_of_the_training_taps_are_enough_and_it_is_said(command, folder, session, tmp_path):
    """All of them say nothing."""
    model = load_model(folder / "model.nc")
    known = session.select(np.isin(tap_digests(session.taps), model.training))
    known.select(np.arange(len(known)) % 2 == 0).save(tmp_path / "half.nc")
    base = ("perceive", folder / "model.nc", "--engine", "filter", "--deadline", 2, "--move", "info-what", "--training")
    part, whole = command(*base, tmp_path / "half.nc"), command(*base, folder / "taps.nc")

    assert f"Note: --training contains {len(known) // 2} of the {len(known)} taps that trained" in " ".join(
        part.err.split()
    )
    assert "Note: --training" not in whole.err


def test_taps_that_did_not_train_move_nothing(command, folder, tmp_path):
    """Nor are those of other sessions looked at."""
    simulate_session(preset("paper"), 4, 1).save(tmp_path / "other.nc")
    done = command("perceive", folder / "model.nc", "--move", "info-what", "--training", tmp_path / "other.nc")

    assert done.code == 2
    assert "none of these 1600 taps trained it" in " ".join(done.err.split())


def test_unknown_says_what_it_promises(command, folder):
    """The level with its condition, how soon it can come and what would make that sooner; or that it cannot come."""
    base = ("perceive", folder / "model.nc", "--engine", "numpy", "--seed", 4, "--unknown", 0.1)
    late, refused = command(*base, "--deadline", 40), command(*base, "--deadline", 5)
    said = " ".join(late.out.split())

    assert late.code == 0
    assert "With 95% confidence over the training taps, at most a fraction 0.1 of episodes at a trained object" in said
    assert re.search(r"after \d\d taps at the earliest, as a class has only 5 calibration taps, half of its", said)
    assert re.search(r"; \d+ in each class would allow it after 10 taps\.", said)
    assert refused.code == 2
    assert "--unknown 0.1 is not possible within the --deadline of 5 taps: the answer is possible after" in refused.err


def test_unknown_needs_a_model_that_can_tell(command, folder):
    done = command("perceive", folder / "old.nc", "--unknown", 0.1)

    assert done.code == 2
    assert "no novelty scores" in done.err


def test_a_rig_with_other_steps_is_refused(command, tmp_path, session):
    """A move of the belief must be a move of the sensor."""
    fit(session, session.grid("2mm")).save(tmp_path / "model.nc")
    done = command("perceive", tmp_path / "model.nc", "--engine", "numpy")

    assert done.code == 2
    assert "moves in steps of 1, but the model's positions are 2 apart" in done.err


@pytest.fixture(scope="module")
def fine(folder, session):
    """A model of 0.5 mm classes whose taps carry the evidence of 3 at most."""
    model = fit(session, session.grid("0.5mm"), saturation=3.0, power=0.03)
    model.save(folder / "fine.nc")
    return folder / "fine.nc"


@pytest.mark.parametrize("rig", slow_but(["simulated"], RIGS))
def test_a_finer_grid_perceives(command, fine, folder, rig):
    """The simulated rig moves in its steps, from a place between those of coarser ones."""
    words_ = [*words(folder, rig), *["--training-taps"] * (rig == "replayed")]
    still = ["--start", "2.25mm", "--object", "8 mm rod", "--theta", "1", "--deadline", 5, "--json"]
    done = command("perceive", fine, *words_, *still, "--engine", "numpy", "--shadow", "--fixation", 20)
    *taps, decision = records(done.out)

    assert done.code == 0
    assert decision["true_where"] == pytest.approx(2.25 + 0.5 * sum(tap["move"] for tap in taps[:-1]))
    assert decision["true_where"] == pytest.approx(10.25, abs=0.51)


def test_a_grid_that_no_step_divides_is_refused(command, session, tmp_path):
    fit(session, session.grid("0.8mm")).save(tmp_path / "model.nc")
    done = command("perceive", tmp_path / "model.nc", "--engine", "numpy")

    assert done.code == 2
    assert "moves in steps of 1, but the model's positions are 0.8 apart" in done.err


@pytest.mark.parametrize("engine", ["numpy", "filter"])
def test_evidence_saturates_live(command, fine, engine):
    """Beliefs end far below those of the same taps without a limit."""
    base = ("--seed", 4, "--theta", "1", "--deadline", 12, "--passive", "--json", "--engine", engine)
    limited = records(command("perceive", fine, *base).out)
    replace(load_model(fine), saturation=np.inf).save(fine.with_name("free.nc"), force=True)
    free = records(command("perceive", fine.with_name("free.nc"), *base).out)
    what = [np.array([row["what_marginal"] for row in rows[:-1]]) for rows in (limited, free)]

    np.testing.assert_allclose(what[0][:3], what[1][:3], atol=1e-9)
    assert what[0][-1].max() < what[1][-1].max()


def test_options_come_from_a_setting(command, fine, tmp_path):
    """Threshold, moves, deadline and border are as with options on the command line, which win over it."""
    file = tmp_path / "setting.json"
    setting = Setting.of(
        power=0.03,
        saturation=3.0,
        where_cell="0.5mm",
        threshold=0.93,
        border="clamp",
        theta_x=0.1,
        fixation=9,
        deadline=9,
    )
    setting.save(file)
    base = ("perceive", fine, "--engine", "filter", "--seed", 4, "--json")
    spelled = ("--theta", 0.93, "--border", "clamp", "--theta-x", 0.1, "--fixation", 9, "--deadline", 9)

    def out(*more):
        done = command(*base, *more)
        assert done.code == 0
        return records(done.out)

    assert out("--setting", file) == out(*spelled)
    assert out("--setting", file, "--theta", 1, "--deadline", 2) == out(*spelled, "--theta", 1, "--deadline", 2)
    assert out("--setting", file, "--passive") == out(*spelled[:4], *spelled[-2:], "--passive")
    spelled_moves = ("--theta", 0.93, "--border", "clamp", "--deadline", 9, "--move", "step")
    assert out("--setting", file, "--move", "step") == out(*spelled_moves)
    aiming = (*spelled_moves[:-1], "fixation:0.2", "--fixation", 9)
    assert out("--setting", file, "--move", "fixation:0.2") == out(*aiming)
    assert out("--setting", file, "--move", "fixation", "--fixation", 3) == out(
        *aiming[:-3], "fixation", "--fixation", 3
    )
    setting = setting.changed(passive=True)
    setting.save(file, force=True)
    still = out("--setting", file, "--theta", 1)
    assert [row["move"] for row in still[:-2]] == [0] * 8
    assert out("--setting", file, "--fixation", 9) == out(*spelled)
    assert out("--setting", file, "--move", "step") == out(*spelled_moves)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"power": "J"}, "was fitted with power 0.03, but the setting"),
        ({"saturation": None}, "was fitted with saturation 3, but the setting"),
        ({"model": "gaussian"}, "was fitted with model histogram, but the setting"),
    ],
)
def test_a_model_of_another_setting_is_refused(command, fine, tmp_path, changes, said):
    Setting.of(power=0.03, saturation=3.0).changed(**changes).save(tmp_path / "setting.json")
    done = command("perceive", fine, "--setting", tmp_path / "setting.json")

    assert done.code == 2
    assert said in done.err
    assert done.err.count("\n") == 1


def test_a_replayed_file_with_one_object_replays_that_one(command, folder, session, tmp_path):
    """Drawn objects are those that the file holds."""
    session.select(session.what == 1).save(tmp_path / "one.nc")
    base = ["perceive", folder / "model.nc", "--rig", f"replay:{tmp_path / 'one.nc'}", "--engine", "numpy", "--json"]
    done = command(*base, "--episodes", 3, "--deadline", 1)

    assert {row["true_what"] for row in records(done.out) if "decision" in row} == {"6 mm rod"}


def test_engines_that_disagree_end_with_exit_code_1(command, folder, monkeypatch):
    """One sentence with tap, class and both values; what the shadow follows is compared on every tap."""
    update = NumpyEngine.update
    monkeypatch.setattr(
        NumpyEngine, "update", lambda self, log_belief, tap: (update(self, log_belief, tap)[0] * 1.001, 0.0)
    )
    done = command("perceive", folder / "model.nc", "--engine", "filter", "--shadow")

    assert done.code == 1
    assert done.err.startswith("solidtouch: The engines disagree after tap 1: belief in ")
    assert done.err.count("\n") == 1


def test_a_device_that_fails_ends_with_exit_code_3(command, folder, monkeypatch, tmp_path):
    """And the rig's own context manager is left before."""
    left = []

    @contextmanager
    def broken(*_, **__):
        try:
            raise NoAnswer("/dev/ttyACM0: no frame in 5 s.")
            yield
        finally:
            left.append(True)

    monkeypatch.setattr("solidtouch.hardware.named_rigs.choose_rig", lambda *_: broken)
    done = command("perceive", folder / "model.nc", "--rig", "simulated", "--engine", "numpy")

    assert (done.code, done.err) == (3, "solidtouch: /dev/ttyACM0: no frame in 5 s.\n")
    assert left == [True]


@pytest.mark.parametrize("at", [1, 3])
def test_a_signal_ends_an_episode(command, folder, monkeypatch, tmp_path, at):
    """With a sentence and the usual exit code; lines already printed are whole, and a file has the taps so far."""
    endless = ("--engine", "numpy", "--json", "--theta", 1, "--deadline", 1000000)
    tap, taps = SimulatedRig.tap, []

    def interrupted(rig):
        taps.append(tap(rig))
        if len(taps) == at:
            signal.raise_signal(signal.SIGTERM)
        return taps[-1]

    monkeypatch.setattr(SimulatedRig, "tap", interrupted)
    done = command("perceive", folder / "model.nc", *endless, "--save-episode", tmp_path / "e.json")

    whole = [*range(1, at)]
    assert [record["tap"] for record in records(done.out)] == whole
    assert (tmp_path / "e.json").exists() == bool(whole)
    if whole:
        saved = load_episodes(tmp_path / "e.json")
        assert ([tap.tap for tap in saved.taps], saved.ends) == (whole, [])
    assert done.code == 143
    assert "Traceback" not in done.err
    assert done.err.splitlines()[-1] == "solidtouch: interrupted; no file is left incomplete."


def test_a_terminal_gets_pictures(command, folder, monkeypatch):
    """Drawn anew with each tap; the cursor is given back."""
    controller, terminal = pty.openpty()
    for name, value in (("TERM", "xterm-256color"), ("COLUMNS", "100"), ("LINES", "30")):
        monkeypatch.setenv(name, value)
    parts = []

    def read():
        with suppress(OSError):  # the other end is closed
            while True:
                parts.append(os.read(controller, 65536))

    reader = Thread(target=read)
    reader.start()
    with os.fdopen(terminal, "w", encoding="utf-8") as screen:
        monkeypatch.setattr(sys, "stdout", screen)
        done = command(
            "perceive", folder / "model.nc", "--engine", "numpy", "--theta", 1, "--deadline", 3, "--pace", 0.05
        )
    reader.join(timeout=30)
    os.close(controller)
    out = b"".join(parts)

    assert done.code == 0
    text = out.decode()
    assert text.index("Compiling engine numpy ...") < text.index("Tap 1:")
    assert [n in text for n in ("Tap 1:", "Tap 2:", "Tap 3:")] == [True] * 3
    assert text.count("▲ fixation point") >= 3
    assert text.rindex("\x1b[?25h") > text.rindex("Tap 3:")
    assert np.any([color in text for color in ("48;2;", "48;5;")])
