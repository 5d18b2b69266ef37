"""The cross-check on a terminal."""

from rich.console import Console
from rich.table import Table

from ..experiment.crosscheck import NEAR_TIE, CrossCheck


def render(check: CrossCheck, console: Console) -> None:
    """Prints the comparison as a table and a verdict."""
    table = Table("routes", "quantity", "difference", "allowed", "")
    for row in check.rows:
        table.add_row(
            row.routes, row.quantity, f"{row.largest:.2e}", f"{row.allowed:.0e}", "ok" if row.passed else "DIFFERS"
        )
    console.print(table)
    console.print(
        f"{check.episodes} episodes of {check.taps} taps, the first {check.sequence_taps} enumerated as whole "
        f"sequences: {check.differing_decisions} decisions and {check.differing_moves} moves differ, "
        f"{check.near_ties} near-ties within {NEAR_TIE:g}.",
        highlight=False,
    )
    for note in check.notes:
        console.print(note, highlight=False)
    console.print("All routes agree." if check.passed else "The routes DISAGREE.", highlight=False)
