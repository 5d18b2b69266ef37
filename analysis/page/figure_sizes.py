"""Sizes of figures: for a page, a column of a paper, or a slide. The table `STYLES` holds all of them.

Figures are designed with type of eight points, seven inches wide at most. A style says how large type is and how
wide what spans the page is; strokes and marks grow with the type.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from itertools import pairwise
from textwrap import fill
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

ONE_COLUMN = 3.4  # inches
TWO_COLUMNS = 7.0
_POINTS = 8.0  # of type in the design
_PANEL = 1.9  # inches, the least width of a panel in the design
_PER_EM = 1.54  # characters
_HANDLE = 9  # characters, the room of a line and its mark in a key
_LETTER = 2  # likewise of the letter of a panel
_SHORTEST = 16  # characters of a line that is not broken
_SCALED = (
    *("font.size", "axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize", "legend.fontsize"),
    *(f"{axis}tick.{rank}.{size}" for axis in "xy" for rank in ("major", "minor") for size in ("width", "size", "pad")),
)

type StyleName = Literal["page", "paper", "talk"]


class FigureStyle(NamedTuple):
    """Sizes of one use.

    Attributes:
        points: Size of type.
        inches: Width of a figure that spans the page.
        column: Width of all others; those of many panels have two columns of panels there. 0 keeps their share.
        height: Of panels without rows of text, over that of the design at this size of type.
        aspect: Width over height of every figure; 0 where each has its own.
    """

    points: float
    inches: float
    column: float = 0.0
    height: float = 1.0
    aspect: float = 0.0

    @property
    def zoom(self) -> float:
        """Type over that of the design."""
        return self.points / _POINTS


_DESIGN = FigureStyle(_POINTS, TWO_COLUMNS)
STYLES: Mapping[str, FigureStyle] = {
    "page": FigureStyle(10.0, 10.8, height=1.1),
    "paper": FigureStyle(7.0, 180 / 25.4, column=88 / 25.4, height=0.85),
    "talk": FigureStyle(16.0, 40 / 3, aspect=16 / 9),
}
NARROW = FigureStyle(10.0, 4.0, column=4.0)
"""For a page in a narrow window."""
_STYLE: ContextVar[FigureStyle] = ContextVar("style", default=STYLES["page"])
_TARGET: ContextVar[Figure | SubFigure | None] = ContextVar("target", default=None)


@contextmanager
def drawn_as(name: StyleName | FigureStyle, figure: Figure | SubFigure | None = None) -> Iterator[None]:
    """Has figures drawn meanwhile in a style.

    Args:
        name: One of `STYLES`, or a style.
        figure: Where to draw them; its size stays, and so do the sizes of the design.

    Raises:
        InputError: There is no such style.
    """
    if isinstance(name, str) and name not in STYLES:
        raise InputError(f"There is no style {name!r}; styles are {', '.join(STYLES)}.")
    wanted = STYLES[name] if isinstance(name, str) else name
    style, target = _STYLE.set(wanted if figure is None else _DESIGN), _TARGET.set(figure)
    try:
        yield
    finally:
        _STYLE.reset(style)
        _TARGET.reset(target)


def narrowly(draw: Callable[[], Figure | None]) -> Figure | None:
    """Calls a function that draws, for a narrow window."""
    with drawn_as(NARROW):
        return draw()


def for_all_widths(draw: Callable[[], Figure | None], narrow: bool = True) -> list[Callable[[], Figure | None]]:
    """The function that draws a figure, and one that draws it for a narrow window, if that is wanted."""
    return [draw, partial(narrowly, draw)] if narrow else [draw]


def is_drawn_for_pages() -> bool:
    """Whether figures have the sizes of a page, as those drawn ahead have."""
    return _STYLE.get() is STYLES["page"]


def sized(settings: Mapping[Any, Any]) -> dict[Any, Any]:
    """Settings of matplotlib with the sizes of the style."""
    zoom = _STYLE.get().zoom
    return {key: value * zoom if key in _SCALED else value for key, value in settings.items()}


def new_figure(
    width: float,
    height: float,
    rows: int = 1,
    columns: int = 1,
    *,
    panel: float = _PANEL,
    of_text: bool = False,
    whole: bool = False,
    **options: Any,
) -> tuple[Figure, NDArray[Any]]:
    """A figure, or the one of `drawn_as`, and its axes, shape (rows, columns).

    Args:
        width: Inches in the design.
        height: Likewise.
        rows: Of panels.
        columns: Of panels; in a narrow figure they go on below.
        panel: The least width of a panel in inches of the design.
        of_text: Whether the height is made of rows of text, and nothing can be lower.
        whole: Whether rows and columns say something, so that they are kept and the figure spans the page.
        options: Of `Figure.subplots`.
    """
    style = _STYLE.get()
    across = columns
    if style.column and not whole:
        across = max(1, min(columns, int(style.column / style.zoom / panel)))
    height *= -(-rows * columns // across) / rows
    figure = empty_figure(width, height, of_text=of_text, whole=whole)
    if across == columns:
        return figure, figure.subplots(rows, columns, squeeze=False, **options)
    return figure, _flowing(figure, rows, columns, across, **options)


def empty_figure(width: float, height: float, *, of_text: bool = False, whole: bool = False) -> Any:
    """A figure, or the one of `drawn_as`, without panels; see `new_figure`."""
    from .figure_shown import ShownFigure  # noqa: PLC0415 - matplotlib is loaded where something is drawn

    style = _STYLE.get()
    high = height * style.zoom * (1.0 if of_text else style.height)
    wide = style.inches * width / TWO_COLUMNS if not style.column else style.inches if whole else style.column
    if style.aspect:
        high = max(style.inches / style.aspect, high)
        wide = high * style.aspect
    return _TARGET.get() or ShownFigure(figsize=(wide, high), layout="constrained")


def _flowing(figure: Any, rows: int, columns: int, across: int, **options: Any) -> NDArray[Any]:
    """Axes of a grid that goes on below after fewer columns; see `finish` for their labels."""
    options.pop("width_ratios", None)
    grid = figure.add_gridspec(-(-rows * columns // across), across)
    axes = np.empty((rows, columns), dtype=object)
    shared = {axis: str(options.get(f"share{axis}", False)).lower() for axis in "xy"}
    for i in range(rows * columns):
        row, column = divmod(i, columns)
        first = {"true": (0, 0), "all": (0, 0), "row": (row, 0), "col": (0, column)}
        like = {f"share{axis}": axes[first[how]] for axis, how in shared.items() if how in first}
        axes[row, column] = panel = figure.add_subplot(grid[divmod(i, across)], **like)
        panel.first_of_row = axes[row, 0]
        beside = i % across > 0 and (shared["y"] in ("true", "all") or (shared["y"] == "row" and column > 0))
        panel.tick_params(axis="y", labelleft=not beside)
        panel.flows = not beside and shared["y"] in ("true", "all", "row")
    return axes


def finish(figure: Any, parts: Sequence[Any]) -> None:
    """Gives a drawn figure the sizes of its style, and labels panels that go on below.

    Its texts are drawn letter by letter, as names may hold `$`, which begins a formula.

    Args:
        figure: Which.
        parts: All artists in it but those of ticks.
    """
    from matplotlib.text import Text  # noqa: PLC0415

    for part in parts:
        if isinstance(part, Text):
            part.set_parse_math(False)
    for axes in figure.axes:
        if getattr(axes, "flows", False) and not axes.get_ylabel():
            axes.set_ylabel(axes.first_of_row.get_ylabel())
    _wrap(figure)
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            _fix_ticks(axis)
    zoom = _STYLE.get().zoom
    if zoom != 1:
        for part in parts:
            _grow(part, zoom)


def characters(figure: Any) -> int:
    """How many characters of its type fit beside each other in a figure."""
    return int(_PER_EM * 72 * figure.bbox.width / figure.figure.dpi / _STYLE.get().points)


def key(figure: Any, handles: Sequence[Any], labels: Sequence[str] = (), *, above: bool = False, **options: Any) -> Any:
    """One key of all panels, below or above them, in as many columns as there is room for.

    Args:
        figure: Which.
        handles: Lines and patches.
        labels: What they mean; by default what their labels say.
        above: Whether the key is above the panels.
        options: Of `Figure.legend`.
    """
    labels = list(labels) or [str(handle.get_label()) for handle in handles]
    lengths, room, n = [len(label) + _HANDLE for label in labels], characters(figure), len(labels)
    wanted = (columns for columns in range(n, 0, -1) if _key_width(lengths, columns) <= room)
    place = "outside upper center" if above else "outside lower center"
    return figure.legend(handles, labels, loc=place, ncols=next(wanted, 1), **options)


def _key_width(lengths: Sequence[int], columns: int) -> int:
    """Characters of so many columns, the first of which have one entry more where they are uneven, as in matplotlib."""
    rows, longer = divmod(len(lengths), columns)
    starts = [i * rows + min(i, longer) for i in range(columns + 1)]
    return sum(max(lengths[start:end]) for start, end in pairwise(starts))


def _wrap(figure: Any) -> None:
    """Breaks labels below and titles above panels that are longer than their panels are wide."""
    room = characters(figure)
    for text in (figure._supxlabel, figure._suptitle):
        if text is not None:
            text.set_text(_filled(text.get_text(), room))
    for axes in figure.axes:
        place = axes.get_subplotspec()
        if place is not None:
            share = len(place.colspan) / place.get_gridspec().ncols
            axes.xaxis.label.set_text(
                _filled(axes.get_xlabel(), int(0.95 * share * room) - (share == 1) * _beside(axes))
            )
            axes.title.set_text(_filled(axes.get_title(), int(0.9 * share * room) - _LETTER))


def _beside(axes: Axes) -> int:
    """Characters of the longest line of the words at the vertical axis, if there are any."""
    from matplotlib.ticker import FixedLocator  # noqa: PLC0415

    if not isinstance(axes.yaxis.get_major_locator(), FixedLocator):
        return 0
    words = axes.yaxis.get_major_formatter().format_ticks(axes.yaxis.get_majorticklocs().tolist())
    return max((len(line) for word in words for line in word.split("\n")), default=0)


def _filled(text: str, width: int) -> str:
    return "\n".join(fill(line, max(width, _SHORTEST)) for line in text.split("\n"))


def _fix_ticks(axis: Any) -> None:
    """Sets sizes that ticks would take from settings when they are drawn, which may be later."""
    import matplotlib as mpl  # noqa: PLC0415

    name, settings = f"{axis.axis_name}tick", cast("dict[str, Any]", mpl.rcParams)
    for rank in ("major", "minor"):
        given = axis.get_tick_params(rank)
        own: dict[str, Any] = {size: settings[f"{name}.{rank}.{size}"] for size in ("size", "width", "pad")}
        own["length"] = own.pop("size")
        own["labelsize"] = settings[f"{name}.labelsize"]
        axis.set_tick_params(which=rank, **{key: value for key, value in own.items() if key not in given})


def _grow(part: Any, zoom: float) -> None:
    """Makes strokes, marks and distances of a part of a figure larger."""
    from matplotlib.collections import Collection, PathCollection  # noqa: PLC0415
    from matplotlib.lines import Line2D  # noqa: PLC0415
    from matplotlib.patches import Patch  # noqa: PLC0415
    from matplotlib.text import Annotation  # noqa: PLC0415

    match part:
        case Line2D():
            part.set_linewidth(zoom * part.get_linewidth())
            part.set_markersize(zoom * part.get_markersize())
            part.set_markeredgewidth(zoom * part.get_markeredgewidth())
        case Patch():
            part.set_linewidth(zoom * part.get_linewidth())
        case Collection():
            part.set_linewidth((zoom * np.asarray(part.get_linewidth())).tolist())
            if isinstance(part, PathCollection):
                part.set_sizes(zoom**2 * np.asarray(part.get_sizes()))
        case Annotation(anncoords="offset points"):
            part.xyann = tuple(zoom * np.asarray(part.xyann))
