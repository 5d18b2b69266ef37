"""`solidtouch collect`: known objects at known places, tapped and recorded."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .interrupt import loading, terminable

if TYPE_CHECKING:
    from rich.console import Console

    from ..hardware.collection import Operator
    from ..hardware.rig import Rig


def collect(
    rig_file: Annotated[Path, typer.Argument(metavar="RIG", help="The rig.toml of the bench.", show_default=False)],
    plan_file: Annotated[
        Path, typer.Argument(metavar="PLAN", help="The plan.toml of objects and positions.", show_default=False)
    ],
    out: Annotated[Path, typer.Option("--out", help="The .mcap file to write, one for each session.")],
    resume: Annotated[bool, typer.Option("--resume", help="Go on with OUT after its last accepted tap.")] = False,
    session: Annotated[int | None, typer.Option(min=0, help="Number of the session; default that of PLAN.")] = None,
    home: Annotated[bool, typer.Option("--home", help="Home the stage first: it moves to its limit switches.")] = False,
) -> None:
    """Taps the objects of PLAN with the rig and records everything; objects are changed by hand when asked for."""
    with loading():
        from msgspec.structs import replace
        from rich.console import Console

        from ..hardware.collection import collect as collect_taps
        from ..hardware.collection import resume_recording
        from ..hardware.disk_space import check_space, space_needed
        from ..hardware.open_rig import open_rig
        from ..hardware.plan import load_plan
        from ..hardware.recorded_settings import about_rig
        from ..hardware.recording import Recorder
        from ..hardware.rig_settings import load_rig, read_settings

    settings, plan = load_rig(rig_file), load_plan(plan_file)
    plan = plan if session is None else replace(plan, session=session)
    plan.check_range(settings.range)
    about = about_rig(settings, read_settings(rig_file), plan)
    taps = list(plan.taps())
    console = Console(stderr=True)
    with terminable():
        trials: frozenset[int] = frozenset()
        if resume:
            recorder, trials, lost = resume_recording(out, about)
            if lost:
                console.print(f"{out}: {lost}; the taps before are kept.", highlight=False, markup=False)
        else:
            recorder = Recorder.create(out, about)
        left = [tap for tap in taps if tap.trial not in trials]
        try:
            with recorder:
                check_space(out, space_needed(len(left), settings))
                if left:
                    with (
                        open_rig(settings, recorder, home=home) as rig,
                        _progress(console, len(trials), len(taps)) as advance,
                    ):
                        operator = _operator(rig, console)
                        collect_taps(rig, left, plan.objects, plan.settle_taps, operator, recorder, advance)
        except BaseException:
            if resume or recorder.presses:
                kept = len(trials) + recorder.taps
                console.print(
                    f"{out} holds {kept} of {len(taps)} taps; --resume goes on after them.",
                    highlight=False,
                    markup=False,
                )
            else:
                out.unlink(missing_ok=True)
            raise
    typer.echo(f"{out}: {len(taps)} taps; solidtouch convert {out} TAPS.nc makes a tap set of them.")


@contextmanager
def _progress(console: "Console", done: int, total: int) -> Iterator[Callable[[], None]]:
    """A bar with the time left, and the function that advances it by a tap."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("Taps", total=total, completed=done)
        yield lambda: progress.advance(task)


def _operator(rig: "Rig", console: "Console") -> "Operator":
    from .operators import Emulator, Person

    if rig.emulator is None:
        return Person(lambda line: console.print(line, highlight=False, markup=False))
    return Emulator(rig.emulator)
