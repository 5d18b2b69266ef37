"""The page of strategies has the places that its benchmark fills, and the benchmark's tables hold what was measured."""

import importlib
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def benchmark():
    """The module `benchmarks/strategies.py`."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        yield importlib.import_module("strategies")
    finally:
        sys.path.remove(str(ROOT / "benchmarks"))
        for name in ("strategies", "studies"):
            sys.modules.pop(name, None)


def test_every_block_has_its_place(benchmark):
    """So that minutes of trials are not for nothing."""
    page = ROOT / "docs" / "strategies.md"
    for name in (*benchmark.BLOCKS, "regret"):
        benchmark.check_block(page, name)
    with pytest.raises(ValueError, match="no lines <!-- begin nothing -->"):
        benchmark.check_block(page, "nothing")


def test_sure_differences_are_bold_and_unknown_ones_a_dash(benchmark):
    """Sure is what holds for all intervals together; a source without a strategy has none."""
    row = {"strategy": "random", "taps": 2, "given_up": 0.125}
    values = {"": 0.5, "_low": 0.3, "_high": 0.7, "_least": 0.1, "_most": 0.9}
    sure = row | {f"what_error_difference{end}": value for end, value in values.items()}
    unsure = sure | {"what_error_difference_least": -0.1}
    base = sure | {"strategy": benchmark.BASE}
    sources = [
        {
            "name": name,
            "what_unit": "mm",
            "powers": [{"equal": dict.fromkeys((benchmark.PAPER, benchmark.FIXED), rows)}],
        }
        for name, rows in (("one", [sure, base]), ("two", [unsure, base]), ("three", [base]))
    ]
    lines = benchmark.equal(sources).split("\n\n")[0].splitlines()
    assert lines[2] == "| random | **0.500 [0.300, 0.700]** | 0.500 [0.300, 0.700] | - |"
    assert lines[3] == "| null decisions, all | 12.5 % | 12.5 % | 12.5 % |"
