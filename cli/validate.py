"""`solidtouch validate`: check an installation against exact answers."""

from typing import Annotated

import typer
from typer import Option

from .shared.interrupt import loading
from .shared.options import Seed, Workers
from .shared.report import show_page


def validate(
    seed: Seed = 0,
    verbose: Annotated[bool, Option("--verbose", help="Print the duration of each check.")] = False,
    workers: Workers = None,
) -> None:
    """Check this installation against exact answers, in 10 to 20 seconds. Exit code 1 if it fails."""
    with loading():
        from ..analysis.validation.report import validate as study
    from .shared.progress import bars

    with bars() as progress:
        report = study(seed, seconds=verbose, workers=workers, progress=progress)
    show_page(report)
    if not report.passed:
        raise typer.Exit(1)
