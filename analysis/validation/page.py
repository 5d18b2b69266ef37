"""Checks of this installation as a page."""

from collections.abc import Sequence

from ..page.page import Brief, Page, Table
from ..page.stages import Check


def validation_page(checks: Sequence[Check], seconds: bool = False) -> Page:
    """A row for each check, and a verdict.

    Args:
        checks: The checks.
        seconds: Whether the table shows how long each took.
    """
    head = ["check", "against", "found", "", *(["seconds"] if seconds else [])]
    rows = [
        [
            *(check.name, check.against, check.found, "ok" if check.passed else "FAILED"),
            *([f"{check.seconds:.0f}"] if seconds else []),
        ]
        for check in checks
    ]
    failed = [check.name for check in checks if not check.passed]
    verdict = f"All {len(checks)} checks passed."
    if failed:
        verdict = f"{len(failed)} of {len(checks)} checks FAILED: {', '.join(failed)}."
    return Page("Validation", [Brief(Table(head, rows, words={1, 2, 3})), Brief(verdict)], [])
