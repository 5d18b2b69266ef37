"""`solidtouch inspect`: check recordings."""

from pathlib import Path
from typing import Annotated

import typer

from .shared.interrupt import loading
from .shared.options import Missing, WhatCell, WhereCell


def inspect(
    data: Annotated[
        Path,
        typer.Argument(metavar="DATA", help="Taps: .nc, .zarr, .mcap, .npz, .csv, .mat or a folder of .csv files."),
    ],
    where_cell: WhereCell = None,
    what_cell: WhatCell = None,
    missing: Missing = "refuse",
) -> None:
    """Print sizes, ranges and data-quality warnings of a tap set, and what it can show."""
    with loading():
        from ..analysis.inspect.report import inspect as study
        from .shared.report import show_page

    show_page(study(data, where_cell, what_cell, missing))
