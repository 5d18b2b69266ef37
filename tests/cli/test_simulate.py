"""`solidtouch simulate`, called as a function."""

import re

import numpy as np
import pytest
from solidtouch.analysis.reproduce.report import simulated_split
from solidtouch.cli.simulate import simulate
from solidtouch.hardware.simulator.model_rig import draw_taps
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet


def test_every_session_becomes_one_file(tmp_path, capsys):
    """The files hold the sessions of this preset and seed, in a folder made for them."""
    out = tmp_path / "new" / "folder"
    simulate(out, preset="hold2", sessions=2, seed=4)

    assert sorted(path.name for path in out.iterdir()) == ["session-0.nc", "session-1.nc"]
    loaded = TapSet.load(out / "session-1.nc")
    np.testing.assert_array_equal(simulate_session(PRESETS["hold2"], 4, 1).taps, loaded.taps)
    assert set(loaded.session) == {1}
    assert "2 sessions of preset hold2" in capsys.readouterr().out


def test_existing_files_are_kept_unless_forced(tmp_path):
    """One file in the way stops the command before it writes any."""
    (tmp_path / "session-1.nc").write_text("mine")
    with pytest.raises(InputError, match=r"session-1\.nc: already exists; use --force"):
        simulate(tmp_path, sessions=2)

    assert [tmp_path / "session-1.nc"] == list(tmp_path.iterdir())

    simulate(tmp_path, sessions=2, force=True)

    assert len(TapSet.load(tmp_path / "session-1.nc")) == 1600


def test_preset_model_draws_from_a_fitted_model(tmp_path):
    """Samples per tap and taps per class can be chosen; the classes are the model's."""
    taps = simulate_session(PRESETS["paper"], 0, 0)
    fit(taps, taps.grid()).save(tmp_path / "model.nc")
    simulate(tmp_path, preset="model", sessions=1, model=tmp_path / "model.nc", samples=3, taps_per_class=2)
    drawn = TapSet.load(tmp_path / "session-0.nc")

    assert drawn.taps.shape == (160, 3, 12)
    assert drawn.preprocessing.samples == 3
    assert taps.grid().differences(drawn.grid()) == []


def test_histograms_give_the_numbers_that_they_always_gave(tmp_path):
    """Those of their tables with the same seed and session."""
    taps = simulate_session(PRESETS["ideal"], 0, 0)
    model = fit(taps, taps.grid())
    model.save(tmp_path / "model.nc")
    simulate(tmp_path, preset="model", sessions=2, seed=3, model=tmp_path / "model.nc", taps_per_class=2)
    expected = draw_taps(model.grid, model.probabilities, model.edges, model.preprocessing, 2, 3, 1, model.trained)

    np.testing.assert_array_equal(TapSet.load(tmp_path / "session-1.nc").taps, expected.taps)


@pytest.mark.parametrize("name", ["gaussian", "profile-ar", "session:profile"])
def test_taps_are_drawn_from_any_model(tmp_path, make_taps, name):
    """Of its classes, and as its form says."""
    taps = make_taps(L=3, M=4, J=6, K=5)
    fit_model(name, taps, taps.grid(), FitSettings(bins=9, gain_sd=0.1, offset_sd=0.2)).model.save(
        tmp_path / "model.nc"
    )
    simulate(tmp_path, preset="model", sessions=1, model=tmp_path / "model.nc", taps_per_class=2)
    drawn = TapSet.load(tmp_path / "session-0.nc")

    assert drawn.taps.shape == (24, 6, 5)
    assert taps.grid().differences(drawn.grid()) == []
    assert f"drawn from a fitted {name} model" in drawn.dataset.attrs["source"]


def test_a_data_set_of_reproduce_can_be_made_again(command, tmp_path):
    """By its number, and by the seed that is printed."""
    fold = simulated_split("ideal", 3, 5).folds[2]
    done = command("simulate", "--preset", "ideal", "--seed", 5, "--data-set", 2, "--out", tmp_path / "a")
    own = re.search(r"data set 2 \(its own seed is (\d+)\)", done.out)[1]
    simulate(tmp_path / "b", preset="ideal", sessions=1, seed=int(own))

    for session, taps in enumerate((fold.train, fold.test)):
        np.testing.assert_array_equal(TapSet.load(tmp_path / "a" / f"session-{session}.nc").taps, taps.taps)
    np.testing.assert_array_equal(TapSet.load(tmp_path / "b" / "session-0.nc").taps, fold.train.taps)


def test_seeds_that_no_data_set_has_are_refused(command, tmp_path):
    """By the command line."""
    assert command("simulate", "--seed", -1, "--out", tmp_path / "a").code == 2
    assert command("simulate", "--data-set", -1, "--out", tmp_path / "a").code == 2


REFUSED = {
    "unknown preset": ({"preset": "papr"}, "choose from paper, ideal, broken, hold2, nodrift, model"),
    "no session": ({"sessions": 0}, "--sessions must be at least 1, got 0"),
    "model without a file": ({"preset": "model"}, "--preset model requires --model"),
    "file without preset model": ({"samples": 3}, "require --preset model"),
}


@pytest.mark.parametrize(("options", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_bad_options_are_refused_before_anything_is_written(tmp_path, options, message):
    """The message names the option and the folder is not made."""
    with pytest.raises(InputError, match=message):
        simulate(tmp_path / "out", **options)

    assert not (tmp_path / "out").exists()


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    """The message names it."""
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match=r"out: cannot create the folder"):
        simulate(tmp_path / "out")
