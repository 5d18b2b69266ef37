"""Commands on recordings with missing samples."""

import re
from functools import partial

import numpy as np
import pytest
from solidtouch.models.settings import Division
from solidtouch.models.splits import load_experiment
from solidtouch.models.taps import TapSet

import solidtouch as st


@pytest.fixture
def files(make_taps, tmp_path):
    """Two sessions without a tenth of their samples; the second has a dead taxel."""
    found = []
    for s in (0, 1):
        taps = make_taps(L=3, M=2, J=5, K=4, sessions=1, repeats=8, seed=s, session=np.full(48, s))
        samples = taps.taps.copy()
        samples[np.random.default_rng(s).random(samples.shape) < 0.1] = np.nan
        if s:
            samples[:, :, 3] = np.nan
        found.append(tmp_path / f"session-{s}.nc")
        lacking = taps.dataset.assign(taps=(taps.dataset["taps"].dims, samples))
        TapSet(lacking.assign_attrs(missing="drop")).save(found[-1])
    return found


def test_missing_samples_are_refused_unless_they_are_to_be_dropped(command, files, tmp_path):
    """With the place of the first, by every command that may drop them and one that may not."""
    model = tmp_path / "model.nc"
    fitted = command("fit", files[0], "--missing", "drop", "--bins", 9, "--draws", 2, "--out", model)
    play = "--trials", 60, "--deadline", 5

    assert fitted.code == 0
    assert re.search(r"of the samples of the training taps are missing and left out\.", fitted.out)
    for words in (
        ("fit", files[0], "--out", tmp_path / "other.nc"),
        ("trials", model, files[1], *play),
        ("perceive", model, "--rig", f"replay:{files[1]}"),
        ("crosscheck", *files),
        ("compare", *files),
        ("reproduce", "--data", *files),
        ("inspect", files[1]),
    ):
        done = command(*words)
        assert done.code == 2
        assert "is nan; NaN and infinite values are not accepted" in done.err
    for words in (
        ("trials", model, files[1], *play),
        ("perceive", model, "--rig", f"replay:{files[1]}", "--deadline", 3, "--shadow"),
    ):
        done = command(*words, "--missing", "drop")
        assert done.code == 0
        assert "are missing and left out; taxels without any: 3." in " ".join((done.out + done.err).split())
    done = command("inspect", files[1], "--missing", "drop")
    assert done.code == 0
    assert "are missing and left out; taxels without any: 3." in " ".join(done.out.split())
    setting = "--trials", 100, "--bins", 9, "--deadline", 20, "--out", tmp_path / "setting.json"
    assert command("tune", files[1], *setting, "--missing", "drop").code == 0


def test_an_audit_takes_no_taps_with_missing_samples(files):
    with pytest.raises(ValueError, match=r"An audit .* refuses missing"):
        st.audit(*files, division=Division(missing="drop"))


def test_tap_sets_remember_that_samples_may_be_missing(files):
    """Where they can be left out; functions that need all samples name those that do not."""
    taps = st.load_taps(files[0], missing="drop")

    assert st.fit(taps, bins=9).missing == "drop"
    assert load_experiment([taps], Division(split="parity"))[0].warning
    for study in (st.inspect, partial(st.audit, taps, taps)):
        with pytest.raises(ValueError, match=r"taps have missing samples; only inspect, fit, .* leave them out"):
            study(taps)


def test_a_model_of_dependent_samples_is_named(command, files, tmp_path):
    words = "fit", files[0], "--missing", "drop", "--bins", 9, "--out", tmp_path / "model.nc"
    assert "profile-mvn cannot be fitted without them" in command(*words, "--model", "profile-mvn").err
    assert "leave out --arviz" in command(*words, "--arviz").err


@pytest.mark.slow
@pytest.mark.usefixtures("sketched")
def test_models_are_compared_on_the_samples_that_are_there(command, files, tmp_path):
    """Those of dependent samples are named as refused, and no number becomes NaN."""
    models = "--models", "histogram,profile,profile-mvn", "--draws", 100, "--trials", 40, "--thresholds", 0.9
    done = command("compare", *files, *models, "--bins", 9, "--missing", "drop", "--out", tmp_path / "compared")

    assert done.code == 0
    assert "profile-mvn cannot be fitted without them" in " ".join(done.out.split())
    assert "Predictive checks are left out" in " ".join(done.out.split())
    assert not re.search(r"\bnan\b", done.out.lower())
