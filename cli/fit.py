"""`solidtouch fit`: a measurement model from training taps."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from ..analysis.tasks.crew import PATIENCE_S, check_crew, crew_of
from ..models.errors import InputError
from ..models.settings import Division, FitSettings
from .shared.interrupt import loading
from .shared.options import (
    DIVIDED,
    FITTING,
    Data,
    Fields,
    Force,
    Model,
    Patience,
    Scheduler,
    Seed,
    spelled_out,
)
from .shared.progress import bars

if TYPE_CHECKING:
    import xarray as xr

    from ..analysis.tasks.crew import Crew
    from ..models.measurement.model import Fitted, TapModel
    from ..models.taps import TapSet

_CHAIN_DRAWS = 25
_GainSd = Annotated[
    float | None,
    Option(
        "--gain-sd", help="Session models: standard deviation of the log gain between sessions; default: estimated."
    ),
]
_OffsetSd = Annotated[
    float | None,
    Option(
        "--offset-sd",
        help="Session models: standard deviation of the offset, in the unit of the samples; default: estimated.",
    ),
]


@spelled_out
def fit(
    data: Data,
    out: Annotated[Path, Option(help="File to write, such as model.nc.")],
    model: Model = "histogram",
    division: Annotated[Division, Fields(*DIVIDED, "missing")] = Division(training_taps=True),
    settings: Annotated[
        FitSettings,
        Fields(*FITTING, "saturation", "unconverged", gain_sd=_GainSd, offset_sd=_OffsetSd),
    ] = FitSettings(),
    draws: Annotated[
        int | None,
        Option(
            min=0,
            help="Posterior draws to store, in each of 4 chains. Default: 25 with --arviz and for fits whose draws "
            "cannot be made later; none for posteriors in closed form, which the file keeps, and for recordings above "
            "256 MiB but of chains.",
        ),
    ] = None,
    arviz: Annotated[
        bool,
        Option(
            "--arviz",
            help="Store all that ArviZ's functions need: also draws from the prior, log prior and predicted taps. "
            "Without Markov chains draws are then in one chain, 4 times --draws.",
        ),
    ] = False,
    simulations: Annotated[
        int,
        Option(
            min=0,
            help="With --power learned: number of data sets simulated from the fitted model, to compare their learned "
            "powers; at least 19, each as slow as the fit; 0 skips this.",
        ),
    ] = 0,
    scheduler: Scheduler = None,
    patience: Patience = PATIENCE_S,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Fit a measurement model to the training taps of DATA."""
    from ..models.storage import check_netcdf_name, check_writable

    check_netcdf_name(out)
    check_writable(out, force)

    with loading():
        from ..analysis.experiment.data_warnings import one_object
        from ..inference.fit import check_used
        from ..inference.tuning.tempering import fit_tempered
        from ..models.io.model_file import save_model
        from ..models.measurement.histogram import trim
        from ..models.measurement.registry import model_name
        from ..models.splits import load_experiment

    check_used(model_name(model), settings)
    if arviz and draws == 0:
        raise InputError("--arviz requires draws; --draws must be at least 1.")
    _check_simulations(simulations, settings, scheduler)
    crew = crew_of(scheduler, None, patience)
    settings = settings.changed(seed=seed)
    parts, grid = load_experiment(data, division)
    if len(parts.folds) != 1:
        raise InputError(f"--split {parts.method} gives {len(parts.folds)} models, but fit writes one; choose another.")
    fold = parts.folds[0]
    grid, dropped = trim(grid, [fold.train])
    check_crew(crew)
    trained_on = f"{', '.join(path.name for path in data)}: {parts.description}"
    with bars() as progress:
        fitted, learned = fit_tempered(model, fold.train, grid, settings, trained_on, progress)
    large = fold.train.scanned is not None and settings.method != "nuts" and not arviz
    written, kept = _written(fitted, fold.train, 0 if draws is None and large else draws, arviz)
    beside = "" if learned is None else _beside(model, fitted, fold.train, settings, learned.taps, simulations, crew)
    save_model(written, out, force, kept, fitted.convergence)
    left_out = [*dropped, *written.left_out]
    print(parts.description)
    if parts.warning:
        print(f"Warning: {parts.warning}")
    if learned is not None:
        print(f"{learned.sentence} {beside}".rstrip())
    print(f"{model}: {fitted.convergence.sentence}")
    if not fitted.convergence.converged:
        print("Warning: the fit did not converge.")
    if fitted.convergence.warning:
        print(f"Warning: {fitted.convergence.warning}")
    if fitted.posterior is None and draws != 0:
        print("Note: without a pseudocount the posterior is improper, so no draws are stored.")
    elif draws is None and large and not written.keeps_posterior:
        print("Note: no draws are stored, as each goes through the whole of a large recording; --draws N stores some.")
    print(f"{grid.L} x {grid.M} (position, object) classes from {len(fold.train)} taps, in {out}")
    for sentence in one_object(grid, range(grid.M)):
        print(f"Warning: {sentence}")
    if left_out:
        print(f"Left out, without training taps: {', '.join(left_out)}")


def _check_simulations(simulations: int, settings: FitSettings, scheduler: str | None) -> None:
    """Checks that simulations are enough and for a learned power, and that a scheduler has some."""
    from ..models.settings import learned_taps

    if scheduler is not None and not simulations:
        raise InputError("--scheduler requires --simulations; the fit of one model is not divided.")
    if simulations:
        if learned_taps(settings.power) is None:
            raise InputError("--simulations requires --power learned.")
        with loading():
            from ..analysis.stats.right_exponent import check_simulations
        check_simulations(simulations)


def _beside(
    model: str, fitted: "Fitted", taps: "TapSet", settings: "FitSettings", n: int, simulations: int, crew: "Crew"
) -> str:
    """Comparison of the learned power with those of simulated data sets, as a sentence; empty without simulations."""
    if not simulations:
        return ""
    with loading():
        from ..analysis.stats.right_exponent import learned_beside
    with bars() as progress:
        counted = progress("Learning powers of simulated data", simulations)
        return learned_beside(model, fitted.model, taps, settings, n, simulations, counted, crew).sentence


def _written(
    fitted: "Fitted", taps: "TapSet", draws: int | None, arviz: bool
) -> "tuple[TapModel, dict[str, xr.Dataset] | None]":
    """Model with all that its file keeps, and groups of draws from its posterior if there are any."""
    scored: Any = fitted.model.with_scores(taps)  # every kind is a dataclass
    model: TapModel = replace(scored, posterior=fitted.posterior)
    if draws is None:
        draws = _CHAIN_DRAWS if arviz or not model.keeps_posterior else 0
    if not draws or fitted.posterior is None:
        return model, None
    with loading():
        from ..models.io.arviz_tree import arviz_groups, draw_groups
        from ..models.measurement.draws import CHAINS, posterior_draws
    with bars() as progress:
        counted = progress("Drawing parameters", CHAINS * draws)
        if arviz:
            return model, arviz_groups(model, taps, draws=CHAINS * draws, seed=model.seed, progress=counted)
        return model, draw_groups(fitted, taps, posterior_draws(fitted, taps, CHAINS, draws, model.seed, counted))
