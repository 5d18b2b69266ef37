"""Commands with a model that is a function of the user's."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.cli.main import run as run_command
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.generic import source

from benchmarks.own_stories import code

CHOSEN = "--fit map --steps 800 --allow-unconverged"


@pytest.fixture
def run(tmp_path, monkeypatch, capsys, make_taps):
    """A function that runs a command beside a file of models and two sessions of taps, and returns what it says."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(source, "_registered", {})
    for name, value in {"_AT_ONCE": 20, "TRIED": 20, "STEPS": 40, "_WINDOW": 10, "RUNS": 1, "STARTS": 1}.items():
        monkeypatch.setattr(fits, name, value)
    others = (Path(__file__).parents[1] / "own_stories.py").read_text("utf-8")
    Path("my_models.py").write_text(f"{others}\n\n{code()}", "utf-8")
    taps = make_taps(J=6, K=3, repeats=4)
    for session in (0, 1):
        taps.select(taps.session == session).save(f"session-{session}.nc")

    def command(line, code=0):
        monkeypatch.setattr(sys, "argv", ["solidtouch", *line.split()])
        with pytest.raises(SystemExit) as ended:
            run_command()
        told = capsys.readouterr()
        assert ended.value.code == code, told
        return told.out + told.err

    return command


def test_a_function_is_fitted_perceives_and_simulates(run):
    fitted = "--allow-unconverged --draws 2 --integrate 2"
    assert "my_models.py:walk: Variational" in run(f"fit session-0.nc --model my_models.py:walk --out walk.nc {fitted}")
    source._registered.clear()
    play = "--rig replay:session-1.nc --json --deadline 3"

    assert "walk.nc: this fit needs the code of my_models.py:walk" in run(f"perceive walk.nc {play}", 2)
    told = run(f"perceive walk.nc {play} --story my_models.py:walk --shadow --engine numpy")
    assert '"decision"' in told
    run("simulate --preset model --model walk.nc --story my_models.py:walk --sessions 1 --out drawn")
    told = run("trials walk.nc session-1.nc --trials 10 --thresholds 0.9 --story my_models.py:walk")
    assert "my_models.py:walk" not in told
    assert "it has no tables" in run("export-model walk.nc --format json --story my_models.py:walk", 2)
    assert Path("drawn/session-0.nc").exists()
    assert "changed since" in _changed(run)


def _changed(run):
    with Path("my_models.py").open("a", encoding="utf-8") as file:
        file.write("\n")
    source._registered.clear()
    return run("simulate --preset model --model walk.nc --story my_models.py:walk --sessions 1 --out more", 2)


def class_means(fit, method):
    """In place of a fit, which takes seconds to compile: the mean of each class and taxel."""
    where, what = fit.batch.where, fit.batch.what
    means = [[fit.samples[(where == l) & (what == m)].mean(axis=(0, 1)) for m in range(4)] for l in range(3)]
    loc = {"loc": np.array(means)}
    return fits.GuidePosterior(loc, lambda _: loc, fits.Convergence(True, f"By hand for {method}.", {}))


@pytest.mark.slow
def test_a_function_is_compared_with_a_built_in_model(run, monkeypatch, sketched):
    """And the page warns that they are on different measures; the method is that of the function alone."""
    monkeypatch.setattr(fits, "posterior", class_means)
    monkeypatch.setattr(fits, "check_prior", lambda _: "")
    models = "--models gaussian,my_models.py:heavy --fit map --allow-unconverged"
    told = run(f"compare session-0.nc session-1.nc {models} --draws 0 --trials 50 --thresholds 0.9 --out compared")

    assert "my_models.py:heavy gives densities of samples" in " ".join(told.split())
    found = json.loads(Path("compared/summary.json").read_text(encoding="utf-8"))["models"]
    assert ["By hand for map." in model["fit"] for model in found] == [False, True]


def test_a_fit_shows_its_steps_and_leaves_nothing_when_it_is_interrupted(run, monkeypatch):
    """Also where a file of another fit would have been overwritten."""

    def interrupted(fit, _):
        fit.progress("my_models.py:walk, steps", 50)(20)
        raise KeyboardInterrupt

    monkeypatch.setattr(fits, "posterior", interrupted)
    monkeypatch.setattr(fits, "check_prior", lambda _: "")
    Path("walk.nc").write_bytes(b"earlier")
    told = run("fit session-0.nc --model my_models.py:walk --out walk.nc --force", 130)

    assert re.search(r"my_models.py:walk, steps .*20/50", told)
    assert "interrupted; no file is left incomplete" in told
    assert Path("walk.nc").read_bytes() == b"earlier"
    assert not [path for path in Path().iterdir() if "walk" in path.name and path.name != "walk.nc"]


UNFIT = [
    (f"tune session-0.nc --model none.py:walk --out a.json {CHOSEN}", "none.py: no such file"),
    ("compare session-0.nc session-1.nc --models gaussian,my_models.py:wlak", "my_models.py: no function 'wlak'"),
    (
        "fit session-0.nc --model session:my_models.py:shifted --out a.nc",
        "my_models.py:shifted has latent variables of sessions (shift)",
    ),
    ("fit session-0.nc --model gaussian --fit svi --out a.nc", "--fit svi"),
    ("fit session-0.nc --model gaussian --steps 900 --out a.nc", "--steps"),
    (
        "fit session-0.nc --model my_models.py:walk --steps 9 --out a.nc",
        "--steps must be an integer of at least 50",
    ),
]
UNFIT_AGAIN = [
    ("fit session-0.nc --model my_models.py:nothing --out a.nc", "my_models.py: no function 'nothing'"),
    ("fit session-0.nc --model none.py:walk --out a.nc", "none.py: no such file"),
    (f"audit session-0.nc session-1.nc --models none.py:walk --out a {CHOSEN}", "none.py: no such file"),
    (
        "compare session-0.nc session-1.nc --models gaussian,session:my_models.py:shifted --draws 0 --out a",
        "my_models.py:shifted has latent variables of sessions (shift)",
    ),
    ("fit session-0.nc --model histogram --fit map --out a.nc", "--fit map"),
]
"""In another command, or of another model."""


@pytest.mark.parametrize(("line", "message"), [*UNFIT, *slow_but((), UNFIT_AGAIN)])
def test_what_cannot_be_fitted_is_refused_in_a_sentence(run, line, message):
    assert message in run(line, 2)
