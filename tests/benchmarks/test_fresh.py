"""`validate` in a fresh installation is alone there, and twice."""

import pytest

from benchmarks.checks.house import ROOT
from benchmarks.page import block_of
from benchmarks.peers import fresh

SCRIPT = """#!/bin/sh
test "$1" = validate && test -z "$PYTHONPATH" || exit 3
ls -A >>../seen
echo "from $XDG_CACHE_HOME" >>../seen
touch left
exit {code}
"""


@pytest.fixture
def program(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))

    def make(code):
        path = tmp_path / "solidtouch"
        path.write_text(SCRIPT.format(code=code), encoding="utf-8")
        path.chmod(0o755)
        return path

    return make


def test_it_runs_twice_in_a_folder_of_its_own(tmp_path, program):
    folder = tmp_path / "run"
    runs = fresh.validated(program(0), folder)

    assert (tmp_path / "seen").read_text().splitlines() == [f"from {folder}/cache", "left", f"from {folder}/cache"]
    assert [row[:2] for row in fresh.lines("Python 3", runs)] == [["Python 3", "first"], ["Python 3", "again"]]


def test_a_check_that_fails_is_told(tmp_path, program):
    with pytest.raises(RuntimeError, match="ended with exit code 1"):
        fresh.validated(program(1), tmp_path / "run")


def test_the_page_has_times():
    assert "| Python 3.12" in block_of(ROOT / "docs" / "explanation" / "peers.md", fresh.BLOCK)
