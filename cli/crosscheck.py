"""`solidtouch crosscheck`: all ways of computing the posterior compared."""

from typing import Annotated

import typer
from typer import Option

from ..models.measurement.registry import NAMES
from ..models.settings import Division, FitSettings, PlaySettings
from .shared.interrupt import loading
from .shared.options import DIVIDED, FITTING, Data, Fields, ModelOrAll, Seed, spelled_out
from .shared.report import show_page


@spelled_out
def crosscheck(
    data: Data,
    model: ModelOrAll = "histogram",
    division: Annotated[Division, Fields(*DIVIDED, "training_taps", "missing")] = Division(),
    fit: Annotated[FitSettings, Fields(*FITTING, "saturation", "unconverged")] = FitSettings(),
    play: Annotated[PlaySettings, Fields("border")] = PlaySettings(),
    episodes: Annotated[int, Option(min=1, help="Number of episodes.")] = 10,
    length: Annotated[int, Option(min=1, help="Taps per episode.")] = 40,
    sequence_taps: Annotated[int, Option(min=0, max=20, help="Taps per episode that are enumerated at once.")] = 20,
    seed: Seed = 0,
) -> None:
    """Compare all ways of computing the posterior on the test taps of DATA; exit code 1 if they differ."""
    with loading():
        from ..analysis.correctness.report import crosscheck as study
    from .shared.progress import bars

    with bars() as progress:
        report = study(
            *data,
            models=NAMES if model == "all" else (model,),
            division=division,
            fit=fit,
            play=play,
            episodes=episodes,
            length=length,
            sequence_taps=sequence_taps,
            seed=seed,
            progress=progress,
        )
    show_page(report)
    if not report.passed:
        raise typer.Exit(1)
