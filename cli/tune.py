"""`solidtouch tune`: where to fixate and when to stop, from training taps."""

import sys
from pathlib import Path
from typing import Annotated, Any, Literal

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
    with loading():
        from rich.console import Console

        from ..analysis.page.terminal import show
        from ..analysis.tuning.online import tune_online
        from ..analysis.tuning.report import tune as study
        from ..hardware.named_rigs import check_training_taps
        from ..models.io.model_file import save_model
        from ..models.storage import check_netcdf_name
    from .shared.progress import bars

    check_training_taps(training_taps, rig)
    if model_file is not None:
        check_netcdf_name(model_file)
    _check_files({"--out": out, "--model-file": model_file, "--targets": targets}, state, force)
    chosen = {"model": model, "division": division, "fit": fit, "play": play, "cost_error": cost_error, "wrong": wrong}
    common: dict[str, Any] = {**chosen, "thresholds": parse_thresholds(thresholds), "seed": seed}
    with terminable(), bars() as progress:
        told: dict[str, Any] = {"progress": progress, "note": _print_note}
        if online is None:
            report = study(*data, **common, **told, target_error=target_error, by=by, trials=trials)
            show(report.page, Console())
        else:
            report = tune_online(
                *data,
                **common,
                **told,
                episodes=online,
                learner=learner,
                rig=rig,
                what=what,
                home=home,
                training_taps=training_taps,
                state=state,
                hear=print if rig else lambda _: None,
            )
            print(report.sentence)
        if targets is not None:
            report.save_targets(targets, trials, seed, force)
            print(f"The table of targets is {targets}")
    if model_file is not None:
        save_model(report.model, model_file, force)
        print(f"The model of all training taps is {model_file}")
    report.save(out, force)
    print(f"The setting is {out}")


def _print_note(sentence: str) -> None:
    """Prints what begins with `Note:` or `Warning:` on standard error."""
    print(sentence, file=sys.stderr if sentence.startswith(("Note:", "Warning:")) else sys.stdout)


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
