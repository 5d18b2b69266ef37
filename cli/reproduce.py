"""`solidtouch reproduce`: the paper's experiment, from taps to the report."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from ..models.errors import InputError
from ..models.measurement.registry import PAPER
from ..models.settings import Division, FitSettings, PlaySettings
from .shared.interrupt import loading
from .shared.options import (
    DIVIDED,
    FITTING,
    Fields,
    Force,
    Model,
    Seed,
    SettingFile,
    given,
    merged,
    parse_thresholds,
    spelled_out,
)
from .shared.report import command_line, report_folder, show_report

_QUICK_DATA_SETS, _DATA_SETS = 4, 12
_QUICK_TRIALS, _TRIALS = 250, 1000
_FROM_SETTING = "where_cell", "what_cell"


@spelled_out
def reproduce(
    context: typer.Context,
    data: Annotated[
        list[str] | None,
        Option(metavar="FILE | TRAIN TEST", help="Recorded taps instead of simulated ones: one file to split, or two."),
    ] = None,
    test_data: Annotated[list[str] | None, typer.Argument(metavar="TEST", hidden=True)] = None,
    out: Annotated[Path | None, Option(help="Folder for the results; default runs/<date-time>.")] = None,
    quick: Annotated[
        bool, Option("--quick", help=f"{_QUICK_DATA_SETS} simulated data sets, {_QUICK_TRIALS} trials each.")
    ] = False,
    preset: Annotated[
        str | None, Option(help="Which simulated rig: paper, ideal, broken, hold2 or nodrift; default paper.")
    ] = None,
    data_sets: Annotated[int | None, Option(min=1, help=f"Simulated data sets; default {_DATA_SETS}.")] = None,
    trials: Annotated[
        int | None, Option(min=1, help=f"Trials per position and per fixation point; default {_TRIALS}.")
    ] = None,
    thresholds: Annotated[str | None, Option(help="Belief thresholds, such as 0.5,0.9,0.99.")] = None,
    play: Annotated[PlaySettings, Fields("theta_x", "fixation", "deadline", "border")] = PlaySettings(),
    model: Model = "histogram",
    division: Annotated[Division, Fields(*DIVIDED, "training_taps")] = Division(),
    fit: Annotated[FitSettings, Fields(*FITTING, "saturation", "unconverged")] = FitSettings(),
    setting: SettingFile = None,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Runs the paper's experiment on simulated or recorded taps and writes figures, tables and a report."""
    files = [*(data or []), *(test_data or [])]
    if test_data and not data:
        raise InputError(f"{test_data[0]} is not expected here; recorded taps are named with --data.")
    simulated_only = {"--preset": preset, "--data-sets": data_sets}
    recorded_only = {
        "--split": division.split,
        "--train": division.train,
        "--test": division.test,
        "--training-taps": division.training_taps or None,
    }
    for option, value in (simulated_only if files else recorded_only).items():
        if value is not None:
            raise InputError(f"{option} goes with {'simulated' if files else 'recorded'} taps only.")
    preset = preset or "paper"
    with loading():
        from ..analysis.experiment.settings import ExperimentSettings
        from ..analysis.reproduce.results import Request
        from ..analysis.reproduce.run import reproduce as run
        from ..analysis.reproduce.run import simulated_split
        from ..inference.trials.run import THRESHOLDS
        from ..models.experiment import load_experiment
        from ..models.setting_file import load_setting
    from .shared.progress import bars

    read = None if setting is None else load_setting(setting)
    if read is not None:
        fit, play = merged(context, read, fit), merged(context, read, play)
        division = division.changed(**{key: getattr(read, key) for key in _FROM_SETTING if not given(context, key)})
        model = model if given(context, "model") else read.model
    settings = ExperimentSettings(
        model=model,
        fit=fit.changed(seed=seed),
        play=play,
        trials=trials or (_QUICK_TRIALS if quick else _TRIALS),
        thresholds=THRESHOLDS if read is None else tuple(sorted({*THRESHOLDS, read.play.threshold})),
        seed=seed,
    )
    if thresholds is not None:
        settings = settings.changed(thresholds=parse_thresholds(thresholds))
    folder = report_folder(out, force)
    with bars() as progress:
        if files:
            parts, grid = load_experiment(files, division)
        else:
            parts = simulated_split(preset, data_sets or (_QUICK_DATA_SETS if quick else _DATA_SETS), seed, progress)
            grid = parts.folds[0].train.grid(division.where_cell, division.what_cell)
        request = Request(
            parts,
            grid,
            settings,
            simulated=None if files else preset,
            files=tuple(Path(file).name for file in files),
            command=command_line(),
            episodes=4 if quick else 10,
            sequence_taps=8 if quick else 20,
        )
        page, summary = run(request, folder, force, progress)
    if read is not None and read.note:
        print(f"Setting: {read.note}")
    if settings.model != PAPER:
        print(f"Model {settings.model}")
    show_report(page, folder)
    if not summary["crosscheck"]["passed"]:
        raise typer.Exit(1)
