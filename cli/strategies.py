"""`solidtouch strategies`: control strategies and stopping rules compared on the same trials."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..analysis.tasks.crew import PATIENCE_S
from ..models.errors import InputError
from ..models.settings import Division
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

_FEWEST_TRIALS, _QUICK_DATA_SETS, _QUICK_TRIALS = 50, 3, 50


@spelled_out
def strategies(
    files: Annotated[
        list[Path] | None,
        Argument(
            metavar="[DATA...]",
            help="Recorded taps as for `inspect`, each file a separate data set with a tap in every cell.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path | None, Option(help="Folder for the results; default: runs/<date-time>-strategies.")] = None,
    presets: Annotated[
        str,
        Option(
            metavar="LIST",
            help="Presets of the simulated rig, separated by commas; model draws taps from the model used for "
            "perception; none uses recorded taps only.",
        ),
    ] = "ideal,paper,nodrift,broken,model",
    data_sets: Annotated[int, Option("--data-sets", min=2, max=10_000, help="Simulated data sets per preset.")] = 10,
    division: Annotated[Division, Fields(*CELLS, "training_taps")] = Division(),
    trials: Annotated[int, Option(min=_FEWEST_TRIALS, max=10**6, help="Trials per data set and strategy.")] = 100,
    quick: Annotated[
        bool,
        Option(
            "--quick",
            help=f"Preview with at most {_QUICK_DATA_SETS} data sets of {_QUICK_TRIALS} trials.",
        ),
    ] = False,
    regret: Annotated[
        bool | None,
        Option(
            "--regret/--no-regret",
            help="Compute the excess cost of strategies over the exact rule, or a bound, on taps drawn from a correct "
            "model; default: yes with any preset.",
            show_default=False,
        ),
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    patience: Patience = PATIENCE_S,
    seed: Seed = 0,
    style: Style = "page",
    force: Force = False,
) -> None:
    """Compare control strategies and stopping rules: error against taps and distance travelled."""
    if quick:
        data_sets, trials = min(data_sets, _QUICK_DATA_SETS), min(trials, _QUICK_TRIALS)
    names = [] if presets == "none" else [name.strip() for name in presets.split(",")]
    if "" in names:
        raise InputError(f"--presets must be names separated by commas, got {presets!r}.")
    with loading():
        from ..analysis.strategies.regret import QUICK_TRIALS, TRIALS
        from ..analysis.strategies.report import strategies as study
    from .shared.progress import bars

    regret = bool(names) if regret is None else regret
    folder = report_folder(out, force, "strategies")
    with bars() as progress:
        report = study(
            *(files or ()),
            presets=names,
            data_sets=data_sets,
            division=division,
            trials=trials,
            regret=(QUICK_TRIALS if quick else TRIALS) if regret else 0,
            workers=workers,
            scheduler=scheduler,
            patience=patience,
            seed=seed,
            progress=progress,
            command=command_line(),
        )
        report.save(folder, force, progress, style)
    show_report(report, folder)
