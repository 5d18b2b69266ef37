"""Table of a cross-check of engines."""

from ..experiment.crosscheck import CrossCheck
from .numbers import number
from .page import Table


def crosscheck_table(check: CrossCheck) -> Table:
    """The largest differences between independent ways of computing the same."""
    rows = [
        [row.quantity, row.routes, number(row.largest), number(row.allowed), "passed" if row.passed else "FAILED"]
        for row in check.rows
    ]
    return Table(["quantity", "routes", "largest difference", "allowed", "result"], rows, words={1, 4})
