"""`solidtouch strategies`."""

import json

import pytest
import typer
from solidtouch.analysis.strategies import regret, regret_cases
from solidtouch.cli.strategies import strategies
from solidtouch.models.errors import InputError
from typer.testing import CliRunner


@pytest.fixture
def call():
    """A function that runs the command with some words."""
    app = typer.Typer()
    app.command()(strategies)
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


@pytest.mark.slow
def test_a_recording_gives_a_folder_with_the_page(call, make_taps, tmp_path):
    """The page, the numbers, and the differences in the terminal."""
    make_taps(L=2, M=2, sessions=3).save(tmp_path / "taps.nc")
    out = tmp_path / "out"
    result = call(tmp_path / "taps.nc", "--presets", "none", "--trials", 50, "--out", out)
    assert result.exit_code == 0, result.output
    summary = json.loads((out / "strategies.json").read_text())
    findings = summary["sources"][0]["findings"]
    assert findings
    assert all(sentence in " ".join(result.output.split()) for sentence in findings)
    assert [source["name"] for source in summary["sources"]] == ["taps"]
    assert summary["trials"] == 50
    assert summary["regret"] is None
    assert "<h2" in (out / "report.html").read_text()


def test_a_folder_is_not_replaced_without_force(call, tmp_path):
    """It is refused before any work."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "note.txt").write_text("keep")
    result = call("--quick", "--out", tmp_path / "out")
    assert isinstance(result.exception, InputError)
    assert "--force" in str(result.exception)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--presets", "none"), "--presets none requires a file"),
        (("--presets", "none", "--no-regret"), "or --regret"),
        (("--presets", "paper,paper"), "names one twice"),
        (("--presets", "papr"), "Unknown preset 'papr'"),
        (("nothing.nc", "--presets", "none"), "nothing.nc"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_sentence(call, tmp_path, words, message):
    """And nothing is written."""
    result = call(*words, "--out", tmp_path / "out")
    assert isinstance(result.exception, InputError)
    assert message in str(result.exception)
    assert not (tmp_path / "out").exists()


def test_regret_can_be_had_alone(call, tmp_path, monkeypatch, sketched):
    """Here of cases of two taps: page, numbers, a figure, and findings in the terminal."""
    tiny = regret_cases.ProblemSize("5mm", range(3), (1, 3), 1, 4, 2)
    fewer = {"SMALL": (tiny,), "LARGE": tiny._replace(exact=False), "QUICK_TRIALS": 20, "_GRID_STEPS": 5}
    for name, value in fewer.items():
        monkeypatch.setattr(regret, name, value)
    monkeypatch.setattr(regret_cases, "DRAWN", 100)
    out = tmp_path / "out"
    result = call("--presets", "none", "--regret", "--quick", "--seed", 3, "--out", out)
    assert result.exit_code == 0, result.output
    assert "Regret relative to a bound" in " ".join(result.output.split())
    summary = json.loads((out / "strategies.json").read_text())
    assert (summary["sources"], summary["regret"]["trials"], summary["regret"]["seed"]) == ([], 20, 3)
    assert {path.name for path in out.iterdir()} == {"regret.svg", "report.html", "strategies.json"}
    assert 'id="figure-regret"' in (out / "report.html").read_text()


@pytest.mark.slow
def test_a_quick_look_at_simulated_data(call, tmp_path):
    """Three data sets of two presets, all strategies."""
    out = tmp_path / "out"
    result = call("--quick", "--presets", "nodrift,model", "--out", out)
    assert result.exit_code == 0, result.output
    summary = json.loads((out / "strategies.json").read_text())
    assert summary["regret"]["trials"] == regret.QUICK_TRIALS
    first, second = summary["sources"]
    assert first["simulated"]
    assert len(first["strategies"]) == 11
    assert second["border"] == "clamp"
