"""The benchmarks run; what they measure is not tested."""

import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "benchmarks"


def test_the_monte_carlo_benchmark_prints_both_policies():
    words = ["--trials", "40", "--loop-trials", "3", "--rounds", "1"]
    done = subprocess.run(
        [sys.executable, FOLDER / "montecarlo.py", *words], capture_output=True, text=True, check=True
    )

    assert [line.split()[0] for line in done.stdout.splitlines()] == ["passive", "active"]
    assert done.stdout.count("ns per useful tap") == 2
