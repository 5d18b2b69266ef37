"""`solidtouch strategies`: how to move and when to stop, compared on the same trials."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..models.errors import InputError
from .shared.interrupt import loading
from .shared.options import Force, Seed, TrainingTaps, WhatCell, WhereCell, Workers
from .shared.report import command_line, report_folder, show_report

_FEWEST_TRIALS, _QUICK_DATA_SETS, _QUICK_TRIALS = 50, 3, 50


def strategies(
    files: Annotated[
        list[Path] | None,
        Argument(
            metavar="[DATA...]",
            help="Recorded taps as for `inspect`, each on its own, with a tap in every cell.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path | None, Option(help="Folder for the results; default runs/<date-time>-strategies.")] = None,
    presets: Annotated[
        str,
        Option(
            metavar="LIST",
            help="Presets of the simulated rig, separated by commas; model draws taps from the model that perceives "
            "them; none for recorded taps only.",
        ),
    ] = "ideal,paper,nodrift,broken,model",
    data_sets: Annotated[
        int, Option("--data-sets", min=2, max=10_000, help="Simulated data sets of each preset.")
    ] = 10,
    where_cell: WhereCell = None,
    what_cell: WhatCell = None,
    training_taps: TrainingTaps = False,
    trials: Annotated[int, Option(min=_FEWEST_TRIALS, max=10**6, help="Of each data set and strategy.")] = 100,
    quick: Annotated[
        bool,
        Option(
            "--quick",
            help=f"At most {_QUICK_DATA_SETS} data sets of {_QUICK_TRIALS} trials: a look, in which little is decided.",
        ),
    ] = False,
    regret: Annotated[
        bool | None,
        Option(
            "--regret/--no-regret",
            help="What strategies cost more than the exact rule, or a bound, on taps drawn from a right model; "
            "default with any preset.",
            show_default=False,
        ),
    ] = None,
    workers: Workers = None,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Compares strategies of moving and rules of stopping: error against taps and way, one page."""
    if quick:
        data_sets, trials = min(data_sets, _QUICK_DATA_SETS), min(trials, _QUICK_TRIALS)
    names = [] if presets == "none" else [name.strip() for name in presets.split(",")]
    regret = bool(names) if regret is None else regret
    if not names and not files and not regret:
        raise InputError("--presets none needs a file of recorded taps, or --regret.")
    if "" in names:
        raise InputError(f"--presets needs names between its commas, got {presets!r}.")
    if len(set(names)) < len(names):
        raise InputError(f"--presets names one twice: {presets}.")
    with loading():
        from ..analysis.strategies.data import recorded_bench, simulated_bench
        from ..analysis.strategies.page import write_strategies
        from ..analysis.strategies.regret import QUICK_TRIALS, TRIALS, RegretSettings, regret_study
        from ..analysis.strategies.regret_summary import summarise_regret
        from ..analysis.strategies.run import StrategySettings, strategy_study
        from ..analysis.strategies.summary import summarise
    from .shared.progress import bars

    folder = report_folder(out, force, "strategies")
    benches = [simulated_bench(name, data_sets, seed) for name in names]
    benches += [recorded_bench(path, where_cell, what_cell, training_taps) for path in files or ()]
    settings = StrategySettings(trials=trials, seed=seed, workers=workers)
    with bars() as progress:
        studies = [strategy_study(bench, settings, progress) for bench in benches]
        regrets = RegretSettings(QUICK_TRIALS if quick else TRIALS, seed, workers)
        lost = summarise_regret(regret_study(regrets, progress), regrets) if regret else None
    title = "How to move and when to stop"
    command = command_line()
    summary = summarise(studies, settings, {"title": title, "command": command}, lost)
    show_report(write_strategies(folder, summary, force), folder)
