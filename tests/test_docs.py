"""The pages in docs/ do what they say."""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from solidtouch.cli.main import run as run_command

TUTORIALS = Path(__file__).parents[1] / "docs" / "tutorials"
PAGE = TUTORIALS / "bring-your-own-recordings.md"
RECORDED = ("convert", "inspect")  # what the quick test runs; the slow one runs every command


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and content of each fenced block, in the order of the page."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def run_page(page: Path, folder: Path, run: Callable[[list[str]], str], commands: tuple[str, ...] | None) -> str:
    """Runs a page in a folder, of its shell lines those with one of the commands; returns what they printed."""
    printed = ""
    for language, content in blocks(page):
        if language == "text":
            continue
        if language == "python":
            subprocess.run([sys.executable, "-c", content], cwd=folder, check=True)
            continue
        for line in content.splitlines():
            words = shlex.split(line)
            assert words[0] == "solidtouch"
            if commands is None or words[1] in commands:
                printed += run(words)
    return printed


@pytest.fixture
def here(tmp_path, monkeypatch, capsys):
    """A function that runs a command in the folder of the page, in this process, and returns what it printed."""
    monkeypatch.chdir(tmp_path)

    def run(words):
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit, match=r"^0$"):
            run_command()
        return capsys.readouterr().out

    return run


@pytest.fixture
def installed(tmp_path):
    """The same by the installed program."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    options = {"cwd": tmp_path, "env": os.environ | {"PATH": path}, "capture_output": True, "text": True}

    def run(words):
        done = subprocess.run(words, check=False, **options)
        assert done.returncode == 0, f"{words}\n{done.stdout}{done.stderr}"
        return done.stdout

    return run


def test_the_page_converts_and_inspects_its_recordings(tmp_path, here, installed):
    """180 taps in 6 streams, and the warning that the page speaks of."""
    printed = " ".join(run_page(PAGE, tmp_path, here, RECORDED).split())

    assert "180 taps from 6 streams. taps.nc" in printed
    assert "taps.nc: 180 taps of 20 samples from 3 taxels." in printed
    assert "cut.nc: 40 taps of 5 samples from 2 taxels." in printed
    assert "Recorded in blocks" in printed
    assert "Recorded in blocks" in installed(["solidtouch", "inspect", "taps.nc"])


@pytest.mark.slow
def test_the_page_ends_in_the_report(tmp_path, installed):
    run_page(PAGE, tmp_path, installed, None)

    assert (tmp_path / "model.nc").is_file()
    assert (tmp_path / "report" / "report.html").is_file()


@pytest.mark.slow
def test_the_first_steps_print_what_the_page_shows(tmp_path, installed):
    page = TUTORIALS / "first-steps.md"
    printed = "\n".join(map(str.rstrip, run_page(page, tmp_path, installed, None).splitlines()))

    shown = [content for language, content in blocks(page) if language == "text"]
    assert len(shown) == 3
    assert all(text.rstrip() in printed for text in shown)
