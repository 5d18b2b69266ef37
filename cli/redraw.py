"""`solidtouch redraw`: figures of a run from its file of numbers, in another style or format."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from ..models.errors import InputError, check_format
from .shared.interrupt import loading
from .shared.options import Force, Style

if TYPE_CHECKING:
    import xarray as xr

type _Draw = Callable[[], Any]


def redraw(
    file: Annotated[Path, Argument(metavar="FILE", help="`results.nc` of `reproduce`, or `compare.nc` of `compare`.")],
    names: Annotated[
        list[str] | None, Argument(metavar="FIGURE...", help="Figures to draw, such as fig7; default: all.")
    ] = None,
    style: Style = "page",
    layout: Annotated[Literal["svg", "pdf", "png"], Option("--format", help="File format.")] = "svg",
    out: Annotated[
        Path | None, Option(help="Folder for the figures; default: `figures-STYLE` beside FILE.", show_default=False)
    ] = None,
    force: Force = False,
) -> None:
    """Draw the figures of a finished run again from FILE, in another style or format."""
    with loading():
        from ..analysis.page.figure_sizes import drawn_as
        from ..analysis.page.figure_style import save_as
        from ..models.storage import check_writable, read_groups
    from .shared.progress import bars

    groups = read_groups(file, None)
    draws, absent = _figures(file, groups)
    for name in names or ():
        if name not in draws:
            why = absent.get(name) or f"the file's figures are {', '.join(draws)}"
            raise InputError(f"{file}: the figure {name!r} cannot be drawn: {why}.")
    chosen = list(dict.fromkeys(names or draws))
    folder = out or file.parent / f"figures-{style}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be created: {error.strerror}.") from error
    targets = {name: check_writable(folder / f"{name}.{layout}", force) for name in chosen}
    with bars() as progress, drawn_as(style):
        advance = progress("Drawing figures", len(chosen))
        for name, target in targets.items():
            figure = draws[name]()
            if figure is not None:
                save_as(figure, target, layout)
            advance(1)
    print(f"Figures saved to {folder}: {', '.join(chosen)}")
    if names is None and absent:
        print("\n".join(f"Without {name}: {why}." for name, why in absent.items()))


def _figures(file: Path, groups: "Mapping[str, xr.Dataset]") -> "tuple[dict[str, _Draw], dict[str, str]]":
    """What draws each figure of a file, and why others cannot be drawn.

    Raises:
        InputError: It is not a file of results, or lacks something.
    """
    from ..analysis.compare import redraw as comparison
    from ..analysis.page.labelled import NUMBERS_FORMAT
    from ..analysis.reproduce import redraw as reproduction

    if other := _other_kind(groups["/"]):
        raise InputError(f"{file}: not a file of results, but {other}; expected `results.nc` or `compare.nc`.")
    written = groups["/"].attrs.get("format", NUMBERS_FORMAT)  # before 0.2.0 without
    check_format(written, f"{file}: a file", NUMBERS_FORMAT)
    try:
        if "grid" in groups["/"].attrs and "passive/curve" in groups:
            return reproduction.stored_figures(groups), reproduction.NOT_STORED
        if "grid" in groups["/"].attrs and "classes" in groups:
            return comparison.stored_figures(groups), {}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{file}: not a whole file of results: {error}.") from error
    older = " of an earlier version" * bool({"passive/curve", "classes"} & groups.keys())
    raise InputError(f"{file}: not a file of results{older}; expected `results.nc` or `compare.nc` of this version.")


def _other_kind(root: "xr.Dataset") -> str:
    """What else of this software a file is, whose formats have numbers of their own; empty for none."""
    if {"kind", "digest"} & root.attrs.keys():
        return "a fitted model"
    return "a tap set" if "taps" in root else ""
