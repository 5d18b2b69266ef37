"""`solidtouch rig check`: devices, timing and noise of a rig."""

from pathlib import Path
from typing import Annotated

import typer

from .shared.homing import Home, Yes, confirm_homing
from .shared.interrupt import loading, terminable

app = typer.Typer(help="Check the devices of a rig.", no_args_is_help=True)


@app.callback()
def rig() -> None:
    """Check the devices of a rig."""


@app.command()
def check(
    rig_file: Annotated[
        Path, typer.Argument(metavar="RIG", help="Settings file of the rig, rig.toml.", show_default=False)
    ],
    seconds: Annotated[float, typer.Option(min=0.5, help="Duration of the sensor check in seconds.")] = 10.0,
    home: Home = False,
    yes: Yes = False,
) -> None:
    """Check devices, timing, noise, drift and travel; exit code 1 if there is a problem.

    The finger must touch nothing. Without --home nothing moves.
    """
    with loading():
        from rich.console import Console

        from ..hardware.journal import NoJournal
        from ..hardware.rig.check import check_rig
        from ..hardware.rig.open_rig import unconnected
        from ..hardware.rig.settings import load_rig
        from .shared.showing_rig import show_report

    settings = load_rig(rig_file)
    confirm_homing(rig_file, home, yes)
    console = Console()
    with (
        terminable(),
        unconnected(settings, NoJournal()) as rig,
        Console(stderr=True).status(f"Reading the sensor for {seconds:g} s ..."),
    ):
        report = check_rig(rig, seconds, home)
    show_report(report, console)
    if report.wrong:
        raise typer.Exit(1)
