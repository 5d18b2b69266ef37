"""`solidtouch export-model`: a fitted model for programs without this software."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument, Context, Option

from ..models.errors import InputError
from ..models.settings import PlaySettings
from .shared.interrupt import loading
from .shared.options import Fields, Force, SettingFile, Story, given, merged, spelled_out

if TYPE_CHECKING:
    from ..models.io.export import Decisions
    from ..models.measurement.model import TapModel

_SUFFIXES = {"json": (".json",), "c-header": (".h", ".hpp")}


_ThetaX = Annotated[
    float, Option("--theta-x", help="Belief in a position required for a move; 0 always moves, 1 never moves.")
]
_Threshold = Annotated[
    float, Option("--threshold", help="Belief in an object required for a decision; 1 never decides.")
]


@spelled_out
def export_model(
    context: Context,
    model: Annotated[Path, Argument(metavar="MODEL", help="Fitted model, from `fit`.", show_default=False)],
    layout: Annotated[
        Literal["json", "c-header"], Option("--format", help="JSON, which other commands can read, or a C header.")
    ],
    out: Annotated[
        Path | None,
        Option(metavar="FILE", help="File to write; default: MODEL with .json or .h.", show_default=False),
    ] = None,
    story: Story = None,
    setting: SettingFile = None,
    play: Annotated[PlaySettings, Fields("border", "fixation", theta_x=_ThetaX, threshold=_Threshold)] = PlaySettings(),
    single: Annotated[bool, Option("--single", help="Use single precision in a C header.")] = False,
    force: Force = False,
) -> None:
    """Write the tables and decision parameters of MODEL as JSON or a C header."""
    target = _target(model, out, layout)
    if single and layout == "json":
        raise InputError("--single requires --format c-header; JSON keeps full precision.")
    from ..models.storage import check_writable

    check_writable(target, force)
    with loading():
        from ..models.io.c_header import save_c_header
        from ..models.io.export import save_exported
        from ..models.io.model_file import load_model

    fitted = load_model(model, story)
    decisions = _decisions(context, fitted, model, setting, play)
    if layout == "json":
        save_exported(fitted, target, decisions, model.stem, force)
    else:
        save_c_header(fitted, target, decisions, single, force)
    print(_told(fitted, target))


def _target(model: Path, out: Path | None, layout: str) -> Path:
    """File to write, with a suffix that matches its format.

    Raises:
        InputError: `out` has another suffix.
    """
    suffixes = _SUFFIXES[layout]
    target = model.with_suffix(suffixes[0]) if out is None else out
    if target.suffix.lower() not in suffixes:
        raise InputError(f"--out must end in {' or '.join(suffixes)} with --format {layout}, got {target}.")
    return target


def _decisions(
    context: Context, fitted: "TapModel", model: Path, setting: Path | None, play: PlaySettings
) -> "Decisions":
    """Decision parameters from the options, else from a setting.

    Raises:
        InputError: A value is out of range, or the setting belongs to another model.
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
    """Description of the file written."""
    sizes = (
        f"{fitted.grid.L} x {fitted.grid.M} (position, object) classes, {fitted.K} taxels, "
        f"{fitted.preprocessing.samples} samples, {fitted.edges.shape[-1] - 1} bins"
    )
    if fitted.saturation == float("inf"):
        return f"{fitted.name}: {sizes}, in {target}"
    return (
        f"{fitted.name}: {sizes}, in {target}\n"
        f"Note: an episode's evidence is capped at {fitted.saturation:g} taps; a program without this cap decides "
        f"too early."
    )
