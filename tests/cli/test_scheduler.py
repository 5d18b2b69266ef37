"""The option --scheduler of studies, without a cluster."""

import subprocess
import sys

import pytest

NOWHERE = "--scheduler", "tcp://127.0.0.1:1"
FEW = {
    "compare": ("--models", "histogram", "--draws", 0, "--trials", 10),
    "sensitivity": ("--data-sets", 0, "--trials", 50),
    "strategies": ("--presets", "none", "--trials", 50),
}


@pytest.fixture
def data(make_taps, tmp_path):
    taps = make_taps(L=2, M=2, J=2, K=2, sessions=3, repeats=6)
    taps.save(tmp_path / "taps.nc")
    return tmp_path / "taps.nc"


@pytest.mark.parametrize("study", FEW)
def test_a_scheduler_that_is_not_there_is_one_sentence(command, data, tmp_path, study):
    done = command(study, data, *FEW[study], "--out", tmp_path / "out", *NOWHERE, "--patience", 0.2)

    assert done.code == 2
    assert done.err.splitlines()[-1] == "solidtouch: There is no Dask scheduler at tcp://127.0.0.1:1 after 0.2 s."


def test_a_fit_has_simulations_to_spread(command, data, tmp_path, monkeypatch):
    """The scheduler is looked for before the fit."""
    monkeypatch.setattr("solidtouch.inference.tuning.tempering.fit_tempered", None)
    words = "fit", data, "--out", tmp_path / "model.nc", *NOWHERE, "--patience", 0.2
    alone = command(*words)
    learned = command(*words, "--power", "learned:2", "--simulations", 19)

    assert (alone.code, learned.code) == (2, 2)
    assert "--scheduler requires --simulations; the fit of one model is not divided." in alone.err
    assert "There is no Dask scheduler at tcp://127.0.0.1:1 after 0.2 s." in learned.err


@pytest.mark.parametrize("study", ["sensitivity", "strategies"])
def test_workers_and_a_scheduler_exclude_each_other(command, data, tmp_path, study):
    done = command(study, data, *FEW[study], "--out", tmp_path / "out", *NOWHERE, "--workers", 2)

    assert done.code == 2
    assert "--workers cannot be combined with --scheduler" in done.err


@pytest.mark.slow
def test_the_program_finds_dask_though_it_hides_it_from_other_commands(data, tmp_path):
    """Which xarray would import otherwise."""
    words = [
        "compare",
        str(data),
        *map(str, FEW["compare"]),
        "--out",
        str(tmp_path / "out"),
        *NOWHERE,
        "--patience=0.2",
    ]
    done = subprocess.run([sys.executable, "-m", "solidtouch.cli", *words], capture_output=True, text=True, check=False)

    assert done.returncode == 2
    assert "There is no Dask scheduler at tcp://127.0.0.1:1 after 0.2 s." in done.stderr
