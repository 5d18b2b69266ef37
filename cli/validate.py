"""`solidtouch validate`: check an installation against exact answers."""

from typing import Annotated

import typer
from typer import Option

from .shared.interrupt import loading
from .shared.options import Seed


def validate(
    seed: Seed = 0,
    verbose: Annotated[bool, Option("--verbose", help="Print the duration of each check.")] = False,
) -> None:
    """Check this installation against exact answers, in about two minutes; exit code 1 if a check fails."""
    with loading():
        from rich.console import Console
        from rich.table import Table

        from ..analysis.conformance.validate import check_engines
        from ..analysis.correctness.validate import check_beliefs, check_routes
    from .shared.progress import bars

    with bars() as progress:
        found = [check_routes(progress, seed), *check_engines(progress), *check_beliefs(progress, seed)]
    table = Table("check", "against", "found", "", *(["seconds"] if verbose else []), box=None)
    for check in found:
        row = [check.name, check.against, check.found, "ok" if check.passed else "FAILED"]
        table.add_row(*row, *([f"{check.seconds:.0f}"] if verbose else []))
    console = Console()
    console.print(table)
    failed = [check.name for check in found if not check.passed]
    if failed:
        console.print(f"{len(failed)} of {len(found)} checks FAILED: {', '.join(failed)}.", highlight=False)
        raise typer.Exit(1)
    console.print(f"All {len(found)} checks passed.", highlight=False)
