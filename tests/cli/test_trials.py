"""`solidtouch trials`: counts of any number of trials."""

import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.trials import spread
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference.trials.records import plan_trials, tap_table
from solidtouch.inference.trials.resampling import RESAMPLES
from solidtouch.inference.trials.run import run_trials
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings, PlaySettings
from solidtouch.models.taps import concatenate


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A model of one session and the taps of another."""
    folder = tmp_path_factory.mktemp("trials")
    train, test = (simulate_session(preset("paper"), 2, session) for session in (0, 1))
    model = fit(train, train.grid())
    model.save(folder / "model.nc")
    test.save(folder / "taps.nc")
    return folder, model, test


def test_the_file_holds_the_trials_of_the_plan(files, command, tmp_path):
    """Means and counts are those of the same trials kept one by one."""
    folder, model, test = files
    done = command(
        *("trials", folder / "model.nc", folder / "taps.nc", "--trials", 500, "--thresholds", "0.9,0.5"),
        *("--fixation", 6, "--theta-x", 0.3, "--seed", 3, "--deadline", 20, "--out", tmp_path / "out.nc"),
    )
    table = tap_table(model, test)
    plan = plan_trials(table.pool, 500, 3, fixation=6)
    trials = run_trials(table, plan, (0.5, 0.9), play=PlaySettings(theta_x=0.3, deadline=20), seed=3)
    wrong = trials.what != plan.what[:, None]
    error = model.grid.what_error(trials.what, plan.what[:, None])
    kept = xr.load_dataset(tmp_path / "out.nc")

    assert done.code == 0
    assert "500 of 500 trials, active to 6.5 mm, theta_X 0.3, from anywhere, on 1600 taps of" in " ".join(
        done.out.split()
    )
    assert done.err == ""
    assert kept.attrs["trials"] == kept.attrs["requested_trials"] == 500
    assert (kept.attrs["policy"], kept.attrs["seed"], kept.attrs["deadline"]) == ("active", 3, 20)
    assert kept["what_wrong"].attrs["long_name"]
    np.testing.assert_allclose(kept["what_error"], error.mean(axis=0))
    np.testing.assert_allclose(kept["what_error_se"], error.std(axis=0, ddof=1) / np.sqrt(500))
    np.testing.assert_allclose(
        kept["where_error"], model.grid.where_error(trials.where, trials.true_where).mean(axis=0)
    )
    np.testing.assert_allclose(kept["taps"], trials.taps.mean(axis=0))
    np.testing.assert_allclose(kept["taps_se"], trials.taps.std(axis=0, ddof=1) / np.sqrt(500))
    np.testing.assert_allclose(kept["what_wrong"], wrong.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(kept["stopped_fraction"], trials.stopped.mean(axis=0))
    np.testing.assert_allclose(kept["belief"], trials.belief.mean(axis=0))
    assert int(kept["confusion"].sel(theta=0.9).sum()) == 500


def test_single_taps_that_trained_the_model_are_left_out(files, command, tmp_path):
    """Where they come in another file, among others."""
    folder, _, test = files
    train = simulate_session(preset("paper"), 2, 0)
    concatenate([train.select(np.arange(7)), test]).save(tmp_path / "both.nc")
    words = "trials", folder / "model.nc", tmp_path / "both.nc", "--trials", 5
    done = command(*words)

    assert "Note: all 7 taps of session 0 trained the model and are left out" in done.err
    assert "on 1600 taps of both.nc" in " ".join(done.out.split())


def test_the_code_for_graphics_processors_counts_the_same(files, command):
    folder, _, _ = files
    words = "trials", folder / "model.nc", folder / "taps.nc", "--trials", 300, "--deadline", 30

    assert command(*words).out == command(*words, "--device", "xla-cpu").out


def test_passive_trials_stay_where_they_start(files, command, tmp_path):
    folder, _, _ = files
    words = "trials", folder / "model.nc", folder / "taps.nc", "--trials", 40, "--passive", "--start", 5
    assert command(*words, "--out", tmp_path / "out.nc").code == 0

    place = xr.load_dataset(tmp_path / "out.nc")["place"].sum(("theta", "decided_where"))
    assert np.flatnonzero(place).tolist() == [5]


@pytest.mark.parametrize("name", [pytest.param("profile", marks=pytest.mark.slow), "session:gaussian"])
def test_any_fitted_model_is_played(command, make_taps, tmp_path, name):
    """As the trials of its table; one in states refuses the border prior."""
    taps = make_taps()
    train, test = taps.select(taps.session == 0), taps.select(taps.session == 1)
    model = fit_model(name, train, taps.grid(), FitSettings(bins=9, gain_sd=0.1, offset_sd=0.1)).model
    model.save(tmp_path / "model.nc")
    taps.save(tmp_path / "taps.nc")
    words = ("trials", tmp_path / "model.nc", tmp_path / "taps.nc", "--test", 1, "--trials", 90, "--thresholds", 0.9)
    done = command(*words, "--out", tmp_path / "out.nc")
    prior = command(*words, "--border", "prior")
    table = tap_table(model, test)
    expected = run_trials(
        table, plan_trials(table.pool, 90, 0, fixation=1), (0.9,), play=PlaySettings(theta_x=0.0), seed=0
    )

    assert done.code == 0
    np.testing.assert_allclose(xr.load_dataset(tmp_path / "out.nc")["taps"], expected.taps.mean(axis=0))
    assert prior.code == (2 if name.startswith("session") else 0)
    assert ("border 'prior' does not support models that carry a state" in prior.err) == name.startswith("session")


@pytest.mark.slow
def test_intervals_are_over_taps_and_not_over_trials(files, command, tmp_path, monkeypatch):
    """Twenty times the trials take out their chance alone; both kinds have intervals, and the page says what of."""
    folder, model, test = files
    words = "trials", folder / "model.nc", folder / "taps.nc", "--thresholds", "0.5,0.999", "--deadline", 30
    monkeypatch.setattr(spread, "SELECTED_TRIALS", 1000)
    monkeypatch.setattr(spread, "FRESH_TRIALS", 4000)
    widths = []
    for number in (3000, 60_000):
        printed = command(*words, "--trials", number, "--out", tmp_path / f"{number}.nc").out
        kept = xr.load_dataset(tmp_path / f"{number}.nc")
        widths.append((kept["what_wrong_high"] - kept["what_wrong_low"]).values)
    table = tap_table(model, test)
    plan, rule = (
        plan_trials(table.pool, 3000, 5, 7),
        {"play": PlaySettings(theta_x=0.0, deadline=30), "seed": 5, "fresh": True},
    )
    played = run_trials(table, plan, (0.5, 0.999), **rule)
    words = " ".join(printed.split())

    assert (widths[0] > widths[1]).all()
    np.testing.assert_allclose(widths[0], widths[1], rtol=0.1)
    late = kept.isel(theta=1)
    assert late["what_error_high"] - late["what_error_low"] > 100 * late["what_error_se"]  # 31 by trials alone
    np.testing.assert_allclose(kept["fresh_taps"], played.taps.mean(axis=0), rtol=0.1)
    np.testing.assert_allclose(kept["fresh_used_up"], played.used_up.mean(axis=0), atol=0.04)
    assert (kept["fresh_taps_low"] < kept["fresh_taps"]).all()
    wrong = played.what != plan.what[:, None]  # what trials would come to that ran out of taps is in the interval
    assert (kept["fresh_what_wrong_low"] <= (wrong & ~played.used_up).mean(axis=0) + 0.02).all()
    assert (kept["fresh_what_wrong_high"] >= (wrong | played.used_up).mean(axis=0) - 0.02).all()
    assert (kept["fresh_taps_high"] >= np.where(played.used_up, 30, played.taps).mean(axis=0) - 0.5).all()
    assert (kept["what_wrong_high"] - kept["what_wrong_low"] < 0.5).all()
    assert (
        f"from {RESAMPLES} resamples of the test taps of each class, drawn with replacement (for fresh taps, "
        "without a quarter of each class)" in words
    )
    assert "of these classes, but not other sessions, for the same model." in words
    assert re.search(r"Warning: Too few test taps: .* This applies to theta 0\.999\. Wrong: fraction", words)


@pytest.mark.slow
def test_sessions_are_drawn_where_several_test(command, make_taps, tmp_path, monkeypatch):
    """Errors that differ between sessions only: intervals are much wider than where the same taps are of one."""
    monkeypatch.setattr(spread, "SELECTED_TRIALS", 400)
    taps = make_taps(sessions=5, repeats=12)
    widths = []
    for session in (taps.session, np.minimum(taps.session, 1)):
        dataset = taps.dataset.copy(deep=True)
        dataset["taps"] += 0.5 * dataset["session"]
        dataset["session"] = dataset["session"].copy(data=session)
        own = type(taps)(dataset)
        model = fit(own.select(taps.session == 0), taps.grid())
        model.save(tmp_path / "model.nc", force=True)
        own.select(taps.session > 0).save(tmp_path / "taps.nc", force=True)
        words = "trials", tmp_path / "model.nc", tmp_path / "taps.nc", "--thresholds", "0.6", "--trials", 1000
        done = command(*words, "--out", tmp_path / "out.nc", "--force")
        kept = xr.load_dataset(tmp_path / "out.nc")
        widths.append((kept["what_wrong_high"] - kept["what_wrong_low"]).item())
        for words in (
            "from the test taps without each of the 4 test sessions in turn",
            "Each trial stays in one of the 4 test sessions.",
        ):
            assert (words in " ".join(done.out.split())) == (len(widths) == 1)

    assert widths[0] > 1.5 * widths[1]


def test_a_single_trial_has_a_wide_interval(files, command):
    folder, _, _ = files
    printed = command("trials", folder / "model.nc", folder / "taps.nc", "--trials", 1).out

    assert printed.startswith("1 of 1 trials")
    assert "nan" not in printed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--passive", "--fixation", 3), "--passive never moves"),
        (("--theta-x", 1.5), "--theta-x must be a number from 0 to 1, got 1.5"),
        (("--start", 16), "--start must be an index from 0 to 15, got 16"),
        (("--fixation", 99), "fixation point must be an index from 0 to 15, got 99"),
        (("--thresholds", "high"), "--thresholds must be numbers such as 0.5,0.9,0.99, got 'high'"),
        (("--thresholds", "1.5"), "--thresholds must be distinct numbers from 0 to 1, got '1.5'"),
        (("--thresholds", "0.9,0.9"), "--thresholds must be distinct numbers from 0 to 1, got '0.9,0.9'"),
        (("--test", "7"), "--test: no session 7"),
        (("--out", "here.txt"), "here.txt"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(files, command, words, message):
    folder, _, _ = files
    done = command("trials", folder / "model.nc", folder / "taps.nc", "--trials", 5, *words)

    assert done.code == 2
    assert message in done.err


def test_without_a_gpu_the_sentence_says_what_is_needed(files, command, monkeypatch):
    """Before anything is played."""
    import jax

    monkeypatch.setattr("solidtouch.analysis.trials.report.tap_spread", lambda *_, **__: pytest.fail("It plays."))

    if any(device.platform == "gpu" for device in jax.devices()):
        pytest.skip("there is a GPU here")
    folder, _, _ = files
    done = command("trials", folder / "model.nc", folder / "taps.nc", "--device", "gpu")

    assert done.code == 2
    assert "--device gpu requires one" in done.err


@pytest.mark.slow
def test_interrupted_trials_are_shown_and_kept(files, tmp_path):
    """Ctrl-C ends with the results so far, a whole file and exit code 130."""
    folder, _, _ = files
    out = tmp_path / "out.nc"
    words = ["trials", folder / "model.nc", folder / "taps.nc", "--passive", "--trials", "1000000000", "--out", out]
    child = subprocess.Popen(
        [sys.executable, "-m", "solidtouch.cli", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(20)  # long enough for the first trials on a busy machine
    child.send_signal(signal.SIGINT)
    printed, errors = child.communicate(timeout=60)

    assert child.returncode == 130
    assert "interrupted" in errors
    assert " trials" in printed
    kept = xr.load_dataset(out).attrs
    assert 0 < kept["trials"] < kept["requested_trials"] == 1e9


MEASURE = """
import resource, sys
from solidtouch.cli.main import run
sys.argv = ["solidtouch", "trials", *sys.argv[1:]]
try:
    run()
except SystemExit:
    pass
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_trials(files):
    """Fifty times the trials need the same memory within 16 MiB."""
    folder, _, _ = files
    peaks = []
    for trials in (60_000, 3_000_000):
        words = [folder / "model.nc", folder / "taps.nc", "--trials", trials]
        done = subprocess.run(
            [sys.executable, "-c", MEASURE, *map(str, words)], capture_output=True, text=True, check=True
        )
        peaks.append(int(done.stdout.split()[-1]) * 1024)

    assert abs(peaks[1] - peaks[0]) < 16 * 2**20
