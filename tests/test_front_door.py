"""The public names: all there, described, and free until they are used."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from solidtouch.analysis.page.report import StudyReport

import solidtouch

DOCUMENT = (Path(__file__).parents[1] / "docs" / "reference" / "api.md").read_text(encoding="utf-8")


def test_importing_loads_nothing_else():
    code = "import sys; before = set(sys.modules); import solidtouch; print(*sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}

    assert "solidtouch" in loaded
    assert not loaded & {
        "numpy",
        "scipy",
        "xarray",
        "pandas",
        "matplotlib",
        "jax",
        "numpyro",
        "numba",
        "arviz",
        "sklearn",
    }


def test_the_document_lists_every_name_once():
    table = DOCUMENT.split("|---|---|")[1]
    listed = [
        name for row in re.findall(r"^\| (`.*?`) \|", table, re.MULTILINE) for name in re.findall(r"`(\w+)`", row)
    ]

    assert sorted(listed) == sorted(solidtouch.__all__)


@pytest.mark.parametrize("name", sorted(set(solidtouch.__all__) - {"PRESETS"}))
def test_a_name_is_there_and_says_what_it_is(name):
    thing = getattr(solidtouch, name)

    assert thing.__name__.removeprefix("solidtouch.") == name
    assert thing.__doc__


def test_a_name_that_is_not_there_is_refused():
    with pytest.raises(AttributeError, match="nonsense"):
        _ = solidtouch.nonsense


def test_every_report_has_all_results_and_the_document_names_those_with_a_summary():
    names = [name for name in solidtouch.__all__ if name.endswith("Report")]
    reports = [*(getattr(solidtouch, name) for name in names), solidtouch.conformance.ConformanceReport]
    folders = {report.__module__.split(".")[-2] for report in reports if issubclass(report, StudyReport)}
    row = next(line for line in DOCUMENT.splitlines() if line.startswith("| `report.summary` |"))

    assert [report.__name__ for report in reports if "found" not in report.__dataclass_fields__] == []
    assert set(re.findall(r"`(\w+)`", row)) == folders
