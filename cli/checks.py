"""`solidtouch crosscheck`: all ways of computing the posterior, compared."""

from typing import Annotated

import typer
from typer import Option

from .interrupt import loading
from .options import (
    Bins,
    Border,
    Data,
    Power,
    Pseudocount,
    Seed,
    SplitMethod,
    TestSessions,
    TrainSessions,
    ValueRange,
    WhatCell,
    WhereCell,
)


def crosscheck(
    data: Data,
    where_cell: WhereCell = None,
    what_cell: WhatCell = None,
    split: SplitMethod = None,
    train: TrainSessions = None,
    test: TestSessions = None,
    bins: Bins = 100,
    pseudocount: Pseudocount = 0.01,
    power: Power = "J",
    value_range: ValueRange = "global",
    border: Border = "uniform",
    episodes: Annotated[int, Option(min=1, help="Episodes to compare.")] = 10,
    length: Annotated[int, Option(min=1, help="Taps of each episode.")] = 40,
    sequence_taps: Annotated[int, Option(min=0, max=20, help="Taps of each that are enumerated at once.")] = 20,
    seed: Seed = 0,
) -> None:
    """Compares all engines on episodes with moves over the test taps of DATA; exit code 1 if they differ."""
    from rich.console import Console

    with loading():
        from ..analysis.crosscheck import crosscheck as compare
        from ..analysis.crosscheck import render
        from ..analysis.study import Settings
        from ..models.experiment import load_experiment
        from ..models.histogram import trim
        from ..models.power import parse_power
    from .progress import bars

    parts, grid = load_experiment(data, where_cell, what_cell, split, train, test)
    grid, _ = trim(grid, [fold.train for fold in parts.folds])
    settings = Settings(bins=bins, pseudocount=pseudocount, power=parse_power(power), value_range=value_range)
    fold = parts.folds[0]
    model = settings.fit(fold.train, grid)
    with bars() as progress:
        advance = progress("Cross-checking engines", episodes)
        result = compare(
            model,
            model.usable(fold.test),
            border=border,
            episodes=episodes,
            length=length,
            sequence_taps=sequence_taps,
            seed=seed,
            progress=lambda: advance(1),
        )
    console = Console()
    console.print(parts.description, highlight=False)
    render(result, console)
    if not result.passed:
        raise typer.Exit(1)
