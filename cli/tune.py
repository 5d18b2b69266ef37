"""`solidtouch tune`: fixation point and belief threshold from training taps."""

import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Context, Option

from ..models.errors import InputError
from ..models.settings import Division, FitSettings, PlaySettings
from .shared.homing import Home, Yes, confirm_homing
from .shared.interrupt import loading
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
from .shared.report import show_page

_Theta = Annotated[float, Option("--theta", help="Threshold at which fixation points are compared.")]


@spelled_out
def tune(
    context: Context,
    data: Data,
    out: Annotated[Path, Option(help="Setting file to write, such as setting.json, for `perceive --setting`.")],
    cost_error: Annotated[float, Option("--cost-error", metavar="TAPS", help="Cost of an error of 1, in taps.")] = 50.0,
    wrong: Annotated[
        bool, Option("--wrong", help="Measure errors as wrong decisions, even if objects have sizes.")
    ] = False,
    target_error: Annotated[
        float | None,
        Option("--target-error", metavar="P", help="Choose the lowest threshold with this P(wrong) in a new session."),
    ] = None,
    by: Annotated[
        Literal["active", "passive"],
        Option(help="Compare positions by trials that move to them, or by trials that stay there."),
    ] = "active",
    thresholds: Annotated[
        str | None, Option(help="Candidate thresholds, such as 0.5,0.9,0.99; default: many, or eight with --online.")
    ] = None,
    online: Annotated[
        int | None, Option("--online", metavar="N", min=2, help="Learn fixation point and threshold from N episodes.")
    ] = None,
    learner: Annotated[
        Literal["thompson"], Option(help="Learner of --online: Thompson sampling over all pairs.")
    ] = "thompson",
    rig: Annotated[
        str | None, Option(metavar="RIG", help="With --online: rig as in `perceive`; default: held-out taps.")
    ] = None,
    what: Annotated[str | None, Option("--object", help="Object under a real rig, by name or index from 0.")] = None,
    home: Home = False,
    yes: Yes = False,
    training_taps: TrainingTaps = False,
    state: Annotated[
        Path | None,
        Option(metavar="FILE.json", help="With --online: save the learner to this file, and resume from it."),
    ] = None,
    model: Model = "histogram",
    model_file: Annotated[
        Path | None, Option("--model-file", metavar="FILE.nc", help="Also write the model fitted to all training taps.")
    ] = None,
    targets: Annotated[
        Path | None,
        Option("--targets", metavar="FILE.json", help="Also learn the target of each position, for --move table."),
    ] = None,
    division: Annotated[Division, Fields(*DIVIDED, "missing")] = Division(training_taps=True),
    fit: Annotated[
        FitSettings,
        Fields("bins", "pseudocount", "saturation", "value_range", "method", "steps", "unconverged", power=Exponent),
    ] = FitSettings(),
    play: Annotated[PlaySettings, Fields("theta_x", "deadline", "border", threshold=_Theta)] = PlaySettings(),
    trials: Annotated[
        int,
        Option(min=100, max=10**6, help="Trials per held-out part: for each position, for thresholds and for targets."),
    ] = 1000,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Choose the fixation point and belief threshold from the training taps of DATA, the same as for `fit`.

    With three files or more, all but the last train.
    """
    from ..models.storage import check_netcdf_name

    _check_words(context, online, rig, target_error)
    confirm_homing(rig or "", home, yes)
    if model_file is not None:
        check_netcdf_name(model_file)
    _check_files({"--out": out, "--model-file": model_file, "--targets": targets}, state, force)
    theta = parse_thresholds(thresholds)
    with loading():
        from ..analysis.tuning.online import tune_online
        from ..analysis.tuning.report import tune as study
        from ..hardware.named_rigs import check_training_taps
        from ..models.io.model_file import save_model
    from .shared.progress import bars

    check_training_taps(training_taps, rig)
    chosen = {"model": model, "division": division, "fit": fit, "play": play, "cost_error": cost_error, "wrong": wrong}
    common: dict[str, Any] = {**chosen, "thresholds": theta, "seed": seed}
    with bars() as progress:
        told: dict[str, Any] = {"progress": progress, "note": _print_note}
        if online is None:
            report = study(*data, **common, **told, target_error=target_error, by=by, trials=trials)
            show_page(report)
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
            print(f"Table of targets saved to {targets}")
    if model_file is not None:
        save_model(report.model, model_file, force)
        print(f"Model of all training taps saved to {model_file}")
    report.save(out, force)
    print(f"Setting saved to {out}")


def _print_note(sentence: str) -> None:
    """Prints a sentence, on standard error if it begins with `Note:` or `Warning:`."""
    print(sentence, file=sys.stderr if sentence.startswith(("Note:", "Warning:")) else sys.stdout)


def _check_files(files: "dict[str, Path | None]", state: Path | None, force: bool) -> None:
    """Checks that files can be written and are different; the state of a learner may exist already."""
    from ..models.storage import check_writable

    for path in files.values():
        if path is not None:
            check_writable(path, force)
    seen: dict[Path, str] = {}
    for name, path in {**files, "--state": state}.items():
        if path is not None and (other := seen.setdefault(path.resolve(), name)) != name:
            raise InputError(f"{other} and {name} are the same file, {path}.")


def _check_words(context: Context, online: int | None, rig: str | None, target_error: float | None) -> None:
    """Checks that options can be combined."""
    alone = {"--online": ("rig", "state", "learner"), "--rig": ("what", "home", "yes")}
    for other, asked in (("--online", online), ("--rig", rig)):
        for name in alone[other]:
            if asked is None and given(context, name):
                raise InputError(f"--{'object' if name == 'what' else name} requires {other}.")
    if online is not None and target_error is not None:
        raise InputError("--target-error cannot be combined with --online.")
    if online is not None and given(context, "by"):
        raise InputError("--by cannot be combined with --online.")
    if target_error is not None and given(context, "cost_error"):
        raise InputError("--target-error cannot be combined with --cost-error.")
