"""`solidtouch collect`: taps of known objects at known positions, recorded."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..models.errors import InputError
from .shared.homing import Home, Yes, confirm_homing
from .shared.interrupt import loading

if TYPE_CHECKING:
    from rich.console import Console

    from ..hardware.recording.collection import Operator
    from ..hardware.recording.plan import Plan
    from ..hardware.rig.rig import Rig
    from ..hardware.rig.settings import RigFile


def collect(
    rig_file: Annotated[
        Path, typer.Argument(metavar="RIG", help="Settings file of the rig, rig.toml.", show_default=False)
    ],
    plan_file: Annotated[
        Path, typer.Argument(metavar="PLAN", help="Plan of objects and positions, plan.toml.", show_default=False)
    ],
    out: Annotated[Path, typer.Option("--out", help=".mcap file to write, one per session.")],
    resume: Annotated[bool, typer.Option("--resume", help="Continue OUT after its last accepted tap.")] = False,
    session: Annotated[int | None, typer.Option(min=0, help="Session number; default: as in PLAN.")] = None,
    home: Home = False,
    yes: Yes = False,
) -> None:
    """Tap the objects of PLAN at known positions and record everything; prompts for each change of object."""
    with loading():
        from msgspec.structs import replace
        from rich.console import Console

        from ..hardware.recording.collection import collect as collect_taps
        from ..hardware.recording.collection import resume_recording
        from ..hardware.recording.plan import load_plan
        from ..hardware.recording.recording import Recorder, check_space, space_needed
        from ..hardware.recording.settings import about_rig
        from ..hardware.rig.open_rig import open_rig
        from ..hardware.rig.settings import load_rig
        from ..models.io.recording import naming
        from ..models.io.toml import read_settings

    settings, plan = load_rig(rig_file), load_plan(plan_file)
    plan = plan if session is None else replace(plan, session=session)
    with naming(plan_file):
        plan.check_range(settings.range)
        _check_objects(plan, settings)
    confirm_homing(rig_file, home, yes)
    about = about_rig(settings, read_settings(rig_file), plan)
    taps = list(plan.taps())
    console = Console(stderr=True)
    say = partial(console.print, highlight=False, markup=False)
    trials: frozenset[int] = frozenset()
    if resume:
        recorder, trials, lost = resume_recording(out, about)
        if lost:
            say(f"{out}: {lost}; earlier taps are kept.")
    else:
        recorder = Recorder.create(out, about)
    left = [tap for tap in taps if tap.trial not in trials]
    try:
        with recorder:
            check_space(out, space_needed(len(left), settings))
            if left:
                say(f"Connecting to {settings.name}; the finger must touch nothing.")
                with (
                    open_rig(settings, recorder, home=home) as rig,
                    _progress(console, len(trials), len(taps)) as advance,
                ):
                    operator = _operator(rig, say)
                    collect_taps(rig, left, plan.objects, plan.settle_taps, operator, recorder, advance, say)
    except BaseException:
        if resume or recorder.presses:
            kept = len(trials) + recorder.taps
            say(f"{out}: {kept} of {len(taps)} taps recorded; continue with --resume.")
        else:
            out.unlink(missing_ok=True)
        raise
    typer.echo(f"{out}: {len(taps)} taps; convert them with `solidtouch convert {out} TAPS.nc`.")


@contextmanager
def _progress(console: "Console", done: int, total: int) -> Iterator[Callable[[], None]]:
    """Progress bar with the remaining time; yields the function that advances it by a tap."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("Taps", total=total, completed=done)
        yield lambda: progress.advance(task)


def _check_objects(plan: "Plan", settings: "RigFile") -> None:
    """Checks that the emulator has the objects of the plan; a person may have any.

    Raises:
        InputError: An object is missing.
    """
    from ..hardware.emulator.shared_clock import SocketConnection

    if settings.emulator is None:
        return
    with SocketConnection(settings.emulator.control) as connection:
        there = connection.control({})["objects"]
    for thing in plan.objects:
        if thing.name not in there:
            raise InputError(f"objects: the emulator has no {thing.name!r}; choose from {', '.join(there)}.")


def _operator(rig: "Rig", say: Callable[[str], object]) -> "Operator":
    from .shared.operators import Emulator, Person

    if rig.emulator is None:
        return Person(say)
    return Emulator(rig.emulator)
