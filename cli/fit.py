"""`solidtouch fit`: a measurement model from training taps."""

from pathlib import Path
from typing import Annotated

from typer import Option

from .interrupt import loading
from .options import (
    Bins,
    Data,
    Force,
    Power,
    Pseudocount,
    SplitMethod,
    TestSessions,
    TrainSessions,
    ValueRange,
    WhatCell,
    WhereCell,
)


def fit(
    data: Data,
    out: Annotated[Path, Option(help="The file to write, such as model.nc.")],
    where_cell: WhereCell = None,
    what_cell: WhatCell = None,
    split: SplitMethod = None,
    train: TrainSessions = None,
    test: TestSessions = None,
    bins: Bins = 100,
    pseudocount: Pseudocount = 0.01,
    power: Power = "J",
    value_range: ValueRange = "global",
    force: Force = False,
) -> None:
    """Fits the histogram model to the training taps of DATA."""
    from ..models.storage import check_netcdf_name, check_writable

    check_netcdf_name(out)
    check_writable(out, force)
    from ..models.errors import InputError

    with loading():
        from dataclasses import replace

        from ..models.experiment import load_experiment
        from ..models.histogram import fit as fit_histogram
        from ..models.histogram import trim
        from ..models.novelty import novelty_scores
        from ..models.power import parse_power

    parts, grid = load_experiment(data, where_cell, what_cell, split, train, test)
    if len(parts.folds) != 1:
        raise InputError(f"--split {parts.method} makes {len(parts.folds)} models; fit writes one, so choose another.")
    fold = parts.folds[0]
    grid, dropped = trim(grid, [fold.train])
    model = fit_histogram(
        fold.train,
        grid,
        bins=bins,
        pseudocount=pseudocount,
        power=parse_power(power),
        value_range=value_range,
        trained_on=f"{', '.join(path.name for path in data)}: {parts.description}",
    )
    replace(model, novelty=novelty_scores(model, fold.train)).save(out, force)
    left_out = [*dropped, *model.left_out]
    print(parts.description)
    if parts.warning:
        print(f"Warning: {parts.warning}")
    print(f"{grid.L} x {grid.M} (where, what) classes from {len(fold.train)} taps, in {out}")
    if left_out:
        print(f"Left out for want of a training tap: {', '.join(left_out)}")
