"""`solidtouch crosscheck`: all ways of computing the posterior compared."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from ..models.measurement.registry import NAMES, PAPER
from ..models.settings import Division, FitSettings, PlaySettings
from .shared.interrupt import loading
from .shared.options import DIVIDED, FITTING, Data, Fields, ModelOrAll, Seed, spelled_out

if TYPE_CHECKING:
    from rich.console import Console

    from ..analysis.experiment.crosscheck import CrossCheck

_ALL = "all"


@spelled_out
def crosscheck(
    data: Data,
    model: ModelOrAll = "histogram",
    division: Annotated[Division, Fields(*DIVIDED, "training_taps")] = Division(),
    fit: Annotated[FitSettings, Fields(*FITTING, "saturation", "unconverged")] = FitSettings(),
    play: Annotated[PlaySettings, Fields("border")] = PlaySettings(),
    episodes: Annotated[int, Option(min=1, help="Number of episodes.")] = 10,
    length: Annotated[int, Option(min=1, help="Taps per episode.")] = 40,
    sequence_taps: Annotated[int, Option(min=0, max=20, help="Taps per episode that are enumerated at once.")] = 20,
    seed: Seed = 0,
) -> None:
    """Compare all ways of computing the posterior on the test taps of DATA; exit code 1 if they differ."""
    from rich.console import Console

    with loading():
        from ..analysis.experiment.crosscheck import crosscheck as compare
        from ..analysis.experiment.settings import ExperimentSettings
        from ..models.experiment import load_experiment
        from ..models.measurement.histogram import trim
    from .shared.progress import bars

    settings = ExperimentSettings(fit=fit.changed(seed=seed), play=play, seed=seed)
    parts, grid = load_experiment(data, division)
    grid, _ = trim(grid, [fold.train for fold in parts.folds])
    fold = parts.folds[0]

    def check(name: str) -> "CrossCheck":
        fitted = settings.changed(model=name).fitted(fold.train, grid)
        with bars() as progress:
            advance = progress(f"Cross-checking {name}" if model == _ALL else "Cross-checking engines", episodes)
            return compare(
                fitted,
                fitted.usable(fold.test),
                train=fold.train,
                settings=settings,
                border=play.border,
                episodes=episodes,
                length=length,
                sequence_taps=sequence_taps,
                seed=seed,
                progress=lambda: advance(1),
            )

    console = Console()
    console.print(parts.description, highlight=False)
    if parts.warning:
        console.print(f"Warning: {parts.warning}", highlight=False)
    if not (_check_all(check, console) if model == _ALL else _check_one(check, model, console)):
        raise typer.Exit(1)


def _check_one(check: "Callable[[str], CrossCheck]", name: str, console: "Console") -> bool:
    """Whether all ways agree for a model; prints the comparison."""
    from ..analysis.correctness.page import crosscheck_page
    from ..analysis.page.terminal import show

    result = check(name)
    if name != PAPER:
        console.print(f"Model {name}", highlight=False)
    show(crosscheck_page(result), console)
    return result.passed


def _check_all(check: "Callable[[str], CrossCheck]", console: "Console") -> bool:
    """Whether all ways agree for every model that can be fitted to the taps; prints the others.

    Raises:
        InputError: No model could be checked.
    """
    from ..analysis.correctness.page import crosscheck_page
    from ..analysis.page.terminal import show
    from ..inference.reference import ZeroEvidenceError
    from ..models.errors import InputError

    results: dict[str, bool] = {}
    refused: dict[str, str] = {}
    for name in NAMES:
        try:
            result = check(name)
        except (InputError, ZeroEvidenceError) as error:
            refused[name] = str(error)
            continue
        console.print(f"Model {name}", highlight=False)
        show(crosscheck_page(result), console)
        results[name] = result.passed
    for name, reason in refused.items():
        console.print(f"Model {name} was not checked: {reason}", highlight=False)
    if not results:
        raise InputError("No model could be checked; see the reasons above.")
    differ = [name for name, passed in results.items() if not passed]
    verdict = f"the routes of {', '.join(differ)} DISAGREE" if differ else "all routes agree"
    console.print(f"{len(results)} of {len(NAMES)} models checked: {verdict}.", highlight=False)
    return not differ
