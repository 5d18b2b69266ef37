"""`solidtouch compare`: measurement models compared by prediction, classification and decisions."""

from pathlib import Path
from typing import Annotated, Literal

from typer import Option

from ..analysis.tasks.crew import PATIENCE_S
from ..models.measurement.registry import NAMES
from ..models.settings import Division, FitSettings, PlaySettings
from .shared.completion import model_lists
from .shared.interrupt import loading
from .shared.options import (
    DIVIDED,
    FITTING,
    Data,
    Fields,
    Force,
    Patience,
    Scheduler,
    Seed,
    Style,
    Thresholds,
    parse_thresholds,
    spelled_out,
)
from .shared.report import command_line, report_folder, show_report

_QUICK_DRAWS, QUICK_TRIALS, _QUICK_FOLDS = 100, 500, 3
QUICK = {"resamples": 25, "replicates": 8}


@spelled_out
def compare(
    data: Data,
    models: Annotated[
        str,
        Option(
            help="Models separated by commas, the reference first, such as histogram,profile; or all.",
            autocompletion=model_lists,
        ),
    ] = "all",
    out: Annotated[Path | None, Option(help="Folder for the results; default: runs/<date-time>-compare.")] = None,
    division: Annotated[Division, Fields(*DIVIDED, "training_taps", "missing")] = Division(),
    fit: Annotated[FitSettings, Fields(*FITTING, "unconverged")] = FitSettings(),
    draws: Annotated[
        int,
        Option(
            min=0,
            help="Posterior draws per model, at least 100, for leave-one-out and predictive checks; 0 skips both.",
        ),
    ] = 400,
    trials: Annotated[int, Option(min=1, help="Trials per model, passive and active.")] = 4000,
    thresholds: Thresholds = None,
    play: Annotated[PlaySettings, Fields("theta_x", "fixation", "deadline", "border")] = PlaySettings(),
    leave_out: Annotated[
        Literal["session", "position", "object"], Option(help="What models predict without training on it.")
    ] = "session",
    folds: Annotated[
        int,
        Option(
            min=1,
            help="Most folds; more sessions, positions or objects are grouped. With 1, only test sessions.",
        ),
    ] = 6,
    quick: Annotated[
        bool,
        Option(
            "--quick",
            help=f"Preview with wider intervals: {_QUICK_DRAWS} draws, {QUICK_TRIALS} trials, {QUICK['resamples']} "
            f"resamples and {QUICK['replicates']} replicates at most, sessions of the test taps alone left out, or "
            f"{_QUICK_FOLDS} groups of positions or objects.",
        ),
    ] = False,
    scheduler: Scheduler = None,
    patience: Patience = PATIENCE_S,
    seed: Seed = 0,
    style: Style = "page",
    force: Force = False,
) -> None:
    """Compare measurement models by prediction, classification and decision error."""
    if quick:
        draws, trials = min(draws, _QUICK_DRAWS), min(trials, QUICK_TRIALS)
        folds = min(folds, 1 if leave_out == "session" else _QUICK_FOLDS)
    with loading():
        from ..analysis.compare.report import compare as study
        from ..analysis.compare.taps import without_placeholders
        from ..analysis.page.ahead import drawing_ahead

        without_placeholders()
    from .shared.progress import bars

    names = NAMES if models == "all" else [name.strip() for name in models.split(",")]
    folder = report_folder(out, force, "compare")
    with drawing_ahead(), bars() as progress:
        report = study(
            *data,
            models=names,
            division=division,
            fit=fit,
            draws=draws,
            trials=trials,
            thresholds=parse_thresholds(thresholds),
            play=play,
            leave_out=leave_out,
            folds=folds,
            **(QUICK if quick else {}),
            scheduler=scheduler,
            patience=patience,
            seed=seed,
            progress=progress,
            command=command_line(),
        )
        report.save(folder, force, progress, style)
    show_report(report, folder)
