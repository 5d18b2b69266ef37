"""`solidtouch export-model`: a fitted model for programs without this software."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument, Context, Option

from ..models.errors import InputError
from ..models.settings import PlaySettings
from .shared.interrupt import loading
from .shared.options import Fields, Force, SettingFile, given, merged, spelled_out

if TYPE_CHECKING:
    from ..models.io.export import Decisions
    from ..models.measurement.model import TapModel

_SUFFIXES = {"json": (".json",), "c-header": (".h", ".hpp")}


_ThetaX = Annotated[
    float, Option("--theta-x", help="Belief in a position needed for a move; 0 always moves, 1 never does.")
]
_Threshold = Annotated[float, Option("--threshold", help="Belief in an object needed to decide; 1 never decides.")]


@spelled_out
def export_model(
    context: Context,
    model: Annotated[Path, Argument(metavar="MODEL", help="A fitted model, from `fit`.", show_default=False)],
    layout: Annotated[
        Literal["json", "c-header"], Option("--format", help="JSON, which commands read back, or a C header.")
    ],
    out: Annotated[
        Path | None,
        Option(metavar="FILE", help="The file to write; default beside MODEL, in .json or .h.", show_default=False),
    ] = None,
    setting: SettingFile = None,
    play: Annotated[PlaySettings, Fields("border", "fixation", theta_x=_ThetaX, threshold=_Threshold)] = PlaySettings(),
    single: Annotated[bool, Option("--single", help="Numbers of a C header in single precision.")] = False,
    force: Force = False,
) -> None:
    """Writes the tables of MODEL, and what it decides by, for a program that is not this one."""
    target = _target(model, out, layout)
    if single and layout == "json":
        raise InputError("--single goes with --format c-header only; JSON holds every digit.")
    from ..models.storage import check_writable

    check_writable(target, force)
    with loading():
        from ..models.io.c_header import save_c_header
        from ..models.io.export import save_exported
        from ..models.io.model_file import load_model

    fitted = load_model(model)
    decisions = _decisions(context, fitted, model, setting, play)
    if layout == "json":
        save_exported(fitted, target, decisions, model.stem, force)
    else:
        save_c_header(fitted, target, decisions, single, force)
    print(_told(fitted, target))


def _target(model: Path, out: Path | None, layout: str) -> Path:
    """The file to write, by a name that says what it is.

    Raises:
        InputError: `out` has another name.
    """
    suffixes = _SUFFIXES[layout]
    target = model.with_suffix(suffixes[0]) if out is None else out
    if target.suffix.lower() not in suffixes:
        raise InputError(f"--out must end in {' or '.join(suffixes)} with --format {layout}, got {target}.")
    return target


def _decisions(
    context: Context, fitted: "TapModel", model: Path, setting: Path | None, play: PlaySettings
) -> "Decisions":
    """What the options say, or a setting where they do not.

    Raises:
        InputError: A value is out of range, or the setting speaks of another model.
    """
    from ..inference.moves.control import check_fixation
    from ..models.io.export import Decisions
    from ..models.setting_file import load_setting

    read = None if setting is None else load_setting(setting)
    if read is not None:
        read.check_model(fitted, str(model), str(setting))
        moving = given(context, "theta_x") or given(context, "fixation")
        play = merged(context, read, play)
        play = play.changed(passive=play.passive and not moving)
    aim = check_fixation(play.fixation, fitted.grid.L)
    return Decisions(border=play.border, threshold=play.threshold, theta_x=play.move_threshold, fixation=aim)


def _told(fitted: "TapModel", target: Path) -> str:
    """What was written, in words."""
    sizes = (
        f"{fitted.grid.L} x {fitted.grid.M} (where, what) classes, {fitted.K} taxels, {fitted.preprocessing.samples} "
        f"samples, {fitted.edges.shape[-1] - 1} bins"
    )
    if fitted.saturation == float("inf"):
        return f"{fitted.name}: {sizes}, in {target}"
    return (
        f"{fitted.name}: {sizes}, in {target}\n"
        f"Note: all taps of an episode count as {fitted.saturation:g} at most; a program that leaves this out decides "
        f"too early."
    )
