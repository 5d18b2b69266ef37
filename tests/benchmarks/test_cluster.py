"""The overhead of a cluster and the estimate for a large study."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.speed.cluster import CORES, estimate

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "cluster.md"


def rows(text):
    """Cells of the rows of a table as numbers."""
    return [[float(cell.replace(",", "")) for cell in row.split("|")[1:-1]] for row in text.splitlines()[2:]]


def test_a_study_takes_as_long_as_its_work_or_its_scheduler_after_the_start():
    """40 ns per tap-update are 40 s on 1,000 cores; a batch of 10 ms is 1,000 s of scheduler at 100 of each core."""
    found = {(cores, batches): row for cores, batches, *row in rows(estimate(40e-9, 0.01, 4.0))}

    assert {cores for cores, _ in found} == set(CORES)
    assert found[10, 1] == [4000, 4000, 0.1, 4004, 1.0]
    assert found[1000, 1] == [40, 40, 10, 44, 0.91]
    assert found[1000, 100] == [0.4, 40, 1000, 1004, 0.04]


@pytest.mark.slow
def test_the_benchmark_fills_its_page(tmp_path):
    page = tmp_path / "cluster.md"
    page.write_text(re.sub(r"(<!-- begin (\w+) -->\n).*?(<!-- end)", r"\1\3", PAGE.read_text("utf-8"), flags=re.DOTALL))
    words = [sys.executable, "-m", "benchmarks.speed.cluster", "--quick", "--document", page]
    subprocess.run(words, cwd=ROOT, check=True, capture_output=True)

    measured = page.read_text(encoding="utf-8")
    assert "| per batch of one task, ms |" in measured
    assert "| 1,000 | 100 |" in measured
