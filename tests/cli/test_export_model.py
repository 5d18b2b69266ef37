"""`solidtouch export-model`: files for programs without this software, and commands that read them back."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference.engines.engine import NumpyEngine
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.setting_file import Setting

SOLID = Path(__file__).parents[2] / "docs" / "reference" / "conformance" / "solid.c"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with a model of one simulated session, and the taps of another."""
    folder = tmp_path_factory.mktemp("export")
    train, test = (simulate_session(preset("paper"), 2, session) for session in (0, 1))
    fit(train, train.grid()).save(folder / "model.nc")
    test.save(folder / "taps.nc")
    return folder


@pytest.fixture
def model(files, tmp_path):
    """The file of the model, in a folder of its own."""
    return Path(shutil.copy(files / "model.nc", tmp_path))


def test_trials_and_perceive_answer_the_same_for_both_files(files, model, command):
    """Tables of trials and every number of an episode, but for p-values, which the exported file cannot give."""
    done = command("export-model", model, "--format", "json")
    words = files / "taps.nc", "--trials", 300, "--deadline", 30
    episodes = []
    for name in ("model.nc", "model.json"):
        played = command(
            *("perceive", model.with_name(name), "--rig", f"replay:{files / 'taps.nc'}"),
            *("--engine", "numpy", "--json", "--seed", 5),
        )
        episodes.append([json.loads(line) for line in played.out.splitlines()])
        for step in episodes[-1]:
            step.pop("p", None)
            step.pop("unusual", None)
    played = command("trials", model.with_suffix(".json"), *words)

    assert done.code == 0
    assert done.out == (
        "histogram: 16 x 5 (position, object) classes, 12 taxels, 50 samples, 100 bins, "
        f"in {model.with_suffix('.json')}\n"
    )
    assert played.out == command("trials", model, *words).out
    assert played.code == 0
    assert episodes[0] == episodes[1]
    assert len(episodes[0]) > 1


def test_options_win_over_a_setting_and_a_setting_over_defaults(model, tmp_path, command):
    """The middle is the fixation point where nothing is said; a passive setting never moves, unless it is told to."""
    Setting.of(threshold=0.7, border="clamp", theta_x=0.25, fixation=3).save(tmp_path / "active.json")
    Setting.of(passive=True).save(tmp_path / "passive.json")
    out = tmp_path / "out.json"

    def chosen(*words):
        assert command("export-model", model, "--format", "json", "--out", out, "--force", *words).code == 0
        values = json.loads(out.read_text(encoding="utf-8"))
        return [values[key] for key in ("border", "thresholds", "theta_x", "fixation")]

    assert chosen() == ["uniform", [0.95], 0.0, 7]
    assert chosen("--setting", tmp_path / "active.json") == ["clamp", [0.7], 0.25, 3]
    assert chosen("--setting", tmp_path / "passive.json") == ["uniform", [0.95], 1.0, 7]
    assert chosen("--setting", tmp_path / "passive.json", "--fixation", 2) == ["uniform", [0.95], 0.0, 2]
    words = "--border", "prior", "--threshold", 0.8, "--theta-x", 0.5, "--fixation", 4
    assert chosen("--setting", tmp_path / "active.json", *words) == ["prior", [0.8], 0.5, 4]


def test_a_limit_on_the_evidence_is_said(make_taps, tmp_path, command):
    """In the file, and in a sentence to who exports it."""
    taps = make_taps()
    fit(taps, taps.grid(), bins=9, saturation=2.5).save(tmp_path / "model.nc")
    done = command("export-model", tmp_path / "model.nc", "--format", "c-header")

    assert "an episode's evidence is capped at 2.5 taps" in done.out
    assert "#define SOLIDTOUCH_SATURATION 2.5\n" in (tmp_path / "model.h").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--format", "json", "--single"), "--single requires --format c-header"),
        (("--format", "json", "--out", "model.h"), "--out must end in .json with --format json, got model.h"),
        (("--format", "c-header", "--out", "model.c"), "--out must end in .h or .hpp with --format c-header"),
        (("--format", "json", "--threshold", "1.5"), "--threshold must be a number from 0 to 1, got 1.5"),
        (("--format", "json", "--theta-x", "-1"), "--theta-x must be a number from 0 to 1, got -1"),
        (("--format", "json", "--fixation", "16"), "The fixation point must be an index from 0 to 15, got 16"),
        (("--format", "json", "--out", "no/model.json"), "no/model.json: cannot write: no folder no"),
        (("--format", "json", "--setting", "no.json"), "no.json: no such file"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_what_cannot_be_is_one_sentence(model, command, words, message):
    done = command("export-model", model, *words)

    assert (done.code, done.err.count("\n")) == (2, 1)
    assert message in done.err
    assert sorted(path.name for path in model.parent.iterdir()) == ["model.nc"]


def test_a_setting_of_another_model_is_refused(model, tmp_path, command):
    Setting.of(bins=64).save(tmp_path / "other.json")
    done = command("export-model", model, "--format", "json", "--setting", tmp_path / "other.json")

    assert done.code == 2
    assert "was fitted with bins 100, but the setting" in done.err


def test_a_file_is_replaced_by_force_only(make_taps, tmp_path, command):
    taps, model = make_taps(), tmp_path / "model.nc"
    fit(taps, taps.grid(), bins=9).save(model)
    words = "export-model", model, "--format", "c-header"
    assert command(*words, "--single").code == 0
    done = command(*words)
    single = model.with_suffix(".h").read_text(encoding="utf-8")

    assert done.code == 2
    assert "model.h: already exists; use --force to overwrite it" in done.err
    assert command(*words, "--force").code == 0
    assert "SOLIDTOUCH_REAL float\n" in single
    assert "SOLIDTOUCH_REAL double\n" in model.with_suffix(".h").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_small_c_program_reads_both_files(files, model, tmp_path, command):
    """On simulated taps it believes what the reference does: with the header compiled in, and with the JSON as case."""
    if shutil.which("cc") is None:
        pytest.skip("there is no compiler cc")
    for layout in ("json", "c-header"):
        assert command("export-model", model, "--format", layout, "--border", "circular").code == 0
    words = "cc", "-O1", "-std=c99", SOLID, f"-I{tmp_path}"
    subprocess.run([*words, "-o", tmp_path / "case", "-lm"], check=True)
    subprocess.run([*words, '-DMODEL_HEADER="model.h"', "-o", tmp_path / "robot", "-lm"], check=True)
    fitted, taps = load_model(model), simulate_session(preset("paper"), 2, 1).taps[::160].astype(np.float64)
    engine, log_belief, beliefs, lines = NumpyEngine(fitted, "circular"), fitted.log_prior, [], []
    for number, tap in enumerate(taps):
        move = 0 if number == 0 else 3 - number
        lines.append(json.dumps({"tap": number + 1, "move": move, "samples": tap.tolist()}) + "\n")
        log_belief, _ = engine.update(engine.shift(log_belief, move), tap)
        beliefs.append(np.exp(log_belief))
    header = model.with_suffix(".json").read_text(encoding="utf-8")
    for program, text in (("robot", "".join(lines)), ("case", header + "".join(lines))):
        answers = subprocess.check_output([tmp_path / program], input=text, text=True).splitlines()
        found = [json.loads(answer)["posterior"] for answer in answers]
        np.testing.assert_allclose(found, beliefs, rtol=0, atol=1e-12)
