"""`solidtouch tune`: where to fixate and when to stop, from training taps."""

from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Context, Option

from ..models.errors import InputError
from ..models.settings import Division, FitSettings, PlaySettings
from .shared.interrupt import loading, terminable
from .shared.options import (
    DIVIDED,
    Data,
    Exponent,
    Fields,
    Force,
    Model,
    Seed,
    TrainingTaps,
    given,
    parse_thresholds,
    spelled_out,
)
from .shared.untrained import check_training_taps
from .tune_online import LearningPlan, learned

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..analysis.tuning.run import Price
    from ..inference.tuning.held_out import Parts
    from ..models.setting_file import Setting

_TWO = 2  # files that `fit` takes

_Theta = Annotated[float, Option("--theta", help="Threshold at which positions are compared.")]


@spelled_out
def tune(
    context: Context,
    data: Data,
    out: Annotated[Path, Option(help="The setting to write, such as setting.json, for `perceive --setting`.")],
    cost_error: Annotated[
        float, Option("--cost-error", metavar="TAPS", help="Taps that an error of 1 is worth, in the unit of errors.")
    ] = 50.0,
    wrong: Annotated[
        bool, Option("--wrong", help="Count wrong decisions, also where objects have sizes to be wrong by.")
    ] = False,
    target_error: Annotated[
        float | None,
        Option("--target-error", metavar="P", help="The least threshold with this P(wrong) in a new session instead."),
    ] = None,
    by: Annotated[
        Literal["active", "passive"],
        Option(help="Judge positions by trials that aim for them, or by trials that stand there."),
    ] = "active",
    thresholds: Annotated[
        str | None, Option(help="To choose from, such as 0.5,0.9,0.99; default many, or eight on line.")
    ] = None,
    online: Annotated[
        int | None, Option("--online", metavar="N", min=2, help="Learn both in N episodes instead.")
    ] = None,
    learner: Annotated[
        Literal["thompson"], Option(help="Of --online: Thompson sampling, each pair by its own costs.")
    ] = "thompson",
    rig: Annotated[
        str | None, Option(metavar="RIG", help="Of --online: play on this rig, as `perceive`; default held-out taps.")
    ] = None,
    what: Annotated[str | None, Option("--object", help="What is before a real rig, by name or number.")] = None,
    home: Annotated[bool, Option("--home", help="Of --rig: home the stage first.")] = False,
    training_taps: TrainingTaps = False,
    state: Annotated[
        Path | None, Option(metavar="FILE.json", help="Of --online: keep what is learned here, and go on from it.")
    ] = None,
    model: Model = "histogram",
    model_file: Annotated[
        Path | None, Option("--model-file", metavar="FILE.nc", help="Also write the model of all training taps.")
    ] = None,
    targets: Annotated[
        Path | None,
        Option("--targets", metavar="FILE.json", help="Also learn where to go from each place: for --move table."),
    ] = None,
    division: Annotated[Division, Fields(*DIVIDED)] = Division(training_taps=True),
    fit: Annotated[
        FitSettings, Fields("bins", "pseudocount", "saturation", "value_range", power=Exponent)
    ] = FitSettings(),
    play: Annotated[PlaySettings, Fields("theta_x", "deadline", "border", threshold=_Theta)] = PlaySettings(),
    trials: Annotated[
        int, Option(min=100, max=10**6, help="In each part, of each position, for thresholds and for targets.")
    ] = 1000,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Chooses the fixation point and the belief threshold from the training taps of DATA, which are those of `fit`.

    Of three files or more all but the last train.
    """
    _check_words(context, online, rig, target_error)
    check_training_taps(training_taps, rig)
    with loading():
        from ..analysis.experiment.settings import ExperimentSettings
        from ..analysis.tuning.report import tuning_taps
        from ..analysis.tuning.run import Price, check_objects, check_price
        from ..inference.moves.table import save_table
        from ..inference.moves.table_learning import learn_table
        from ..inference.trials.run import checked_thresholds
        from ..inference.tuning.held_out import held_out
        from ..models.io.model_file import save_model
        from ..models.setting_file import Setting
        from ..models.storage import check_netcdf_name
    from .shared.progress import bars

    if model_file is not None:
        check_netcdf_name(model_file)
    _check_files({"--out": out, "--model-file": model_file, "--targets": targets}, state, force)
    price = Price(cost_error, wrong, target_error)
    setting = Setting(model=model, fit=fit, where_cell=division.where_cell, what_cell=division.what_cell, play=play)
    given_thresholds = parse_thresholds(thresholds)
    chosen = None if given_thresholds is None else checked_thresholds(given_thresholds)
    taps, grid, told = tuning_taps(data, division)
    check_objects(grid)
    check_price(price, len(set(taps.session.tolist())))
    study = ExperimentSettings(model=model, fit=fit.changed(seed=seed))
    print(told)
    with terminable(), bars() as progress:
        models = max(_TWO, len(set(taps.session.tolist())))

        @cache
        def parts() -> "Parts":
            return held_out(taps, grid, study.fitted, progress("Fitting models", models))

        if online is not None:
            course = LearningPlan(learner, chosen, online, seed, state, rig, what, home, training_taps)
            fitted = partial(study.fitted, taps, grid)
            best = learned(course, setting, price, taps, grid, fitted, parts, progress("Learning", online))
        else:
            best = _offline(parts(), setting, price, chosen, by == "passive", trials, seed, progress)
        if targets is not None:
            tables = [part.table for part in parts().parts]
            save_table(learn_table(tables, grid, border=play.border, trials=trials, seed=seed), targets, force)
            print(f"The table of targets is {targets}")
    if model_file is not None:
        save_model(study.fitted(taps, grid).with_scores(taps), model_file, force)
        print(f"The model of all training taps is {model_file}")
    best.save(out, force)
    print(f"The setting is {out}")


def _check_files(files: "dict[str, Path | None]", state: Path | None, force: bool) -> None:
    """Refuses files that cannot be written, or two that are one; what a learner knows may be there already."""
    from ..models.storage import check_writable

    for path in files.values():
        if path is not None:
            check_writable(path, force)
    seen: dict[Path, str] = {}
    for name, path in {**files, "--state": state}.items():
        if path is not None and (other := seen.setdefault(path.resolve(), name)) != name:
            raise InputError(f"{other} and {name} are the same file, {path}.")


def _check_words(context: Context, online: int | None, rig: str | None, target_error: float | None) -> None:
    """Refuses options that do not go together."""
    alone = {"--online": ("rig", "state", "learner"), "--rig": ("what", "home")}
    for other, asked in (("--online", online), ("--rig", rig)):
        for name in alone[other]:
            if asked is None and given(context, name):
                raise InputError(f"--{'object' if name == 'what' else name} goes with {other} only.")
    if online is not None and target_error is not None:
        raise InputError("--target-error chooses from all training taps and does not go with --online.")
    if online is not None and given(context, "by"):
        raise InputError("--by judges positions from all training taps and does not go with --online.")
    if target_error is not None and given(context, "cost_error"):
        raise InputError("--target-error asks for an error whatever it costs and does not go with --cost-error.")


def _offline(
    parts: "Parts",
    setting: "Setting",
    price: "Price",
    thresholds: tuple[float, ...] | None,
    passive: bool,
    trials: int,
    seed: int,
    progress: "Callable[[str, int], Callable[[int], None]]",
) -> "Setting":
    """The setting from held-out trials, printed with its curves."""
    from rich.console import Console

    from ..analysis.page.terminal import show
    from ..analysis.tuning.report import TuningReport
    from ..analysis.tuning.run import tune_parts, tuning_trials

    bar = progress("Playing trials", tuning_trials(parts, trials))
    options: dict[str, Any] = {"thresholds": thresholds, "passive": passive, "trials": trials, "seed": seed}
    report = TuningReport(tune_parts(parts, setting, price, **options, progress=bar), parts)
    show(report.page, Console())
    return report.setting
