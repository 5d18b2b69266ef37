"""`solidtouch reproduce`: the paper's experiment, from taps to report."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from ..models.errors import InputError
from ..models.measurement.registry import PAPER
from ..models.settings import Division, FitSettings, PlaySettings
from .shared.completion import presets
from .shared.interrupt import loading
from .shared.options import (
    DIVIDED,
    FITTING,
    Fields,
    Force,
    Model,
    Seed,
    SettingFile,
    Style,
    Thresholds,
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
        Option(
            metavar="FILE | TRAIN TEST",
            help="Recorded taps instead of simulated ones: one file to split, or a training and a test file.",
        ),
    ] = None,
    test_data: Annotated[list[str] | None, typer.Argument(metavar="TEST", hidden=True)] = None,
    out: Annotated[Path | None, Option(help="Folder for the results; default: runs/<date-time>.")] = None,
    quick: Annotated[
        bool, Option("--quick", help=f"Use {_QUICK_DATA_SETS} simulated data sets and {_QUICK_TRIALS} trials.")
    ] = False,
    preset: Annotated[
        str | None,
        Option(
            help="Preset of the simulated rig: paper, ideal, broken, hold2 or nodrift; default: paper.",
            autocompletion=presets,
        ),
    ] = None,
    data_sets: Annotated[
        int | None, Option(min=1, help=f"Number of simulated data sets; default: {_DATA_SETS}.")
    ] = None,
    trials: Annotated[
        int | None, Option(min=1, help=f"Trials per position and per fixation point; default: {_TRIALS}.")
    ] = None,
    thresholds: Thresholds = None,
    play: Annotated[PlaySettings, Fields("theta_x", "fixation", "deadline", "border")] = PlaySettings(),
    model: Model = "histogram",
    division: Annotated[Division, Fields(*DIVIDED, "training_taps", "missing")] = Division(),
    fit: Annotated[FitSettings, Fields(*FITTING, "saturation", "unconverged")] = FitSettings(),
    setting: SettingFile = None,
    seed: Seed = 0,
    style: Style = "page",
    force: Force = False,
) -> None:
    """Run the paper's experiment on simulated or recorded taps; write figures, tables and a report."""
    files = [*(data or []), *(test_data or [])]
    if test_data and not data:
        raise InputError(f"Unexpected argument {test_data[0]}; name recorded taps with --data.")
    with loading():
        from ..analysis.page.ahead import drawing_ahead
        from ..analysis.reproduce.check import checking_ahead
        from ..analysis.reproduce.report import reproduce as study
        from ..inference.trials.run import THRESHOLDS
        from ..models.setting_file import load_setting
    from .shared.progress import bars

    chosen = parse_thresholds(thresholds)
    read = None if setting is None else load_setting(setting)
    if read is not None:
        fit, play = merged(context, read, fit), merged(context, read, play)
        division = division.changed(**{key: getattr(read, key) for key in _FROM_SETTING if not given(context, key)})
        model = model if given(context, "model") else read.model
        if chosen is None:
            chosen = sorted({*THRESHOLDS, play.threshold})
    if quick and not files:
        data_sets = _QUICK_DATA_SETS if data_sets is None else data_sets
    folder = report_folder(out, force)
    with drawing_ahead(), checking_ahead(), bars() as progress:
        report = study(
            *files,
            preset=preset,
            data_sets=data_sets,
            trials=trials or (_QUICK_TRIALS if quick else _TRIALS),
            thresholds=chosen,
            play=play,
            model=model,
            division=division,
            fit=fit,
            episodes=4 if quick else 10,
            sequence_taps=8 if quick else 20,
            seed=seed,
            progress=progress,
            command=command_line(),
        )
        report.save(folder, force, progress, style)
    if read is not None and read.note:
        print(f"Setting: {read.note}")
    if model != PAPER:
        print(f"Model {model}")
    show_report(report, folder)
    if not report.passed:
        raise typer.Exit(1)
