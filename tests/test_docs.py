"""The pages in docs/ do what they say."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

TUTORIALS = Path(__file__).parents[1] / "docs" / "tutorials"
PAGE = TUTORIALS / "bring-your-own-recordings.md"
RECORDED = ("convert", "inspect")  # what the quick test runs; the slow one runs every command


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and content of each fenced block, in the order of the page."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def run_page(page: Path, folder: Path, commands: tuple[str, ...] | None) -> dict[str, str]:
    """Runs a page in a folder, of its shell lines those with one of the commands; returns what each line printed."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    printed = {}
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
                done = subprocess.run(
                    words, cwd=folder, env=os.environ | {"PATH": path}, capture_output=True, text=True, check=False
                )
                assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
                printed[line] = done.stdout
    return printed


def test_the_page_converts_and_inspects_its_recordings(tmp_path):
    """180 taps in 6 streams, none lost, and the warning that the page speaks of."""
    printed = " ".join(" ".join(run_page(PAGE, tmp_path, RECORDED).values()).split())

    assert "180 taps from 6 streams, 0 incomplete taps left out" in printed
    assert "taps.nc: 180 taps of 20 samples from 3 taxels." in printed
    assert "cut.nc: 40 taps of 5 samples from 2 taxels." in printed
    assert "Recorded in blocks" in printed


@pytest.mark.slow
def test_the_page_ends_in_the_report(tmp_path):
    run_page(PAGE, tmp_path, None)

    assert (tmp_path / "model.nc").is_file()
    assert (tmp_path / "report" / "report.html").is_file()


@pytest.mark.slow
def test_the_first_steps_print_what_the_page_shows(tmp_path):
    page = TUTORIALS / "first-steps.md"
    printed = "".join(run_page(page, tmp_path, None).values())

    shown = [content for language, content in blocks(page) if language == "text"]
    assert len(shown) == 2
    assert all(text in printed for text in shown)
