"""`fit`: what a model file holds, what the command says of it, and what it refuses."""

import numpy as np
import pytest
import xarray as xr
from solidtouch.inference.fit import fit
from solidtouch.models import blocks, storage
from solidtouch.models.io.arviz_tree import to_arviz
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement import student
from solidtouch.models.measurement.likelihood.bins import count_taps
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet


def test_fit_writes_a_model_and_names_what_was_left_out(command, tmp_path, make_taps):
    """Objects without a training tap are left out of the grid, single cells are named."""
    taps = make_taps(L=3, M=4)
    kept = (taps.what != 2) & ~((taps.what == 1) & (taps.where == taps.where.max()))
    taps.select(kept).save(tmp_path / "taps.nc")

    done = command("fit", tmp_path / "taps.nc", "--out", tmp_path / "model.nc", "--bins", 9, "--power", "0.5")

    assert done.code == 0
    assert "Session 0 trains, session 1 tests." in done.out
    assert "3 x 3 (position, object) classes" in done.out
    assert "rod 6 mm, rod 4 mm at 3 mm" in done.out
    model = load_model(tmp_path / "model.nc")
    assert model.counts.shape == (3, 3, 5, 9)
    assert model.power == 0.5


def test_fit_keeps_a_posterior_in_closed_form_instead_of_draws(command, tmp_path, taps_file):
    """From which ArviZ has the draws that --draws and --arviz store."""
    words = ("fit", taps_file, "--model", "gaussian", "--bins", 9, "--seed", 3, "--out")
    assert command(*words, tmp_path / "model.nc").code == 0
    assert command(*words, tmp_path / "drawn.nc", "--draws", 2).code == 0
    taps = TapSet.load(taps_file)
    tree = to_arviz(load_model(tmp_path / "model.nc"), taps.select(taps.session == 0), draws=8)

    with xr.open_datatree(tmp_path / "model.nc", engine="h5netcdf") as kept:
        assert not {"posterior", "log_likelihood"} & set(kept.children)
    with xr.open_datatree(tmp_path / "drawn.nc", engine="h5netcdf") as drawn:
        for group, name in (("posterior", "variance"), ("log_likelihood", "taps")):
            stored = drawn[group][name]
            np.testing.assert_array_equal(stored.values.reshape(8, -1), tree[group][name].values.reshape(8, -1))


@pytest.mark.parametrize(
    "name",
    ["histogram", *(pytest.param(n, marks=pytest.mark.slow) for n in ("gaussian", "profile", "session:gaussian"))],
)
def test_fit_writes_any_model_with_its_draws(command, tmp_path, taps_file, name):
    """The file decides as the model fitted in Python does; the way to it is said."""
    spread = ("--gain-sd", 0.1) if name.startswith("session") else ()
    words = ("--model", name, "--bins", 9, "--draws", 3, *spread)
    done = command("fit", taps_file, "--out", tmp_path / "model.nc", *words)
    model = load_model(tmp_path / "model.nc")
    taps = TapSet.load(taps_file)
    train = taps.select(taps.session == 0)
    expected = fit_model(name, train, taps.grid(), FitSettings(bins=9, gain_sd=0.1)).model

    assert done.code == 0
    assert f"{name}: The posterior is exact" in done.out
    assert model.name == name
    assert model.trained_on == "taps.nc: Session 0 trains, session 1 tests."
    np.testing.assert_array_equal(model.log_likelihood(taps.taps), expected.log_likelihood(taps.taps))
    assert (model.novelty is None) == (name != "histogram")
    with xr.open_datatree(tmp_path / "model.nc", engine="h5netcdf") as tree:
        assert tree["log_likelihood"]["taps"].sizes == {"chain": 4, "draw": 3, "tap": len(train)}
        assert tree.attrs["fit"].startswith("The posterior is exact")


def test_fit_writes_all_that_arviz_needs(command, tmp_path, taps_file):
    """Beside what decides; it is what `to_arviz` gives."""
    words = ("--model", "gaussian", "--bins", 9, "--draws", 8)
    done = command("fit", taps_file, "--out", tmp_path / "model.nc", *words, "--arviz")
    taps = TapSet.load(taps_file)
    train = taps.select(taps.session == 0)
    expected = to_arviz(fit(train, "gaussian", bins=9), train, draws=32)

    assert done.code == 0
    with xr.open_datatree(tmp_path / "model.nc", engine="h5netcdf") as tree:
        for name, group in expected.children.items():
            xr.testing.assert_allclose(tree[name].to_dataset(), group.to_dataset())
    assert load_model(tmp_path / "model.nc").name == "gaussian"
    refused = command("fit", taps_file, "--out", tmp_path / "none.nc", "--arviz", "--draws", 0)
    assert (refused.code, "--arviz requires draws" in refused.err) == (2, True)


@pytest.mark.slow
def test_fit_stores_draws_of_large_recordings_on_request(command, tmp_path, taps_file, monkeypatch):
    """As each would read the whole recording; of a posterior in closed form there is nothing to say."""
    monkeypatch.setattr(storage, "ON_DISK", 0)
    monkeypatch.setattr(student, "_STEPS", 100)
    monkeypatch.setattr(student, "_RUNS", 1)
    words = ("fit", taps_file, "--allow-unconverged", "--bins", 9)
    without = command(*words, "--model", "student", "--out", tmp_path / "student.nc")
    closed = command(*words, "--model", "gaussian", "--out", tmp_path / "gaussian.nc")

    assert (without.code, closed.code) == (0, 0)
    assert "no draws are stored" in without.out
    assert "no draws are stored" not in closed.out
    with xr.open_datatree(tmp_path / "student.nc", engine="h5netcdf") as tree:
        assert "posterior" not in tree.children


def test_fit_keeps_a_saturation(command, tmp_path, taps_file):
    """None where none is asked for."""
    words = ("--draws", 0, "--model", "gaussian")
    for name, more in (("a", ()), ("b", ("--saturation", 2.5))):
        assert command("fit", taps_file, "--out", tmp_path / f"{name}.nc", *words, *more).code == 0

    assert [load_model(tmp_path / f"{name}.nc").saturation for name in "ab"] == [np.inf, 2.5]


def test_fit_writes_no_draws_where_none_are_wanted_or_none_exist(command, tmp_path, taps_file):
    """A histogram without a pseudocount has an improper posterior, which is said."""
    none = command("fit", taps_file, "--out", tmp_path / "a.nc", "--draws", 0)
    improper = command("fit", taps_file, "--out", tmp_path / "b.nc", "--pseudocount", 0, "--draws", 2)

    assert (none.code, improper.code) == (0, 0)
    assert "improper" not in none.out
    assert "Note: without a pseudocount the posterior is improper, so no draws are stored." in improper.out
    for name in "ab":
        with xr.open_datatree(tmp_path / f"{name}.nc", engine="h5netcdf") as tree:
            assert "posterior" not in tree.children


def test_an_interrupted_fit_leaves_no_file(command, tmp_path, taps_file, monkeypatch):
    """Ctrl-C while a block of a large recording is counted, on any thread."""
    monkeypatch.setattr(storage, "ON_DISK", 0)
    monkeypatch.setattr(blocks, "BLOCK", 1)
    before, counted = sorted(tmp_path.iterdir()), []

    def interrupted(*given):
        counted.append(given)
        if len(counted) == 7:
            raise KeyboardInterrupt
        return count_taps(*given)

    monkeypatch.setattr("solidtouch.models.measurement.likelihood.bins.count_taps", interrupted)
    done = command("fit", taps_file, "--out", tmp_path / "model.nc")

    assert done.code == 130
    assert sorted(tmp_path.iterdir()) == before


def test_a_fit_that_did_not_converge_needs_consent(command, tmp_path, taps_file, monkeypatch):
    """Without it there is no file."""
    monkeypatch.setattr("solidtouch.models.measurement.matrix_normal._ROUNDS", 1)
    words = ("fit", taps_file, "--out", tmp_path / "model.nc", "--model", "matrix-normal", "--draws", 0)
    refused = command(*words)
    written = (tmp_path / "model.nc").exists()
    allowed = command(*words, "--allow-unconverged")

    assert (refused.code, allowed.code, written) == (2, 0, False)
    assert "matrix-normal did not converge" in refused.err
    assert "Use it anyway with --allow-unconverged (unconverged=True)." in refused.err
    assert "Warning: the fit did not converge." in allowed.out
    with xr.open_datatree(tmp_path / "model.nc", engine="h5netcdf") as tree:
        assert tree.attrs["converged"] == "False"


@pytest.mark.slow
def test_fit_learns_the_power_on_training_sessions(command, tmp_path, make_taps):
    make_taps(sessions=3, repeats=3).save(tmp_path / "taps.nc")
    words = ("--model", "gaussian", "--power", "learned:2", "--draws", 0, "--bins", 9)
    done = command("fit", tmp_path / "taps.nc", "--out", tmp_path / "model.nc", *words)
    model = load_model(tmp_path / "model.nc")

    assert done.code == 0
    assert "learned on sessions 0, 1, left out in turn" in done.out
    assert "after 2 taps" in model.trained_on
    assert 1e-4 <= model.power <= 1


def test_fit_shows_a_learned_power_beside_a_right_model(command, tmp_path, make_taps):
    make_taps(sessions=3, repeats=3).save(tmp_path / "taps.nc")
    words = ("--power", "learned:2", "--draws", 0, "--bins", 9, "--simulations", 19)
    done = command("fit", tmp_path / "taps.nc", "--out", tmp_path / "model.nc", *words)
    power = load_model(tmp_path / "model.nc").power

    assert done.code == 0, done.err
    assert f"Exponent {power:.2g}; a correct model on 6 training taps per class gives" in done.out


def test_a_split_of_one_session_carries_a_warning(command, tmp_path, make_taps):
    make_taps(sessions=1).save(tmp_path / "taps.nc")

    done = command("fit", tmp_path / "taps.nc", "--out", tmp_path / "model.nc")

    assert "Warning: Training and test taps come from the same session" in done.out
