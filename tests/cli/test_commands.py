"""What commands say to bad input and wrong use, and what is common to them."""

import importlib
import re
import subprocess
import sys
from inspect import signature

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.inference.fit import fit
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.registry import NAMES
from solidtouch.models.setting_file import Setting


def test_the_version_is_printed(command):
    done = command("--version")

    assert done.code == 0
    assert done.out.startswith("solidtouch ")


def test_help_names_every_model(command):
    done = command("fit", "--help")

    assert [name for name in NAMES if name not in done.out] == []


@pytest.fixture
def unlike(tmp_path, make_taps):
    """A model, and taps with more taxels and other positions."""
    make_taps().save(tmp_path / "taps.nc")
    make_taps(K=7).save(tmp_path / "wide.nc")
    make_taps(L=5).save(tmp_path / "long.nc")
    fit(make_taps(), bins=9).save(tmp_path / "model.nc")
    return tmp_path


def test_files_that_do_not_fit_are_named(command, unlike):
    taps, wide, model = (unlike / name for name in ("taps.nc", "wide.nc", "model.nc"))
    runs = {
        f"{taps} has 5 taxels and {wide} has 7": ("fit", taps, wide, "--out", unlike / "new.nc"),
        f"{wide}: Taps must have 6 samples and 5 taxels": ("trials", model, wide),
        "wide.nc: Taps must have": ("perceive", model, "--rig", f"replay:{wide}"),
    }

    for message, words in runs.items():
        done = command(*words)
        assert done.code == 2
        assert message in done.err


@pytest.mark.slow
def test_files_with_other_positions_are_compared(command, unlike, sketched):
    """Sessions are left out of both together; a single model is named."""
    words = ("--models", "histogram", "--draws", 0, "--trials", 20, "--thresholds", 0.5, "--out", unlike / "out")
    done = command("compare", unlike / "taps.nc", unlike / "long.nc", "--training-taps", *words)

    assert done.code == 0, done.err
    assert "Only one model, histogram, could be fitted, so nothing is compared." in " ".join(done.out.split())


def test_a_single_object_is_named(command, tmp_path, make_taps):
    """By the commands that would show it errors of zero."""
    data, model = tmp_path / "taps.nc", tmp_path / "model.nc"
    taps = make_taps()
    taps.select(taps.what == 1).save(data)
    runs = [
        command("inspect", data),
        command("fit", data, "--out", model),
        command("trials", model, data, "--trials", 100, "--training-taps"),
    ]

    for done in runs:
        assert done.code == 0
        assert "All taps are of one object, rod 4 mm: it cannot be confused" in " ".join(done.out.split())


SENTENCES = [
    (["fit", "MISSING", "--out", "MODEL"], "missing.nc: no such file"),
    (["fit", "FOLDER", "--out", "MODEL"], "no .csv files"),
    (["fit", "TAPS", "--out", "TAPS"], "already exists; use --force"),
    (["fit", "TAPS", "--out", "OUT"], "must end in .nc"),
    (["fit", "TAPS", "--out", "NOWHERE"], "no folder"),
    (["fit", "TAPS", "--out", "MODEL", "--power", "K"], "power must be J, JK, none or a positive number, got 'K'"),
    (["fit", "TAPS", "--out", "MODEL", "--power", "K"], "got 'K'; learned estimates it"),
    (["fit", "TAPS", "--out", "MODEL", "--power", "learned"], "needs at least two training sessions"),
    (["fit", "TAPS", "--out", "MODEL", "--simulations", "19"], "--simulations requires --power learned"),
    (["fit", "TAPS", "--out", "MODEL", "--power", "learned", "--simulations", "5"], "must be 0 or at least 19"),
    (["fit", "TAPS", "--out", "MODEL", "--model", "gauss"], "Unknown model 'gauss'; choose from histogram"),
    (["fit", "TAPS", "--out", "MODEL", "--fit", "nuts"], "fit of the histogram model is exact"),
    (["fit", "TAPS", "--out", "MODEL", "--gain-sd", "0.1"], "require a session model, got histogram"),
    (["crosscheck", "TAPS", "--model", "session", "--border", "prior"], "border 'prior' does not support models"),
    (["fit", "TAPS", "--out", "MODEL", "--saturation", "0"], "saturation must be a positive number of taps"),
    (["fit", "TAPS", "--out", "MODEL", "--where-cell", "3kg"], "(--where-cell) '3kg' cannot be converted"),
    (["fit", "TAPS", "--out", "MODEL", "--train", "0", "--test", "7"], "--test: no session 7"),
    (["fit", "TAPS", "--out", "MODEL", "--split", "leave-one-session-out"], "gives 2 models"),
    (["fit", "TAPS", "TAPS", "TAPS", "--out", "MODEL"], "Give one data file, or two"),
    (["fit", "TAPS", "--out", "MODEL", "--where-cell", "1e-9"], "too narrow"),
    (["crosscheck", "FOREIGN"], "foreign.npz"),
    (["reproduce", "TAPS"], "name recorded taps with --data"),
    (["reproduce", "--data", "TAPS", "--out", "TAPS"], "is a file, expected a folder"),
    (["reproduce", "--data", "TAPS", "--out", "FULL"], "already exists; use --force"),
    (["reproduce", "--data", "TAPS", "--out", "OUT", "--fixation", "3"], "must be an index from 0"),
    (["reproduce", "--data", "TAPS", "--out", "OUT", "--thresholds", "1.5"], "--thresholds must be distinct"),
    (["reproduce", "--data", "TAPS", "--out", "OUT", "--theta-x", "2"], "--theta-x must be a number from 0 to 1"),
    (["reproduce", "--split", "parity", "--out", "OUT"], "--split requires recorded taps"),
    (["reproduce", "--preset", "papre", "--out", "OUT"], "Unknown preset 'papre'"),
]  # fmt: skip
AGAIN = [
    (["fit", "TAPS", "--out", "MODEL", "--power", "learned:0"], "a number of taps N, got 'learned:0'"),
    (["crosscheck", "TAPS", "--model", "profile:session"], "Unknown model 'profile:session'"),
    (["reproduce", "--data", "TAPS", "--out", "OUT", "--model", "student:x"], "Unknown model 'student:x'"),
    (["reproduce", "--data", "TAPS", "--out", "OUT", "--power", "learned"], "needs at least two training sessions"),
    (["reproduce", "--data", "TAPS", "--out", "OUT", "--saturation", "-1"], "saturation must be a positive"),
    (["fit", "TAPS", "--out", "MODEL", "--split", "thirds"], "thirds"),
    (["fit", "TAPS", "--out", "/dev/null", "--force"], "must end in .nc"),
    (["reproduce", "--data", "MISSING", "--out", "OUT"], "missing.nc: no such file"),
    (["reproduce", "--data", "TAPS", "--out", "OUT", "--thresholds", "a"], "--thresholds must be numbers"),
    (["reproduce", "--data", "TAPS", "--out", "OUT", "--border", "clamp", "--power", "-1"], "power"),
    (["reproduce", "--data", "TAPS", "--data-sets", "3", "--out", "OUT"], "--data-sets requires simulated taps"),
    (
        ["reproduce", "--data", "TAPS", "--out", "OUT", "--model", "session", "--border", "prior"],
        "border 'prior' does not support models that carry a state",
    ),
]  # fmt: skip
"""Input that others of these commands, or tests of what they call, are given too."""


@pytest.mark.parametrize(
    ("words", "said"),
    [*SENTENCES, *slow_but((), AGAIN)],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_is_one_sentence_and_exit_code_2(words, said, command, tmp_path, taps_file):
    """The sentence names the culprit, nothing is written and nothing overwritten."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    (tmp_path / "foreign.npz").write_bytes(b"\x89PNG nothing")
    names = {
        "TAPS": taps_file, "OUT": tmp_path / "out", "MODEL": tmp_path / "out.nc",
        "MISSING": tmp_path / "missing.nc", "FOLDER": tmp_path / "folder",
        "NOWHERE": tmp_path / "no" / "model.nc", "FULL": tmp_path / "full", "FOREIGN": tmp_path / "foreign.npz",
    }  # fmt: skip
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    done = command(*(names.get(word, word) for word in words))

    sentence = done.err.strip().splitlines()[-1]
    assert done.code == 2
    assert sentence.startswith("solidtouch: ")
    assert said in sentence
    assert "Traceback" not in done.err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert not list(tmp_path.glob("out*"))


@pytest.mark.parametrize(
    "words", [["fit"], ["crosscheck", "x", "--bins", "0"], ["reproduce", "--engine", "fast"], ["tap"]]
)
def test_wrong_options_exit_with_code_2(words, command):
    assert command(*words).code == 2


def test_too_little_memory_is_one_sentence(command, taps_file, tmp_path, monkeypatch):
    """An allocation that fails is no traceback."""

    def refuse(*args, **more):
        raise MemoryError("Unable to allocate 17 TiB")

    monkeypatch.setattr("solidtouch.models.measurement.histogram.bin_edges", refuse)
    done = command("fit", taps_file, "--out", tmp_path / "model.nc")

    assert done.code == 2
    assert done.err == "solidtouch: not enough memory (Unable to allocate 17 TiB).\n"


def test_a_file_tested_on_itself_is_named(command, taps_file, tmp_path):
    done = command("fit", taps_file, taps_file, "--out", tmp_path / "model.nc")

    assert "Warning: all 84 taps of session 0 and all 84 taps of session 1 trained the model" in done.out


@pytest.mark.parametrize("module", slow_but(["jax"], ["solidtouch.analysis.reproduce.report", "jax"]))
def test_an_interrupt_while_libraries_load_ends_the_program(module, tmp_path):
    """At once, with the sentence and exit code of every interrupt."""
    code = (
        "import os, signal\n"
        "from solidtouch.cli.shared.interrupt import loading\n"
        "with loading():\n"
        f"    import {module}\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    print('still here')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)

    assert done.returncode == 130
    assert done.stdout == ""
    assert done.stderr == "solidtouch: interrupted; no file is left incomplete.\n"


def test_a_model_refuses_taps_prepared_otherwise(command, tmp_path, make_taps):
    """Two files with different records cannot train and test each other."""
    taps = make_taps()
    taps.save(tmp_path / "train.nc")
    other = taps.preprocessing.to_json().replace("50.0", "40.0")
    type(taps)(taps.dataset.assign_attrs(preprocessing=other)).save(tmp_path / "test.nc")

    done = command("fit", tmp_path / "train.nc", tmp_path / "test.nc", "--out", tmp_path / "model.nc")

    assert done.code == 2
    assert "rate_hz is 50.0" in done.err
    assert np.array_equal([False], [(tmp_path / "model.nc").exists()])


@pytest.mark.parametrize(
    ("name", "given", "least"),
    [
        ("compare", {"draws": 100, "trials": 500, "folds": 1}, {"draws": 0, "trials": 7, "folds": 1}),
        ("audit", {"trials": 500, "permutations": 119}, {"trials": 100, "permutations": 99}),
    ],
)
def test_a_preview_takes_less_of_everything(command, monkeypatch, taps_file, name, given, least):
    """But never more than what options ask for."""

    def caught(*_, **settings):
        seen.append(settings)
        raise InputError("enough")

    seen, module = [], importlib.import_module(f"solidtouch.analysis.{name}.report")
    usual = signature(getattr(module, name)).parameters
    monkeypatch.setattr(module, name, caught)
    words = [word for option, value in least.items() for word in (f"--{option}", value)]
    for more in ((), ("--quick",), ("--quick", *words)):
        assert command(name, taps_file, *more).err.endswith("enough\n")

    fewer = {option: value for option, value in seen[1].items() if option not in {*seen[0], "preview"}}
    assert {"resamples", "replicates"} <= fewer.keys()
    assert all(usual[option].default > value for option, value in fewer.items())
    full, quick, small = ({option: settings[option] for option in given} for settings in seen)
    assert all(full[option] > quick[option] for option in given)
    assert (quick, small) == (given, least)


@pytest.mark.parametrize(
    "words",
    [("inspect",), ("fit", "--out", "m.nc"), ("export-model", "--format", "json", "--out", "m.json"), ("rig", "check")],
)
def test_a_name_that_no_file_can_have_is_refused(command, words):
    done = command(*words, "9" * 400)

    assert done.code == 2
    assert re.search(r"^solidtouch: (--\w+ )?9{400}: (cannot read: )?(File name too long|no such file)", done.err), (
        done.err
    )


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["perceive"], "missing argument 'MODEL'; see `solidtouch perceive --help`."),
        (
            ["perceive", "m.nc", "--episodes", "0"],
            "--episodes must be at least 1, got 0; see `solidtouch perceive --help`.",
        ),
        (["fit", "a", "--bins", "x"], "--bins must be a whole number, got 'x'; see `solidtouch fit --help`."),
        (["nope"], "no such command 'nope'; see `solidtouch --help`."),
        (["rig", "nope"], "no such command 'nope'; see `solidtouch rig --help`."),
        (["perceive", "m.nc", "--engine", "x"], "--engine is wrong: 'x' is not one of 'numpy', 'numpyro', 'filter'"),
    ],
)
def test_wrong_use_is_one_plain_sentence(command, words, sentence):
    """Without a box and without words of libraries."""
    done = command(*words)

    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert done.err.startswith(f"solidtouch: {sentence}")


def test_a_file_that_is_no_model_is_named_for_what_it_is(command, tmp_path):
    Setting().save(tmp_path / "setting.json")
    done = command("perceive", tmp_path / "setting.json")

    assert (done.code, "setting.json: not a model but a setting" in done.err) == (2, True)


def test_a_hint_and_a_refusal_come_once(command, tmp_path):
    """The way to other layouts is named once, and no empty line comes first."""
    (tmp_path / "x.csv").write_text("a,b\n1,2\n")
    (tmp_path / "bad.toml").write_text("foo = 1\n")

    assert command("convert", tmp_path / "x.csv", tmp_path / "x.nc").err.count("--look") == 1
    assert command("sweep", tmp_path / "bad.toml").err.startswith("solidtouch: ")
