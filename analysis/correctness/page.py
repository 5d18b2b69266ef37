"""The cross-check as a page."""

from ..experiment.crosscheck import NEAR_TIE, CrossCheck
from ..page.crosscheck import crosscheck_table
from ..page.page import Brief, Page


def crosscheck_page(check: CrossCheck) -> Page:
    """The comparison as a table, and a verdict."""
    counts = (
        f"{check.episodes} episodes of {check.taps} taps, the first {check.sequence_taps} enumerated as whole "
        f"sequences: {check.differing_decisions} decisions and {check.differing_moves} moves differ, "
        f"{check.near_ties} near-ties within {NEAR_TIE:g}."
    )
    verdict = "All routes agree." if check.passed else "The routes DISAGREE."
    return Page("Cross-check", [Brief(crosscheck_table(check)), *map(Brief, (counts, *check.notes, verdict))], [])
