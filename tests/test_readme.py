"""The README does what it says."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language):
    return re.search(rf"^```{language}\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)[1]


def test_the_python_example_prints_what_the_readme_shows(tmp_path):
    """The code block runs as it stands and gives the text block below it."""
    done = subprocess.run(
        [sys.executable, "-c", block("python")], cwd=tmp_path, capture_output=True, text=True, check=True
    )

    assert done.stdout == block("text")


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#:]+)\)", README))))
def test_every_link_into_the_repository_leads_somewhere(target):
    assert (ROOT / target).exists()


def test_the_equation_table_names_things_that_exist():
    """Every function and test file in the table is there."""
    table = README.split("## Equations")[1].split("## Where")[0]
    names = re.findall(r"`([^`]+)`", table)
    sources = "".join(
        path.read_text(encoding="utf-8") for folder in ("models", "inference") for path in (ROOT / folder).rglob("*.py")
    )
    for name in names:
        if name.endswith(".py"):
            assert any(list((ROOT / folder).rglob(name)) for folder in ("tests", "inference", ".")), name
        for function in re.findall(r"(?:^|: )(\w+)$", name):
            assert f"def {function}(" in sources, name
