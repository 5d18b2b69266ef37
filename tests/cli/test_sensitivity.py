"""`solidtouch sensitivity`."""

import json

import pytest
import typer
from solidtouch.cli.sensitivity import sensitivity
from solidtouch.models.errors import InputError
from typer.testing import CliRunner


@pytest.fixture
def call():
    """A function that runs the command with some words."""
    app = typer.Typer()
    app.command()(sensitivity)
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


def test_a_recording_gives_a_folder_with_the_page(call, make_taps, tmp_path, sketched):
    """The page, the numbers, and the ranking in the terminal."""
    make_taps(sessions=3).save(tmp_path / "taps.nc")
    out = tmp_path / "out"
    result = call(tmp_path / "taps.nc", "--data-sets", 0, "--trials", 50, "--strongest", 0, "--out", out)
    assert result.exit_code == 0, result.output
    assert "Choices by the effect of their strongest option" in result.output
    summary = json.loads((out / "sensitivity.json").read_text())
    assert [source["name"] for source in summary["sources"]] == ["taps"]
    assert summary["trials"] == 50
    assert "<h2" in (out / "report.html").read_text()


def test_a_folder_is_not_replaced_without_force(call, make_taps, tmp_path):
    """It is refused before any work."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "note.txt").write_text("keep")
    result = call("--quick", "--out", tmp_path / "out")
    assert isinstance(result.exception, InputError)
    assert "--force" in str(result.exception)


def test_nothing_to_run_on_is_refused(call):
    result = call("--data-sets", 0)
    assert isinstance(result.exception, InputError)
    assert "--data-sets 0 requires a file" in str(result.exception)


def test_a_file_that_cannot_be_read_is_named(call, tmp_path):
    result = call(tmp_path / "nothing.nc", "--data-sets", 0, "--out", tmp_path / "out")
    assert isinstance(result.exception, InputError)
    assert str(result.exception).count("nothing.nc") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("option", ["--where-cell", "--what-cell"])
def test_cells_without_a_file_are_refused(call, tmp_path, option):
    """Simulated taps keep the classes of their preset."""
    result = call(option, "3mm", "--out", tmp_path / "out")
    assert isinstance(result.exception, InputError)
    assert f"{option} 3mm requires recorded taps" in str(result.exception)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_quick_look_at_simulated_data(call, tmp_path):
    """Four data sets, all choices."""
    out = tmp_path / "out"
    result = call("--quick", "--strongest", 0, "--out", out)
    assert result.exit_code == 0, result.output
    (source,) = json.loads((out / "sensitivity.json").read_text())["sources"]
    assert source["simulated"]
    assert len(source["choices"]) == 18
    assert {choice["verdict"] for choice in source["choices"]} == {"not decided"}
    assert "With 4 units no verdict is possible" in " ".join(result.output.split())
