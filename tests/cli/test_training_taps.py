"""Commands that play trials leave out the sessions that trained the model, by the command line."""

import json

import numpy as np
import pytest
import xarray as xr
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.taps import concatenate

LEFT_OUT = "all 84 taps of session 0 trained the model and are left out; --training-taps keeps them."
PLAYED = "all 84 taps of session 0 trained the model and are kept"
NONE_LEFT = "No tap left to test: all 84 taps of session 0 trained the model."


@pytest.fixture
def folder(make_taps, tmp_path):
    """Two sessions, apart and in one file, and a model of the first."""
    taps = make_taps(sessions=2)
    for s in (0, 1):
        taps.select(taps.session == s).save(tmp_path / f"session-{s}.nc")
    taps.save(tmp_path / "both.nc")
    fit(taps.select(taps.session == 0), taps.grid()).save(tmp_path / "model.nc")
    return tmp_path


def said(text):
    return " ".join(text.split())


@pytest.mark.slow
def test_trials_play_the_other_session(command, folder, tmp_path):
    """The same trials as on a file of the other session alone."""
    words = ("--trials", 40, "--thresholds", "0.9")
    both = command("trials", folder / "model.nc", folder / "both.nc", *words, "--out", tmp_path / "a.nc")
    alone = command("trials", folder / "model.nc", folder / "session-1.nc", *words, "--out", tmp_path / "b.nc")
    kept, expected = (xr.open_dataset(tmp_path / name, engine="h5netcdf") for name in ("a.nc", "b.nc"))

    assert (both.code, both.err) == (0, f"Note: {LEFT_OUT}\n")
    assert (alone.code, alone.err) == (0, "")
    np.testing.assert_array_equal(kept["confusion"], expected["confusion"])
    assert kept.attrs["taps"] == "84 taps of both.nc"


def test_trials_on_training_taps_need_the_option(command, folder):
    """Which warns."""
    words = ("trials", folder / "model.nc", folder / "session-0.nc", "--trials", 20)
    refused, played = command(*words), command(*words, "--training-taps")

    assert refused.code == 2
    assert refused.err.startswith(f"solidtouch: {NONE_LEFT}")
    assert "--training-taps" in refused.err
    assert refused.err.count("\n") == 1
    assert played.code == 0
    assert played.err.startswith(f"Warning: {PLAYED}")
    assert "84 taps of session-0.nc" in said(played.out)


def test_replayed_taps_are_those_of_the_other_session(command, folder):
    """In `perceive` and when learning on a rig."""
    words = ("perceive", folder / "model.nc", "--engine", "numpy", "--json", "--episodes", 2)
    both = command(*words, "--rig", f"replay:{folder / 'both.nc'}")
    alone = command(*words, "--rig", f"replay:{folder / 'session-1.nc'}")
    refused = command(*words, "--rig", f"replay:{folder / 'session-0.nc'}")
    kept = command(*words, "--rig", f"replay:{folder / 'session-0.nc'}", "--training-taps")

    assert both.out == alone.out
    assert json.loads(both.out.splitlines()[-1])["episode"] == 2
    assert f"Note: {LEFT_OUT}" in both.err
    assert "trained the model" not in alone.err
    assert (refused.code, refused.out) == (2, "")
    assert NONE_LEFT in refused.err
    assert kept.code == 0
    assert f"Warning: {PLAYED}" in kept.err

    learn = ("tune", folder / "session-0.nc", folder / "session-1.nc", "--online", 2, "--bins", 9, "--deadline", 5)
    rig = ("--rig", f"replay:{folder / 'both.nc'}", "--out", folder / "setting.json")
    assert f"Note: {LEFT_OUT}" in command(*learn, *rig).err


def test_training_taps_are_asked_for_where_recorded_ones_are_played(command, folder):
    """Nowhere else."""
    replayed = "--training-taps requires --rig replay:FILE."
    for words, sentence in (
        (("perceive", folder / "model.nc", "--training-taps"), replayed),
        (("tune", folder / "both.nc", "--out", folder / "s.json", "--training-taps"), replayed),
        (("reproduce", "--training-taps", "--out", folder / "run"), "--training-taps requires recorded taps."),
    ):
        done = command(*words)
        assert done.code == 2
        assert sentence in done.err


def test_two_files_that_share_a_session_test_the_other(command, folder):
    """In `crosscheck` and `reproduce`."""
    short = ("--episodes", 1, "--length", 3, "--border", "prior", "--bins", 6)
    done = command("crosscheck", folder / "session-0.nc", folder / "both.nc", *short)
    assert done.code == 0
    assert f"Warning: {LEFT_OUT}" in said(done.out)

    itself = (folder / "session-0.nc", folder / "session-0.nc")
    refused = command("crosscheck", *itself, *short)
    assert refused.code == 2
    assert NONE_LEFT in refused.err
    assert f"Warning: {PLAYED}" in said(command("crosscheck", *itself, *short, "--training-taps").out)

    refused = command("reproduce", "--data", *itself, "--out", folder / "run")
    assert refused.code == 2
    assert NONE_LEFT in refused.err
    assert command("fit", *itself, "--out", folder / "again.nc").code == 0


@pytest.mark.slow
def test_reproduce_says_what_it_left_out(command, folder):
    """On standard output, in the summary and on the page."""
    words = ("reproduce", "--data", folder / "session-0.nc", folder / "both.nc", "--out", folder / "run")
    done = command(*words, "--trials", 20, "--thresholds", "0.5,0.9", "--bins", 9, "--quick")

    assert done.code == 0
    assert f"Warning: {LEFT_OUT}" in said(done.out)
    assert LEFT_OUT in json.loads((folder / "run" / "summary.json").read_text())["warnings"]


def test_a_sweep_plays_the_other_session(command, folder):
    """Its study has a key of the option's name."""
    study = folder / "study.toml"
    head = 'name = "s"\ntrials = 20\nthresholds = [0.9]\n'
    text = head + '[[data]]\nname = "rods"\nfiles = ["session-0.nc", "{}"]\n{}\n[grid]\n'
    study.write_text(text.format("both.nc", ""))
    done = command("sweep", study, "--workers", 1)
    assert done.code == 0
    assert f"Data rods: {LEFT_OUT}" in said(done.err)

    study.write_text(text.format("session-0.nc", ""))
    refused = command("sweep", study, "--workers", 1, "--out", folder / "b.zarr")
    assert refused.code == 2
    assert "training_taps = true in a study" in refused.err
    study.write_text(text.format("session-0.nc", "training_taps = true"))
    kept = command("sweep", study, "--workers", 1, "--out", folder / "b.zarr")
    assert kept.code == 0
    assert f"Data rods: {PLAYED}" in said(kept.err)


@pytest.mark.parametrize("name", ["sensitivity", "strategies"])
def test_studies_of_one_file_refuse_a_session_that_stands_there_twice(command, folder, make_taps, name):
    """As sessions are left out in turn, either copy trains where the other tests."""
    taps = make_taps(sessions=2)
    again = taps.select(taps.session == 1)
    again = type(taps)(again.dataset.assign_coords(session=("tap", again.session + 1)))
    concatenate([taps, again]).save(folder / "three.nc")
    simulated = {"sensitivity": ("--data-sets", 0), "strategies": ("--presets", "none")}[name]
    done = command(name, folder / "three.nc", *simulated, "--out", folder / "out")

    assert done.code == 2
    assert "all 84 taps of session 1 trained the model" in done.err


def test_an_audit_refuses_to_measure_on_training_taps(command, folder):
    """Before anything is computed."""
    words = ("audit", folder / "session-0.nc", folder / "session-1.nc", folder / "session-0.nc")
    done = command(*words, "--out", folder / "audit")

    assert done.code == 2
    assert done.err.startswith("solidtouch: No tap left to test: all 84 taps of session-0.nc trained the model.")
    assert not (folder / "audit").exists()
