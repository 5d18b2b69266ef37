"""The README does what it says, and the table of equations names what exists."""

import re
from pathlib import Path

from solidtouch.cli.main import app

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


def test_the_python_examples_run_and_the_first_prints_what_the_readme_shows(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec("\n".join(blocks("python")), {"__name__": "readme"})  # noqa: S102
    printed = capsys.readouterr().out

    assert printed.startswith(blocks("text")[0])
    assert "6 mm rod" in printed.removeprefix(blocks("text")[0])


def test_every_command_is_listed():
    """Those of `solidtouch --help`, each in one row."""
    commands = {command.name or command.callback.__name__ for command in app.registered_commands}
    listed = re.findall(r"^\|[^|]*\| `([\w-]+)", README, flags=re.MULTILINE)

    assert sorted(listed) == sorted(commands | {group.name for group in app.registered_groups})


def test_the_equation_table_names_things_that_exist():
    """Every function and test file in the table is there."""
    table = (
        (ROOT / "docs" / "reference" / "equations.md").read_text(encoding="utf-8").split("|---|---|---|---|---|\n")[1]
    )
    names = re.findall(r"`([^`]+)`", table)
    assert names
    sources = "".join(
        path.read_text(encoding="utf-8") for folder in ("models", "inference") for path in (ROOT / folder).rglob("*.py")
    )
    for name in names:
        if name.endswith(".py"):
            assert any(list((ROOT / folder).rglob(name)) for folder in ("tests", "inference", ".")), name
        for function in re.findall(r"(?:^|: )(\w+)$", name):
            assert f"def {function}(" in sources, name
