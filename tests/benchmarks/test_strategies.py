"""The page of strategies has the places that its benchmark fills, and the benchmark's tables hold what was measured."""

import json
import sys
from pathlib import Path

import pytest

from benchmarks.page import check_block
from benchmarks.studies.strategies import comparison

ROOT = Path(__file__).parents[2]


def test_every_block_has_its_place():
    """So that minutes of trials are not for nothing."""
    page = ROOT / "docs" / "explanation" / "strategies.md"
    for name in (*comparison.BLOCKS, comparison.REGRET):
        check_block(page, name)
    with pytest.raises(ValueError, match="no lines <!-- begin nothing -->"):
        check_block(page, "nothing")


def test_sure_differences_are_bold_and_unknown_ones_a_dash():
    """Sure is what holds for all intervals together; a source without a strategy has none."""
    row = {"strategy": "random", "taps": 2, "given_up": 0.125}
    values = {"": 0.5, "_low": 0.3, "_high": 0.7, "_least": 0.1, "_most": 0.9}
    sure = row | {f"what_error_difference{end}": value for end, value in values.items()}
    unsure = sure | {"what_error_difference_least": -0.1}
    base = sure | {"strategy": comparison.BASE}
    sources = [
        {
            "name": name,
            "what_unit": "mm",
            "powers": [{"equal": dict.fromkeys((comparison.PAPER, comparison.FIXED), rows)}],
        }
        for name, rows in (("one", [sure, base]), ("two", [unsure, base]), ("three", [base]))
    ]
    lines = comparison.equal(sources).split("\n\n")[0].splitlines()
    assert lines[2] == "| random | **0.50 [0.30, 0.70]** | 0.50 [0.30, 0.70] | - |"
    assert lines[3] == "| null decisions, all | 12.5% | 12.5% | 12.5% |"


def test_regrets_are_told_as_on_the_page():
    """A case in a sentence, then a row for each strategy; the cheapest is bold."""
    case = {
        "described": "3 places",
        "said": "The exact rule costs 1 mm.",
        "caption": "Cost above it",
        "strategies": ["passive", "risk"],
        "prices": [
            {"strategy": "passive", "best": False, "shown": "0.2500 (0.9)"},
            {"strategy": "risk", "best": True, "shown": "0.100 [0.070, 0.130]"},
        ],
    }
    text = comparison.regrets({"rules": ["One.", "Two."], "kinds": ["best theta"], "cases": [case]})
    assert text.splitlines() == [
        "One. Two.",
        "",
        "*3 places.* The exact rule costs 1 mm. Cost above it:",
        "",
        "| strategy | best theta |",
        "| --- | --- |",
        "| passive | 0.2500 (0.9) |",
        "| risk | **0.100 [0.070, 0.130]** |",
    ]


def test_only_what_summaries_have_is_written(tmp_path, monkeypatch, capsys):
    """A summary of regret alone changes nothing of the other blocks."""
    blocks = "\n".join(
        f"<!-- begin {name} -->\nold\n<!-- end {name} -->" for name in (*comparison.BLOCKS, comparison.REGRET)
    )
    page, numbers = tmp_path / "page.md", tmp_path / "strategies.json"
    page.write_text(blocks)
    numbers.write_text(json.dumps({"sources": [], "regret": {"rules": ["New."], "kinds": [], "cases": []}}))
    drawn = []
    monkeypatch.setattr(comparison, "regret", lambda summary: summary)
    monkeypatch.setattr(comparison, "publish", lambda *words: drawn.append(words[-1]))
    monkeypatch.setattr(sys, "argv", ["strategies.py", "--summary", str(numbers), "--document", str(page)])
    comparison.main()
    assert page.read_text().count("old") == len(comparison.BLOCKS)
    assert "<!-- begin regret -->\nNew." in page.read_text()
    assert drawn == ["strategies-regret"]
