"""Files that earlier code wrote are read as it read them; the formats of docs/reference/versions.md are those written.

The files in `older` come from the commits eda6a54f (taps, histogram, recording), 7acfb3ae (setting, profile), both of
2026-11-21, and c6a7dd99 (episode); `log_likelihood.json` holds what the first two made of the first three taps.
"""

import json
import re
import shutil
from pathlib import Path

import h5py
import msgspec
import numpy as np
import pytest
from solidtouch.analysis.conformance import case
from solidtouch.analysis.live import saved
from solidtouch.analysis.page.labelled import NUMBERS_FORMAT
from solidtouch.analysis.sweep import store
from solidtouch.cli.redraw import redraw
from solidtouch.inference.tuning import online
from solidtouch.models import setting_file, taps
from solidtouch.models.errors import InputError
from solidtouch.models.io import export, rig, rig_recording
from solidtouch.models.io.export_reader import load_exported
from solidtouch.models.measurement import model

import solidtouch as st

OLDER = Path(__file__).parent / "older"
VERSIONS = Path(__file__).parents[3] / "docs/reference/versions.md"


def test_the_table_has_the_formats_that_are_written():
    rows = re.findall(r"^\| (.+?) \|.*?\| (\d+) \|", VERSIONS.read_text(encoding="utf-8"), flags=re.MULTILINE)

    assert {re.sub(r".*`(.*)`.*", r"\1", name): int(number) for name, number in rows} == {
        "*.nc": taps.FORMAT,
        "model.nc": model.FORMAT,
        "model.json": export.FORMAT,
        "setting.json": setting_file.FORMAT,
        "*.mcap": rig_recording.FORMAT,
        "episode.json": saved.VERSION,
        "compare.nc": NUMBERS_FORMAT,
        "study.zarr": store.FORMAT,
        "tune --online": online.FORMAT,
        "conformance kit": case.FORMAT,
    }


def test_taps():
    found = st.load_taps(OLDER / "taps.nc")

    assert found.taps.shape == (24, 5, 2)
    assert found.taps.mean() == pytest.approx(1.0583833333, abs=1e-10)
    assert found.what_name == ["rod", "plate"]
    assert found.where.tolist() == [1.0] * 4 + [3.0] * 4 + [5.0] * 4 + [1.0] * 4 + [3.0] * 4 + [5.0] * 4


@pytest.mark.parametrize(("name", "written"), [("histogram", 1), ("profile", 2)])
def test_models(name, written):
    """The one of format 1 is of a time when there was but the histogram."""
    with h5py.File(OLDER / f"{name}.nc") as file:
        assert file.attrs["format"] == written
    then = np.array(json.loads((OLDER / "log_likelihood.json").read_text())[name])

    now = st.load_model(OLDER / f"{name}.nc").log_likelihood(st.load_taps(OLDER / "taps.nc").taps[:3])

    assert now == pytest.approx(then, abs=1e-9)


def test_a_setting():
    found = setting_file.load_setting(OLDER / "setting.json")

    assert found == setting_file.Setting.of(
        model="gaussian",
        power="JK",
        saturation=4.0,
        bins=9,
        threshold=0.9,
        border="prior",
        fixation=1,
        note="tuned by hand",
    )


def test_a_recording():
    """Whose header says no format."""
    found = st.load_taps(OLDER / "recording.mcap")

    assert found.taps.shape == (1, 50, 12)
    assert found.taps.mean() == pytest.approx(3.0166666667, abs=1e-10)
    assert (found.what_name, found.where.tolist()) == (["6 mm rod"], [7.5])
    assert b'"format":' not in (OLDER / "recording.mcap").read_bytes()


def test_an_episode():
    last = saved.load_episodes(OLDER / "episode.json").taps[-1]

    assert (last.tap, last.what, last.what_belief, last.where) == (4, "rod", 0.930781429, 3.0)


@pytest.mark.parametrize(
    ("name", "read", "said"),
    [
        ("taps.nc", st.load_taps, "a tap set of format 9; this version reads format 1."),
        ("profile.nc", st.load_model, "a fitted model of format 9; this version reads formats 2 and 1."),
        ("exported.json", load_exported, "an exported model of format 9; this version reads format 1."),
        ("setting.json", setting_file.load_setting, "a setting of format 9; this version reads format 1."),
        ("learner.json", online.load_learner, "a learner of format 9; this version reads format 1."),
        ("study.zarr", store.read_about, "a sweep of format 9; this version reads format 1."),
        ("compare.nc", redraw, "a file of format 9; this version reads format 1."),
        ("episode.json", saved.load_episodes, "version: must be 1, got 9."),
    ],
)
def test_newer_files_are_refused_with_both_numbers(tmp_path, name, read, said):
    path = tmp_path / name
    if (OLDER / name).exists():
        shutil.copy(OLDER / name, tmp_path)
    if path.suffix == ".nc":
        with h5py.File(path, "a") as file:
            file.attrs["format"] = 9
    elif path.suffix == ".json":
        values = json.loads(path.read_text()) if path.exists() else {"kind": "histogram"}
        path.write_text(json.dumps(values | {"version" if "version" in values else "format": 9}))
    else:
        path.mkdir()
        (path / "zarr.json").write_text(json.dumps({"attributes": {"sweep_format": 9}}))
    with pytest.raises(InputError) as refused:
        read(path)

    assert str(refused.value).startswith(f"{path}: ")
    assert str(refused.value).endswith(said)


def test_a_newer_recording_is_refused_though_it_begins_as_this_version_expects(monkeypatch):
    about = rig.read_rig(OLDER / "recording.mcap").about
    assert about.format == 1
    assert json.loads(msgspec.json.encode(about))["format"] == 1
    monkeypatch.setattr(rig, "FORMAT", 9)
    with pytest.raises(InputError, match=r"recording\.mcap: a recording of format 1; this version reads format 9\."):
        rig.read_rig(OLDER / "recording.mcap")
