"""`solidtouch fit`: a measurement model from training taps."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Option

from .shared.interrupt import loading
from .shared.options import (
    AllowUnconverged,
    Bins,
    Data,
    Force,
    Model,
    Power,
    Pseudocount,
    Saturation,
    Seed,
    SplitMethod,
    TestSessions,
    TrainSessions,
    ValueRange,
    WhatCell,
    WhereCell,
)

if TYPE_CHECKING:
    from ..models.io.model_file import Draws
    from ..models.measurement.catalogue import FitSettings, Fitted
    from ..models.taps import TapSet


def fit(
    data: Data,
    out: Annotated[Path, Option(help="The file to write, such as model.nc.")],
    model: Model = "histogram",
    where_cell: WhereCell = None,
    what_cell: WhatCell = None,
    split: SplitMethod = None,
    train: TrainSessions = None,
    test: TestSessions = None,
    bins: Bins = 100,
    pseudocount: Pseudocount = 0.01,
    power: Power = "J",
    saturation: Saturation = None,
    value_range: ValueRange = "global",
    draws: Annotated[
        int, Option(min=0, help="Posterior draws kept in the file for ArviZ, in each of 4 chains; 0 for none.")
    ] = 25,
    method: Annotated[
        Literal["closed", "nuts"], Option("--fit", help="The model's own fast fit, or NUTS on its story.")
    ] = "closed",
    allow_unconverged: AllowUnconverged = False,
    gain_sd: Annotated[
        float | None,
        Option(min=0.0, help="For session: deviation of the log gain between sessions; default the training taps'."),
    ] = None,
    offset_sd: Annotated[
        float | None,
        Option(min=0.0, help="For session: deviation of the offset, in the unit of the samples; likewise."),
    ] = None,
    simulations: Annotated[
        int,
        Option(
            min=0,
            help="For --power learned: data sets drawn from the fitted model, whose learned powers are shown beside; "
            "19 or more, each takes as long as the fit; 0 for none.",
        ),
    ] = 0,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Fits a measurement model to the training taps of DATA."""
    from ..models.storage import check_netcdf_name, check_writable

    check_netcdf_name(out)
    check_writable(out, force)
    from ..models.errors import InputError

    with loading():
        from ..inference.tuning.tempering import fit_tempered
        from ..models.experiment import load_experiment
        from ..models.io.model_file import save_model
        from ..models.measurement.catalogue import FitSettings, split_name
        from ..models.measurement.histogram import trim
        from ..models.power import check_saturation, learned_taps, parse_power_choice

    _, in_states = split_name(model)
    if not in_states and (gain_sd is not None or offset_sd is not None):
        raise InputError(f"--gain-sd and --offset-sd go with session models only, and not with {model}.")
    if simulations:
        if learned_taps(power) is None:
            raise InputError("--simulations goes with --power learned only.")
        with loading():
            from ..analysis.stats.right_exponent import check_simulations
        check_simulations(simulations)
    limit = float("inf") if saturation is None else saturation
    check_saturation(limit)
    settings = FitSettings(
        bins=bins,
        pseudocount=pseudocount,
        power=parse_power_choice(power),
        saturation=limit,
        value_range=value_range,
        method=method,
        unconverged=allow_unconverged,
        gain_sd=gain_sd,
        offset_sd=offset_sd,
        seed=seed,
    )
    parts, grid = load_experiment(data, where_cell, what_cell, split, train, test, training_taps=True)
    if len(parts.folds) != 1:
        raise InputError(f"--split {parts.method} makes {len(parts.folds)} models; fit writes one, so choose another.")
    fold = parts.folds[0]
    grid, dropped = trim(grid, [fold.train])
    trained_on = f"{', '.join(path.name for path in data)}: {parts.description}"
    fitted, learned = fit_tempered(model, fold.train, grid, settings, trained_on)
    kept = _draws(fitted, fold.train, draws, seed)
    beside = "" if learned is None else _beside(model, fitted, fold.train, settings, learned.taps, simulations)
    save_model(fitted.model.with_scores(fold.train), out, force, kept, fitted.convergence)
    left_out = [*dropped, *fitted.model.left_out]
    print(parts.description)
    if parts.warning:
        print(f"Warning: {parts.warning}")
    if learned is not None:
        print(f"{learned.sentence} {beside}".rstrip())
    print(f"{model}: {fitted.convergence.sentence}")
    if not fitted.convergence.converged:
        print("Warning: the fit did not converge.")
    if draws and kept is None:
        print("Note: without a pseudocount the posterior is improper, so no draws are kept.")
    print(f"{grid.L} x {grid.M} (where, what) classes from {len(fold.train)} taps, in {out}")
    if left_out:
        print(f"Left out for want of a training tap: {', '.join(left_out)}")


def _beside(model: str, fitted: "Fitted", taps: "TapSet", settings: "FitSettings", n: int, simulations: int) -> str:
    """The learned power beside those of a right model, where data sets are simulated."""
    if not simulations:
        return ""
    with loading():
        from ..analysis.stats.right_exponent import learned_beside
    from .shared.progress import bars

    with bars() as progress:
        counted = progress("Learning powers of a right model", simulations)
        return learned_beside(model, fitted.model, taps, settings, n, simulations, counted).sentence


def _draws(fitted: "Fitted", taps: "TapSet", draws: int, seed: int) -> "Draws | None":
    """Draws from the posterior, where there are any."""
    if not draws or fitted.posterior is None:
        return None
    with loading():
        from ..models.measurement.draws import CHAINS, posterior_draws
    from .shared.progress import bars

    with bars() as progress:
        return posterior_draws(fitted, taps, CHAINS, draws, seed, progress("Drawing parameters", CHAINS * draws))
