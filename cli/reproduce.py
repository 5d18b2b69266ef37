"""`solidtouch reproduce`: the paper's experiment, from taps to the report."""

import shlex
import sys
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from ..models.errors import InputError
from .shared.interrupt import loading
from .shared.options import (
    MODELS,
    AllowUnconverged,
    Bins,
    Border,
    Deadline,
    Force,
    Model,
    Power,
    Pseudocount,
    Saturation,
    Seed,
    SettingFile,
    SplitMethod,
    TestSessions,
    TrainingTaps,
    TrainSessions,
    ValueRange,
    WhatCell,
    WhereCell,
    chosen,
    parse_thresholds,
)

_QUICK_DATA_SETS, _DATA_SETS = 4, 12
_QUICK_TRIALS, _TRIALS = 250, 1000


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
    theta_x: Annotated[float, Option(help="Belief in a position needed for a move; 0 always moves.")] = 0.0,
    fixation: Annotated[int | None, Option(help="Fixation point as 0-based class index; default the middle.")] = None,
    deadline: Deadline = 100,
    model: Model = "histogram",
    where_cell: WhereCell = None,
    what_cell: WhatCell = None,
    split: SplitMethod = None,
    train: TrainSessions = None,
    test: TestSessions = None,
    training_taps: TrainingTaps = False,
    bins: Bins = 100,
    pseudocount: Pseudocount = 0.01,
    power: Power = "J",
    saturation: Saturation = None,
    value_range: ValueRange = "global",
    border: Border = "uniform",
    allow_unconverged: AllowUnconverged = False,
    setting: SettingFile = None,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Runs the paper's experiment on simulated or recorded taps and writes figures, tables and a report."""
    files = [*(data or []), *(test_data or [])]
    if test_data and not data:
        raise InputError(f"{test_data[0]} is not expected here; recorded taps are named with --data.")
    simulated_only = {"--preset": preset, "--data-sets": data_sets}
    recorded_only = {"--split": split, "--train": train, "--test": test, "--training-taps": training_taps or None}
    for option, value in (simulated_only if files else recorded_only).items():
        if value is not None:
            raise InputError(f"{option} goes with {'simulated' if files else 'recorded'} taps only.")
    preset = preset or "paper"
    with loading():
        from rich.console import Console

        from ..analysis.experiment.settings import Settings
        from ..analysis.page.terminal import show
        from ..analysis.reproduce.results import Request
        from ..analysis.reproduce.run import reproduce as run
        from ..analysis.reproduce.run import simulated_split
        from ..models.experiment import load_experiment
        from ..models.power import parse_power_choice
        from ..models.setting import load_setting
    from ..models.storage import check_folder
    from .shared.progress import bars

    read = None if setting is None else load_setting(setting)
    cells = chosen(context, read, where_cell=where_cell, what_cell=what_cell)
    options = chosen(
        context,
        read,
        theta_x=theta_x,
        fixation=fixation,
        border=border,
        deadline=deadline,
        bins=bins,
        pseudocount=pseudocount,
        power=power,
        saturation=saturation,
        value_range=value_range,
        model=model,
    )
    options["power"] = parse_power_choice(str(options["power"]))
    settings = Settings(
        trials=trials or (_QUICK_TRIALS if quick else _TRIALS), seed=seed, unconverged=allow_unconverged, **options
    )
    if read is not None:
        more = tuple(sorted({*settings.thresholds, read.threshold}))
        settings = replace(settings, thresholds=more, shown_theta=read.threshold)
    if thresholds is not None:
        settings = replace(settings, thresholds=parse_thresholds(thresholds))
    folder = out or Path("runs") / datetime.now().astimezone().strftime("%Y-%m-%d-%H%M%S")
    check_folder(folder, force)
    with bars() as progress:
        if files:
            parts, grid = load_experiment(
                files, **cells, method=split, train=train, test=test, training_taps=training_taps
            )
        else:
            parts = simulated_split(preset, data_sets or (_QUICK_DATA_SETS if quick else _DATA_SETS), seed, progress)
            grid = parts.folds[0].train.grid(**cells)
        request = Request(
            parts,
            grid,
            settings,
            simulated=None if files else preset,
            files=tuple(Path(file).name for file in files),
            command=shlex.join(["solidtouch", *sys.argv[1:]]),
            episodes=4 if quick else 10,
            sequence_taps=8 if quick else 20,
        )
        page, summary = run(request, folder, force, progress)
    if read is not None and read.note:
        print(f"Setting: {read.note}")
    if settings.model != MODELS[0]:
        print(f"Model {settings.model}")
    show(page, Console())
    print(f"The report is {folder / 'report.html'}")
    if not summary["crosscheck"]["passed"]:
        raise typer.Exit(1)
