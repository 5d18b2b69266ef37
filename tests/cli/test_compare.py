"""`solidtouch compare`."""

import json

import numpy as np
import pytest
import xarray as xr
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet

J, K = 5, 3


@pytest.fixture
def recordings(tmp_path):
    """Two sessions of two objects at three positions."""
    for session in (0, 1):
        generator = np.random.default_rng(session)
        where, what = (axis.ravel() for axis in np.meshgrid(np.repeat(np.arange(3), 3), np.arange(2)))
        shape = np.linspace(0.5, 2, J)[:, None] * np.arange(1, K + 1)
        taps = (where + 2.5 * what)[:, None, None] * shape + generator.normal(size=(len(where), J, K))
        TapSet.from_arrays(
            taps,
            what,
            ["rod 4 mm", "rod 6 mm"],
            where=where.astype(float),
            where_unit="mm",
            what_value=[4.0, 6.0],
            what_unit="mm",
            session=np.full(len(where), session),
            preprocessing=Preprocessing(samples=J),
        ).save(tmp_path / f"session-{session}.nc")
    return tmp_path / "session-0.nc", tmp_path / "session-1.nc"


QUICK = ("--draws", "100", "--trials", "60", "--thresholds", "0.3,0.6,0.9", "--bins", "20")


def test_models_are_compared_on_one_page(command, recordings, tmp_path, sketched):
    """The folder holds the page, the numbers and the figures, and the table names every model."""
    out = tmp_path / "out"
    result = command("compare", *recordings, "--models", "histogram,profile,session", *QUICK, "--out", out)
    assert result.code == 0, result.err
    for name in ("histogram", "profile", "session"):
        assert name in result.out
    assert str(out / "report.html") in result.out.replace("\n", "")
    summary = json.loads((out / "summary.json").read_text())
    assert [row["name"] for row in summary["models"]] == ["histogram", "profile", "session"]
    assert summary["headline"] in " ".join(result.out.split())
    assert [row["title"] for row in summary["best"]] == [level["title"] for level in summary["levels"]]
    assert any("Log probabilities of taps: Too few test sessions, 2," in warning for warning in summary["warnings"])
    page = (out / "report.html").read_text()
    assert '<h2 id="decisions">' in page
    assert ">1 taps<" not in page
    assert "leaving out each session in turn" in page
    tree = xr.open_datatree(out / "compare.nc")
    assert {"classes", "decisions", "equal_taps", "sessions_left_out", "taps_left_out", "checks", "stacking"} <= set(
        tree
    )
    tree.close()


@pytest.mark.slow
def test_models_that_the_data_cannot_carry_are_named(command, tmp_path, sketched):
    """With one sample per tap profiles are refused, and the rest of the table still comes."""
    paths = []
    for session in (0, 1):
        generator = np.random.default_rng(session)
        what = np.repeat([0, 1], 5)
        paths.append(tmp_path / f"{session}.nc")
        TapSet.from_arrays(
            generator.normal(size=(10, 1, 2)) + what[:, None, None],
            what,
            ["a", "b"],
            session=np.full(10, session),
            preprocessing=Preprocessing(samples=1),
        ).save(paths[-1])
    out = tmp_path / "out"
    result = command("compare", *paths, "--models", "histogram,profile,smooth,profile-mvn", *QUICK, "--out", out)
    assert result.code == 0, result.err
    refused = {row["name"]: row["reason"] for row in json.loads((out / "summary.json").read_text())["refused"]}
    assert set(refused) == {"profile", "smooth"}
    assert "needs more than one sample per tap" in refused["profile"]


BAD = {
    "no such model": (("--models", "histogram,banana"), "Unknown model 'banana'; choose from histogram, gaussian"),
    "twice": (("--models", "profile,profile"), "--models must name different models"),
    "few draws": (("--draws", "20"), "--draws must be 0, or 100 or more"),
    "threshold": (("--theta-x", "2"), "--theta-x must be a number from 0 to 1"),
    "many folds": (("--split", "leave-one-session-out"), "--split"),
}


@pytest.mark.parametrize(("options", "message"), BAD.values(), ids=BAD)
def test_wrong_options_are_one_sentence(command, recordings, tmp_path, options, message):
    """Exit code 2, nothing written."""
    result = command("compare", *recordings, *options, "--out", tmp_path / "out")
    assert result.code == 2
    assert message in result.err
    assert not (tmp_path / "out").exists()
