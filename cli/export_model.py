"""`solidtouch export-model`: a fitted model for programs without this software."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Context, Option

from ..models.errors import InputError
from .shared.interrupt import loading
from .shared.options import Border, Force, SettingFile, chosen, given

if TYPE_CHECKING:
    from ..models.io.export import Decisions
    from ..models.measurement.model import TapModel

_SUFFIXES = {"json": (".json",), "c-header": (".h", ".hpp")}


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
    border: Border = "uniform",
    theta_x: Annotated[
        float, Option(help="Belief in a position needed for a move; 0 always moves, 1 never does.")
    ] = 0.0,
    threshold: Annotated[float, Option(help="Belief in an object needed to decide; 1 never decides.")] = 0.95,
    fixation: Annotated[
        int | None, Option(help="Fixation point as 0-based class index; default the middle.", show_default=False)
    ] = None,
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
    decisions = _decisions(
        context, fitted, model, setting, border=border, threshold=threshold, theta_x=theta_x, fixation=fixation
    )
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


def _decisions(context: Context, fitted: "TapModel", model: Path, setting: Path | None, **options: Any) -> "Decisions":
    """What the options say, or a setting where they do not.

    Raises:
        InputError: A value is out of range, or the setting speaks of another model.
    """
    from ..inference.moves.control import check_fixation
    from ..models.io.export import Decisions
    from ..models.setting import load_setting

    read = None if setting is None else load_setting(setting)
    values: dict[str, Any] = chosen(context, read, **options)
    if read is not None:
        read.check_model(fitted, str(model), str(setting))
        if read.passive and not (given(context, "theta_x") or given(context, "fixation")):
            values["theta_x"] = 1.0
    for name, value in (("--threshold", values["threshold"]), ("--theta-x", values["theta_x"])):
        if not 0 <= value <= 1:
            raise InputError(f"{name} must lie between 0 and 1, got {value}.")
    values["fixation"] = check_fixation(values["fixation"], fitted.grid.L)
    return Decisions(**values)


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
