"""What the campaign of interruptions calls whole, left behind or wrong."""

import random
import signal
import time

import pytest
from solidtouch.cli.main import app
from typer.main import get_command

from benchmarks.checks import disturbed
from benchmarks.checks.disturbed import Outcome, Trial, Tried
from benchmarks.checks.interruptions import COMMANDS, outcome_table
from benchmarks.page import block_of, table_rows, write_block

WHOLE = "import pathlib, sys; pathlib.Path(sys.argv[1]).write_text('0123456789')"
HALF = WHOLE.replace("56789", "")
CHILD = """
import pathlib, subprocess, sys, time
subprocess.Popen(['sleep', '2'], stderr=subprocess.DEVNULL)
pathlib.Path('other').touch()
pathlib.Path({ready!r}).touch()
time.sleep(60)
"""


class Ready(random.Random):
    """Draws the moment at which a file is there."""

    def __new__(cls, _):
        """Without a seed."""
        return super().__new__(cls)

    def __init__(self, file):
        super().__init__(0)
        self.file = file

    def uniform(self, a, _):
        """Nothing more to wait for."""
        while not self.file.exists():
            time.sleep(0.01)
        return a


@pytest.fixture
def trial(tmp_path, monkeypatch):
    """A trial of a script instead of a command."""
    monkeypatch.setattr(disturbed, "PROGRAM", ("-c", WHOLE))
    data = tmp_path / "data"
    data.mkdir()
    return Trial("script", Tried(("out",), "out"), data, Ready(tmp_path / "ready"))


def test_output_with_other_bytes_is_not_whole(trial, monkeypatch):
    trial.jump()
    assert not trial.outcome.wrong
    monkeypatch.setattr(disturbed, "PROGRAM", ("-c", HALF))
    trial.jump()
    assert [sentence.partition(":")[0] for sentence in trial.outcome.wrong] == ["script, clock"]


def test_children_and_files_that_are_left_are_found(trial, monkeypatch, tmp_path):
    monkeypatch.setattr(disturbed, "_SOON_S", 0.2)
    monkeypatch.setattr(disturbed, "PROGRAM", ("-c", CHILD.format(ready=str(tmp_path / "ready"))))
    trial.interrupt(signal.SIGTERM)
    assert any("child processes are left" in sentence and "sleep" in sentence for sentence in trial.outcome.wrong)
    assert "script, SIGTERM: left behind: other" in trial.outcome.wrong


def test_both_of_two_that_write_one_output_are_not_to_end_well(trial):
    trial.twice()
    assert trial.outcome.wrong == ["script, twice: both ended, so one output replaced the other"]


def test_rows_of_other_commands_stay_on_the_page(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("<!-- begin interruptions -->\n<!-- end interruptions -->\n")
    for name, seconds in (("convert", 1.0), ("sweep", 2.0), ("convert", 3.0)):
        kept = table_rows(block_of(page, "interruptions"))
        write_block(page, "interruptions", outcome_table({name: Outcome(slowest_s=seconds)}, kept))
    rows = table_rows(block_of(page, "interruptions"))
    assert [(row[0], row[5]) for row in rows.values()] == [("`sweep`", "2.0 s"), ("`convert`", "3.0 s")]


@pytest.mark.parametrize("name", COMMANDS)
def test_command_lines_are_valid(name):
    """Found before an hour has gone into the commands before it."""
    get_command(app).commands[name].make_context(name, list(COMMANDS[name].words[1:]))
