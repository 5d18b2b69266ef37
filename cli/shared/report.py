"""Reports of commands: folder, command line and printed summary."""

import shlex
import sys
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...analysis.page.report import Report


def report_folder(out: Path | None, force: bool, study: str = "") -> Path:
    """Folder of a report: `out`, or `runs/<date-time>` followed by the name of the study.

    Raises:
        InputError: It cannot be written, or exists and `force` is not set.
    """
    from ...models.storage import check_folder

    name = "-".join(filter(None, (f"{datetime.now().astimezone():%Y-%m-%d-%H%M%S}", study)))
    folder = out or Path("runs") / name
    check_folder(folder, force)
    return folder


def command_line() -> str:
    """The command line, for the report."""
    return shlex.join(["solidtouch", *sys.argv[1:]])


def show_page(report: "Report") -> None:
    """Prints the summary of a report."""
    from ...analysis.page.terminal import show

    show(report.page)


def show_report(report: "Report", folder: Path) -> None:
    """Prints the summary of a report and its path."""
    show_page(report)
    print(f"Report saved to {folder / 'report.html'}")
