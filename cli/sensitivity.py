"""`solidtouch sensitivity`: the effect of each choice that the paper leaves open."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..analysis.tasks.crew import PATIENCE_S
from ..models.settings import Division
from .shared.completion import presets
from .shared.interrupt import loading
from .shared.options import (
    CELLS,
    Fields,
    Force,
    Patience,
    Scheduler,
    Seed,
    Style,
    Workers,
    spelled_out,
)
from .shared.report import command_line, report_folder, show_report

_FEWEST_TRIALS, _QUICK_DATA_SETS, _QUICK_TRIALS = 50, 4, 300


@spelled_out
def sensitivity(
    files: Annotated[
        list[Path] | None,
        Argument(
            metavar="[FILE...]",
            help="Recorded taps as for `inspect`, each file a data set; three or more sessions are left out in turn.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path | None, Option(help="Folder for the results; default: runs/<date-time>-sensitivity.")] = None,
    data_sets: Annotated[
        int, Option("--data-sets", min=0, max=10_000, help="Number of simulated data sets; 0 uses recorded taps only.")
    ] = 40,
    preset: Annotated[str, Option(help="Preset of the simulated rig.", autocompletion=presets)] = "paper",
    division: Annotated[Division, Fields(*CELLS, "training_taps")] = Division(),
    trials: Annotated[
        int, Option(min=_FEWEST_TRIALS, max=10**6, help="Trials per data set, policy and option.")
    ] = 1000,
    strongest: Annotated[
        int, Option(min=0, max=18, help="Number of most influential choices whose pairs are all tested.")
    ] = 5,
    quick: Annotated[
        bool,
        Option(
            "--quick",
            help=f"Preview with at most {_QUICK_DATA_SETS} data sets of {_QUICK_TRIALS} trials.",
        ),
    ] = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    patience: Patience = PATIENCE_S,
    seed: Seed = 0,
    style: Style = "page",
    force: Force = False,
) -> None:
    """Measure the effect of each choice that the paper leaves open on its conclusion and numbers."""
    if quick:
        data_sets, trials = min(data_sets, _QUICK_DATA_SETS), min(trials, _QUICK_TRIALS)
    with loading():
        from ..analysis.sensitivity.report import sensitivity as study
    from .shared.progress import bars

    folder = report_folder(out, force, "sensitivity")
    with bars() as progress:
        report = study(
            *(files or ()),
            data_sets=data_sets,
            preset=preset,
            division=division,
            trials=trials,
            strongest=strongest,
            workers=workers,
            scheduler=scheduler,
            patience=patience,
            seed=seed,
            progress=progress,
            command=command_line(),
        )
        report.save(folder, force, progress, style)
    show_report(report, folder)
