"""`solidtouch compare`: measurement models side by side, by taps, classes and decisions."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from ..models.errors import InputError
from ..models.settings import Division, FitSettings, PlaySettings
from .shared.interrupt import loading
from .shared.options import DIVIDED, FITTING, Data, Fields, Force, Seed, parse_thresholds, spelled_out
from .shared.report import command_line, report_folder, show_report

if TYPE_CHECKING:
    from ..analysis.compare.record import ComparedData
    from ..models.grid import ClassGrid
    from ..models.splits import Split


_FEWEST_DRAWS = 100


@spelled_out
def compare(
    data: Data,
    models: Annotated[
        str, Option(help="Names separated by commas, the reference first, such as histogram,profile; or all.")
    ] = "all",
    out: Annotated[Path | None, Option(help="Folder for the results; default runs/<date-time>-compare.")] = None,
    division: Annotated[Division, Fields(*DIVIDED, "training_taps")] = Division(),
    fit: Annotated[FitSettings, Fields(*FITTING, "unconverged")] = FitSettings(),
    draws: Annotated[
        int, Option(min=0, help="From each posterior, to leave out single taps; 0 skips that and predictive checks.")
    ] = 400,
    trials: Annotated[int, Option(min=1, help="Of each model, passive and active.")] = 4000,
    thresholds: Annotated[str | None, Option(help="Belief thresholds, such as 0.5,0.9,0.99.")] = None,
    play: Annotated[PlaySettings, Fields("theta_x", "fixation", "deadline", "border")] = PlaySettings(),
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Fits measurement models to training taps and compares how they predict taps, tell classes and decide."""
    if 0 < draws < _FEWEST_DRAWS:
        raise InputError(f"--draws must be 0, or {_FEWEST_DRAWS} or more to look at tails, got {draws}.")
    with loading():
        from ..analysis.compare.page import write_comparison
        from ..analysis.compare.run import CompareSettings
        from ..analysis.compare.run import compare as run
        from ..analysis.compare.summary import summarise
        from ..inference.moves.control import check_fixation
        from ..inference.trials.run import THRESHOLDS
        from ..models.experiment import load_experiment
        from ..models.measurement.histogram import trim
    from .shared.progress import bars

    names = _names(models)
    folder = report_folder(out, force, "compare")
    parts, grid = load_experiment(data, division)
    if len(parts.folds) != 1:
        raise InputError(
            f"--split {parts.method} makes {len(parts.folds)} training sets; compare takes one, and leaves out each "
            "session in turn by itself."
        )
    fold = parts.folds[0]
    grid, dropped = trim(grid, [fold.train])
    check_fixation(play.fixation, grid.L)
    settings = CompareSettings(
        models=names,
        fit=fit.changed(seed=seed),
        draws=draws,
        trials=trials,
        thresholds=THRESHOLDS if thresholds is None else parse_thresholds(thresholds),
        play=play,
        seed=seed,
        one_recording=len(data) == 1,
    )
    with bars() as progress:
        comparison = run(fold.train, fold.test, grid, settings, progress)
    summary = summarise(comparison, settings, _described(data, parts, grid, dropped, comparison.test_taps))
    show_report(write_comparison(folder, comparison, summary, force), folder)


def _names(models: str) -> tuple[str, ...]:
    """Model names from the command line.

    Raises:
        InputError: There is no such model, or a name stands there twice.
    """
    from ..models.measurement.registry import NAMES, split_name

    names = NAMES if models == "all" else tuple(name.strip() for name in models.split(","))
    for name in names:
        split_name(name)
    if len(set(names)) < len(names):
        raise InputError(f"--models needs different names, got {models!r}.")
    return names


def _described(
    data: Sequence[Path], parts: "Split", grid: "ClassGrid", dropped: Sequence[str], test_taps: int
) -> "ComparedData":
    """The data in words."""
    from ..analysis.reproduce.summary import fold_suspicions

    fold = parts.folds[0]
    sources = {str(part.dataset.attrs.get("source", "")) for part in (fold.train, fold.test)}
    warnings = [parts.warning] if parts.warning else []
    if dropped:
        warnings.append(f"Left out for want of a training tap: {', '.join(dropped)}.")
    if test_taps < len(fold.test):
        warnings.append(f"{len(fold.test) - test_taps} test taps of classes that not all models know were left out.")
    simulated = all(source.startswith("simulated") for source in sources)
    if not simulated:
        warnings += fold_suspicions(fold, grid, one_file=len(data) == 1)
    return {
        "title": f"Measurement models compared: {', '.join(path.name for path in data)}",
        "command": command_line(),
        "what_was_run": [
            f"Every model was fitted to {len(fold.train)} training taps and judged on {test_taps} test taps. "
            + parts.description
        ],
        "simulated": simulated,
        "warnings": warnings,
    }
