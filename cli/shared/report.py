"""What commands that write a report have in common: its folder, the command line in it, and what is printed of it."""

import shlex
import sys
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...analysis.page.report import Report


def report_folder(out: Path | None, force: bool, study: str = "") -> Path:
    """The folder of a report: the one asked for, or `runs/<date-time>` with the study's name behind it.

    Raises:
        InputError: It cannot be written, or exists and `force` is not set.
    """
    from ...models.storage import check_folder

    name = "-".join(filter(None, (f"{datetime.now().astimezone():%Y-%m-%d-%H%M%S}", study)))
    folder = out or Path("runs") / name
    check_folder(folder, force)
    return folder


def command_line() -> str:
    """The command as it was typed, for the report."""
    return shlex.join(["solidtouch", *sys.argv[1:]])


def show_report(report: "Report", folder: Path) -> None:
    """Prints the gist of a report, and where the whole is."""
    from rich.console import Console

    from ...analysis.page.terminal import show

    show(report.page, Console())
    print(f"The report is {folder / 'report.html'}")
