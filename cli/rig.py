"""`solidtouch rig check`: devices, timing and noise of a rig."""

from pathlib import Path
from typing import Annotated

import typer

from ..models.errors import InputError
from .shared.homing import Home, Yes, confirm_homing
from .shared.interrupt import loading

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
        unconnected(settings, NoJournal()) as rig,
        Console(stderr=True).status(f"Reading the sensor for {seconds:g} s ..."),
    ):
        report = check_rig(rig, seconds, home)
    show_report(report, console)
    if report.wrong:
        raise typer.Exit(1)


@app.command()
def approach(
    rig_file: Annotated[
        Path, typer.Argument(metavar="RIG", help="Settings file of the rig, rig.toml.", show_default=False)
    ],
    at: Annotated[
        float | None, typer.Option("--at", help="Position along the finger in mm; default: the middle of the range.")
    ] = None,
    home: Home = False,
    yes: Yes = False,
) -> None:
    """Approach an object slowly until the finger touches it, to prove the geometry; exit code 1 if there is a problem.

    Moves at 1 mm/s, in steps of 0.1 mm from tap.clear_mm towards tap.depth_mm.
    """
    with loading():
        from rich.console import Console

        from ..hardware.journal import NoJournal
        from ..hardware.rig.approach import SLOW_MM_S
        from ..hardware.rig.approach import approach as approached
        from ..hardware.rig.open_rig import connected, unconnected
        from ..hardware.rig.settings import load_rig

    settings = load_rig(rig_file)
    limits = settings.range
    x_mm = (limits.start_mm + limits.end_mm) / 2 if at is None else at
    if not limits.start_mm <= x_mm <= limits.end_mm:
        raise InputError(f"--at {x_mm:g} is outside the range, {limits.start_mm:g} to {limits.end_mm:g} mm.")
    confirm_homing(rig_file, home, yes)
    with (
        unconnected(settings, NoJournal()) as rig,
        Console(stderr=True).status(f"Approaching at {SLOW_MM_S:g} mm/s ..."),
    ):
        rig.slow_mm_s = SLOW_MM_S
        with connected(rig, home):
            found = approached(rig, x_mm)
    if found.contact_mm is not None:
        pressed = found.depth_mm - found.contact_mm
        begins = f"The object begins at y = {found.contact_mm:.1f} mm"
        print(f"{begins}; tap.depth_mm = {found.depth_mm:g} presses it by {pressed:.1f} mm.")
    for sentence in found.wrong:
        print(f"! {sentence}")
    print(rig.rest)
    if found.wrong:
        raise typer.Exit(1)
