"""`solidtouch fit`: a measurement model from training taps."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Option

from ..models.settings import Division, FitSettings
from .shared.interrupt import loading
from .shared.options import DIVIDED, FITTING, Data, Fields, Force, Model, Seed, spelled_out

if TYPE_CHECKING:
    from ..models.io.model_file import Draws
    from ..models.measurement.model import Fitted
    from ..models.taps import TapSet

_Method = Annotated[Literal["closed", "nuts"], Option("--fit", help="The model's own fast fit, or NUTS on its story.")]
_GainSd = Annotated[
    float | None,
    Option("--gain-sd", help="For session: deviation of the log gain between sessions; default the training taps'."),
]
_OffsetSd = Annotated[
    float | None,
    Option("--offset-sd", help="For session: deviation of the offset, in the unit of the samples; likewise."),
]


@spelled_out
def fit(
    data: Data,
    out: Annotated[Path, Option(help="The file to write, such as model.nc.")],
    model: Model = "histogram",
    division: Annotated[Division, Fields(*DIVIDED)] = Division(training_taps=True),
    settings: Annotated[
        FitSettings,
        Fields(*FITTING, "saturation", "unconverged", method=_Method, gain_sd=_GainSd, offset_sd=_OffsetSd),
    ] = FitSettings(),
    draws: Annotated[
        int, Option(min=0, help="Posterior draws kept in the file for ArviZ, in each of 4 chains; 0 for none.")
    ] = 25,
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
        from ..inference.fit import check_used
        from ..inference.tuning.tempering import fit_tempered
        from ..models.experiment import load_experiment
        from ..models.io.model_file import save_model
        from ..models.measurement.histogram import trim
        from ..models.power import learned_taps

    check_used(model, settings)
    if simulations:
        if learned_taps(settings.power) is None:
            raise InputError("--simulations goes with --power learned only.")
        with loading():
            from ..analysis.stats.right_exponent import check_simulations
        check_simulations(simulations)
    settings = settings.changed(seed=seed)
    parts, grid = load_experiment(data, division)
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
