"""`solidtouch sensitivity`: what each choice that the paper leaves open is worth."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..models.errors import InputError
from .shared.interrupt import loading
from .shared.options import Force, Seed, TrainingTaps, WhatCell, WhereCell, Workers
from .shared.report import command_line, report_folder, show_report

_FEWEST_TRIALS, _QUICK_DATA_SETS, _QUICK_TRIALS = 50, 4, 300


def sensitivity(
    files: Annotated[
        list[Path] | None,
        Argument(
            metavar="[FILE...]",
            help="Recorded taps as for `inspect`, each on its own; three sessions or more are left out in turn.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path | None, Option(help="Folder for the results; default runs/<date-time>-sensitivity.")] = None,
    data_sets: Annotated[
        int, Option("--data-sets", min=0, max=10_000, help="Simulated data sets; 0 for recorded taps only.")
    ] = 40,
    preset: Annotated[str, Option(help="Settings of the simulated rig.")] = "paper",
    where_cell: WhereCell = None,
    what_cell: WhatCell = None,
    training_taps: TrainingTaps = False,
    trials: Annotated[int, Option(min=_FEWEST_TRIALS, max=10**6, help="Of each data set, policy and option.")] = 1000,
    strongest: Annotated[int, Option(min=0, max=18, help="Choices of which all pairs are tried.")] = 5,
    quick: Annotated[
        bool,
        Option(
            "--quick",
            help=f"At most {_QUICK_DATA_SETS} data sets of {_QUICK_TRIALS} trials: a look, too few to decide.",
        ),
    ] = False,
    workers: Workers = None,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Runs every option of what the paper leaves open: what changes its conclusion, its numbers, or nothing."""
    if quick:
        data_sets, trials = min(data_sets, _QUICK_DATA_SETS), min(trials, _QUICK_TRIALS)
    if not data_sets and not files:
        raise InputError("--data-sets 0 needs a file of recorded taps.")
    for option, width in (("--where-cell", where_cell), ("--what-cell", what_cell)):
        if width is not None and not files:
            raise InputError(
                f"{option} {width} divides recorded taps, and no file is given; simulated ones keep theirs."
            )
    with loading():
        from ..analysis.experiment.sources import recorded_source, simulated_source
        from ..analysis.sensitivity.page import write_sensitivity
        from ..analysis.sensitivity.run import SensitivitySettings
        from ..analysis.sensitivity.run import sensitivity as run
        from ..analysis.sensitivity.summary import summarise
    from .shared.progress import bars

    folder = report_folder(out, force, "sensitivity")
    sources = [simulated_source(preset, data_sets, seed)] if data_sets else []
    sources += [recorded_source(path, where_cell, what_cell, training_taps) for path in files or ()]
    settings = SensitivitySettings(trials=trials, seed=seed, strongest=strongest, workers=workers)
    with bars() as progress:
        studies = [run(source, settings, progress) for source in sources]
    title = "What the open choices of the paper are worth"
    summary = summarise(studies, settings, {"title": title, "command": command_line()})
    show_report(write_sensitivity(folder, summary, force), folder)
