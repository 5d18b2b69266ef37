"""Exit codes of all commands and of single ones, from the tables of docs/reference/exit-codes.md."""

from pathlib import Path

from benchmarks.page import table_rows

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "exit-codes.md"


def of_all() -> dict[str, str]:
    """Meaning of each exit code."""
    return _tables()[0]


def of_ones() -> dict[str, str]:
    """What exit code 1 means, by command."""
    return {command.strip("`"): meaning for command, meaning in _tables()[1].items()}


def _tables() -> tuple[dict[str, str], dict[str, str]]:
    codes, _, ones = PAGE.read_text(encoding="utf-8").partition("| command |")
    first, second = (
        {name: cells[1] for name, cells in table_rows(text).items()} for text in (codes, f"| command |{ones}")
    )
    return first, second
