"""The benchmarks run; what they measure is not tested."""

import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"


def test_the_monte_carlo_benchmark_prints_both_policies():
    words = ["--trials", "40", "--loop-trials", "3", "--rounds", "1"]
    done = subprocess.run(
        [sys.executable, FOLDER / "montecarlo.py", *words], capture_output=True, text=True, check=True
    )

    assert [line.split()[0] for line in done.stdout.splitlines()] == ["passive", "active"]
    assert done.stdout.count("ns per useful tap") == 2


def run(name, *words):
    """What a benchmark prints; it must end with exit code 0."""
    done = subprocess.run(
        [sys.executable, FOLDER / name, *words], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_random_bytes_raise_nothing():
    assert run("fuzz.py", "--inputs", "8000").count("no exception") == 4


@pytest.mark.slow
def test_random_faults_give_no_wrong_tap():
    """600 taps on three seeds; it fails where a tap is wrong, a move leaves the limits or a loss is not reported."""
    assert "taps accepted" in run("faults.py")


@pytest.mark.slow
def test_a_killed_collection_loses_nothing_but_the_tap_in_progress():
    """Nor does one that is told to stop, and the finger is off the object then."""
    printed = run("kills.py", "--kills", "5", "--stops", "1", "--spacing", "4")

    assert "kills and stops: 7" in printed
    assert "taps lost otherwise: 0" in printed


@pytest.mark.slow
def test_the_novelty_benchmark_prints_its_tables():
    assert "known" in run("novelty.py", "--data-sets", "1", "--episodes", "4")
