"""`solidtouch audit`: test the independence assumption, its cost and remedies."""

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from ..models.settings import Division, FitSettings, PlaySettings
from .shared.completion import model_lists
from .shared.interrupt import loading
from .shared.options import CELLS, Exponent, Fields, Force, Seed, Style, spelled_out
from .shared.report import command_line, report_folder, show_report

_Passive = Annotated[bool, Option("--passive", help="Evaluate passive trials, which never move.")]
_QUICK_TRIALS, _QUICK_PERMUTATIONS = 500, 119
_QUICK: dict[str, Any] = {
    "resamples": 25,
    "replicates": 15,
    "simulations": 39,
    "tuned_simulations": 0,
    "most_taps": 8,
    "preview": True,
}


@spelled_out
def audit(
    files: Annotated[
        list[Path],
        Argument(
            metavar="FILE...",
            help="Taps as for `inspect`: the first file trains, the last tests, those between tune.",
            show_default=False,
        ),
    ],
    out: Annotated[Path | None, Option(help="Folder for the results; default: runs/<date-time>-audit.")] = None,
    target_error: Annotated[
        float | None,
        Option(
            "--target-error",
            metavar="P",
            help="Tune a threshold for this P(wrong); requires five tuning files, seven in all.",
        ),
    ] = None,
    division: Annotated[Division, Fields(*CELLS, "training_taps")] = Division(),
    fit: Annotated[
        FitSettings, Fields("bins", "pseudocount", "value_range", "method", "steps", "unconverged", power=Exponent)
    ] = FitSettings(),
    play: Annotated[
        PlaySettings,
        Fields("threshold", "theta_x", "fixation", "deadline", "border", passive=_Passive),
    ] = PlaySettings(),
    pre: Annotated[
        int | None,
        Option(
            "--pre",
            metavar="N",
            help="Number of samples of each tap before contact; default: as recorded in the files.",
        ),
    ] = None,
    covariate: Annotated[
        list[str] | None,
        Option(
            "--covariate", metavar="NAME", help="Extra array of the files to test as a cause of dependence; repeatable."
        ),
    ] = None,
    models: Annotated[
        str | None,
        Option(
            metavar="MODEL,...",
            help="Further models to measure as remedies, separated by commas, such as gaussian,my_models.py:walk.",
            autocompletion=model_lists,
        ),
    ] = None,
    permutations: Annotated[int, Option(min=99, max=10**6, help="Permutations per test.")] = 999,
    trials: Annotated[int, Option(min=100, help="Trials per remedy and policy.")] = 4000,
    quick: Annotated[
        bool,
        Option(
            "--quick",
            help=f"Preview with wider intervals that misses small effects: {_QUICK_TRIALS} trials, "
            f"{_QUICK_PERMUTATIONS} permutations, {_QUICK['resamples']} resamples, {_QUICK['replicates']} replicates, "
            f"{_QUICK['simulations']} simulations and {_QUICK['most_taps']} taps of a class and session at most; no "
            "tuned exponents of a correct model, no variance components, and no figures for narrow windows.",
        ),
    ] = False,
    seed: Seed = 0,
    style: Style = "page",
    force: Force = False,
) -> None:
    """Test where the independence assumption fails, what that costs, and which remedy helps."""
    if quick:
        trials, permutations = min(trials, _QUICK_TRIALS), min(permutations, _QUICK_PERMUTATIONS)
    with loading():
        from ..analysis.audit.report import audit as study
        from ..analysis.page.ahead import drawing_ahead
    from .shared.progress import bars

    folder = report_folder(out, force, "audit")
    with drawing_ahead(), bars() as progress:
        report = study(
            *files,
            target_error=target_error,
            division=division,
            fit=fit,
            play=play,
            pre=pre,
            covariates=covariate or (),
            models=[name.strip() for name in models.split(",")] if models else (),
            permutations=permutations,
            trials=trials,
            **(_QUICK if quick else {}),
            seed=seed,
            progress=progress,
            command=command_line(),
        )
        report.save(folder, force, progress, style)
    show_report(report, folder)
