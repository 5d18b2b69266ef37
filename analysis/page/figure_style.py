"""Style of all figures: fonts, colours, axis labels, and files; `figure_sizes` holds their sizes.

Matplotlib is imported when a figure is drawn, so that importing this package stays cheap. Figures are
`matplotlib.figure.Figure` objects and settings hold only while one is drawn or written: no pyplot and no global
state.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache, partial, wraps
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.storage import complete_file
from .figure_curves import CurvePanel, curves_of
from .figure_sizes import finish, new_figure, sized
from .figure_svg import shortened

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

_PNG_DPI = 200
_MOST_PIXELS = 2100
_MADE: dict[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": "solidtouch"},
    "pdf": {"CreationDate": None, "Creator": "solidtouch"},
    "png": {"Software": "solidtouch"},
}
FORMATS = tuple(_MADE)
_MOST_LETTERS = 28
_FONT = "DejaVu Sans"
MOST_FACTOR = 1000.0  # beyond which the size of a factor says nothing

PASSIVE = "#c8102e"
ACTIVE = "#000000"
TRUE = "#0072b2"
DECIDED = "#d55e00"
OTHERS = "#a0a0a0"
FIXATION = "#6e6e6e"
TWELVE = (
    "#88ccee",
    "#cc6677",
    "#ddcc77",
    "#117733",
    "#332288",
    "#aa4499",
    "#44aa99",
    "#999933",
    "#882255",
    "#661100",
    "#6699cc",
    "#888888",
)  # CARTO "Safe", told apart under the common colour deficiencies

_STYLE: dict[Any, Any] = {
    "font.family": _FONT,  # comes with matplotlib, so figures look alike everywhere
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.titley": 1.0,  # a title that looks for its place takes a quarter of the time of drawing
    "axes.labelsize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "axes.formatter.useoffset": False,
    "axes.xmargin": 0.02,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "xtick.major.pad": 3.5,
    "ytick.major.pad": 3.5,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "xtick.minor.pad": 3.4,
    "ytick.minor.pad": 3.4,
    "lines.linewidth": 1.0,
    "lines.markersize": 3.0,
    "figure.dpi": 100,
    "figure.autolayout": False,
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "solidtouch",
    "pdf.fonttype": 42,  # as journals ask for
}


def styled[**P, R](draw: Callable[P, R]) -> Callable[P, R]:
    """The same function, run under the settings of this package."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        import matplotlib as mpl  # noqa: PLC0415

        with mpl.rc_context(sized(_STYLE)):
            drawn = draw(*args, **kwargs)
            if hasattr(drawn, "subfigs"):
                finish(drawn, [*_parts(drawn)])
            return drawn

    return drawn


def _parts(artist: Any) -> Iterator[Artist]:
    """An artist and all that is in it; of axes texts alone, but for those at the ticks of numbers."""
    from matplotlib.axis import Axis  # noqa: PLC0415
    from matplotlib.ticker import LogFormatter, ScalarFormatter  # noqa: PLC0415

    yield artist
    if not isinstance(artist, Axis):
        for part in artist.get_children():
            yield from _parts(part)
        return
    yield artist.label
    if not isinstance(artist.get_major_formatter(), LogFormatter | ScalarFormatter):
        for tick in artist.get_major_ticks():
            yield tick.label1
            yield tick.label2


@cache
def _letters() -> set[int]:
    """What the font can draw."""
    from matplotlib.font_manager import findfont, get_font  # noqa: PLC0415

    return set(get_font(findfont(_FONT)).get_charmap())


class Drawing(NamedTuple):
    """A figure in files.

    Attributes:
        svg: Its SVG, the same bytes for the same figure.
        inches: Its width.
        png: Draws it in pixels, 200 dpi.
        curves: Those that a page reads off and switches off.
    """

    svg: bytes
    inches: float
    png: Callable[[], bytes]
    curves: Sequence[CurvePanel] = ()


@styled
def drawing_of(figure: Figure) -> Drawing:
    """Lays out a figure, once and for all, and draws it."""
    from .figure_canvas import Canvas, FigureCanvasSVG  # noqa: PLC0415

    Canvas(figure, _raster_dpi(figure), _MADE["svg"])
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine(None)  # with an engine a figure is drawn twice
    curves = curves_of(figure)  # before the SVG, in which they have ids
    file = BytesIO()
    figure.savefig(file, format="svg")
    FigureCanvasSVG(figure)  # others are drawn on once
    ids = [part for panel in curves for series in panel.series for part in series.parts]
    return Drawing(shortened(file.getvalue(), ids), figure.get_figwidth(), partial(_pixels, figure), curves)


def _raster_dpi(figure: Figure) -> float:
    """Of pixels in vector formats: 300, or fewer where a figure would have more than are seen."""
    return min(300.0, _MOST_PIXELS / figure.get_figwidth())


@styled
def _pixels(figure: Figure) -> bytes:
    file = BytesIO()
    figure.savefig(file, format="png", dpi=_PNG_DPI)
    return file.getvalue()


def drawn(draw: Callable[[], Figure | None]) -> Drawing | None:
    """Draws the figure that a function makes, if it makes one."""
    figure = draw()
    return None if figure is None else drawing_of(figure)


@styled
def draw_nothing() -> None:
    """Loads what drawing needs."""
    figure, axes = new_figure(1, 1)
    axes[0, 0].set_title("0")
    drawing_of(figure)


def save(figure: Figure | Drawing, folder: str | Path, name: str, most: float = np.inf) -> tuple[Path, ...]:
    """Writes `name.svg` into a folder; the same figure gives the same bytes.

    Args:
        figure: The figure, drawn or not.
        folder: Where to.
        name: Of the file without its suffix.
        most: Bytes of a drawing above which `name.png` (200 dpi) is written as well.

    Returns:
        The files written.

    Raises:
        InputError: The folder cannot be written.
    """
    svg, png = Path(folder) / f"{name}.svg", Path(folder) / f"{name}.png"
    drawing = figure if isinstance(figure, Drawing) else drawing_of(figure)
    with complete_file(svg, force=True) as temporary:
        temporary.write_bytes(drawing.svg)
    if len(drawing.svg) <= most:
        return (svg,)
    with complete_file(png, force=True) as temporary:
        temporary.write_bytes(drawing.png())
    return svg, png


@styled
def save_as(figure: Figure, path: Path, kind: str) -> None:
    """Writes a figure into a file that may exist, as one of `FORMATS`; the same figure gives the same bytes."""
    with complete_file(path, force=True) as temporary:
        if kind == "svg":
            temporary.write_bytes(drawing_of(figure).svg)
            return
        figure.savefig(
            temporary, format=kind, dpi=_PNG_DPI if kind == "png" else _raster_dpi(figure), metadata=_MADE[kind]
        )


def short(name: str, among: Iterable[str] = ()) -> str:
    """A name for labels, at most 28 characters, with squares for those that the font lacks.

    Tables hold the whole name.

    >>> rods = [f"smooth aluminium rod no. {i} with a matt finish" for i in (1, 2)]
    >>> [short(rod, rods) for rod in rods]
    ['smooth a…no. 1 with a…finish', 'smooth a…no. 2 with a…finish']

    Args:
        name: The name.
        among: All names beside which it stands; those that are different stay so.
    """
    name = _shortened(name, tuple(dict.fromkeys([*among, name])))
    name = "".join(each if ord(each) in _letters() else "\N{WHITE SQUARE}" for each in name)
    return f"\N{ZERO WIDTH SPACE}{name}" if name.startswith("_") else name  # legends leave out what begins with it


@cache
def _shortened(name: str, among: tuple[str, ...]) -> str:
    if len(name) <= _MOST_LETTERS:
        return name
    long = [each for each in among if len(each) > _MOST_LETTERS]
    for way in (_without_middle, partial(_around, at=_alike(long)), partial(_from_most_similar, among=long)):
        found = [way(each) if len(each) > _MOST_LETTERS else each for each in among]
        if len(set(found)) == len(found):
            return way(name)
    number = f" ({among.index(name) + 1})"
    return _without_middle(name, _MOST_LETTERS - len(number)) + number


def _without_middle(name: str, letters: int = _MOST_LETTERS) -> str:
    return f"{name[: letters - 9]}…{name[-8:]}"


def _around(name: str, at: int) -> str:
    """Begin and end of a name with what stands about letter number `at`."""
    begin = max(8, at - 4)
    return f"{name[:8]}…{name[begin : begin + 12]}…{name[-6:]}"


def _from_most_similar(name: str, among: Sequence[str]) -> str:
    """The same where it first differs from the most similar other one."""
    return _around(name, max((_alike([name, other]) for other in among if other != name), default=0))


def _alike(names: Sequence[str]) -> int:
    """How many letters all names begin with alike."""
    columns = zip(*names, strict=False)
    return next((at for at, letters in enumerate(columns) if len(set(letters)) > 1), min(map(len, names)))


def unit_name(unit: str) -> str:
    """A unit up to its first comma, semicolon or bracket, for tables."""
    return re.split("[,;(]", unit, maxsplit=1)[0].strip()


def short_unit(unit: str) -> str:
    """The same for labels of figures, at most 28 characters."""
    return short(unit_name(unit))


def axis_label(quantity: str, unit: str) -> str:
    """A quantity with its unit in brackets; an error that is a `"P(wrong)"` is named so."""
    if unit == "P(wrong)":
        return f"{quantity.removesuffix(' error')}: {unit}"
    unit = short_unit(unit)
    return f"{quantity} ({unit})" if unit else quantity


def label_panel(axes: Axes, letter: str, title: str = "") -> None:
    """Writes the panel's letter at its upper left corner and a title above its middle."""
    axes.set_title(letter, loc="left", fontsize="large", fontweight="bold")
    axes.set_title(title)


def class_ticks(axes: Axes, values: ArrayLike) -> None:
    """Marks the class centres by small ticks on the x axis, beside round numbers."""
    axes.locator_params(axis="x", steps=[1, 2, 5, 10])
    axes.set_xticks(np.unique(values), minor=True)


def colours(n: int) -> list[Any]:
    """`n` colours to tell lines apart: a qualitative palette up to twelve, then a sequential map."""
    if n <= len(TWELVE):
        return list(TWELVE[:n])
    return list(_colormap("viridis")(np.linspace(0, 0.95, n)))


def shades(n: int, colour: str) -> list[Any]:
    """`n` shades of a colour, from light to itself."""
    from matplotlib.colors import to_hex, to_rgb  # noqa: PLC0415

    red, green, blue = (1 - part for part in to_rgb(colour))
    shares = np.linspace(0.2, 1, n).tolist() if n > 1 else [1.0]
    return [to_hex((1 - share * red, 1 - share * green, 1 - share * blue)) for share in shares]


def discrete_colours(palette: Sequence[Any]) -> ScalarMappable:
    """What a colour bar needs to show these colours as equal steps; colour `i` is centred at `i`."""
    from matplotlib.cm import ScalarMappable  # noqa: PLC0415
    from matplotlib.colors import BoundaryNorm, ListedColormap  # noqa: PLC0415

    n = len(palette)
    return ScalarMappable(BoundaryNorm(np.arange(n + 1) - 0.5, n), ListedColormap(list(palette)))


def line_bundle(axes: Axes, x: NDArray[Any], ys: NDArray[Any], **style: Any) -> None:
    """Draws many lines over the same `x`, shape (lines, len(x)); NaN ends a line.

    Bundles of more than 200 lines become pixels in vector formats, which keeps the files small.
    """
    from matplotlib.collections import LineCollection  # noqa: PLC0415

    lines = [np.column_stack([x, y])[np.isfinite(y)] for y in ys]
    axes.add_collection(LineCollection(lines, rasterized=len(lines) > 200, **style))


def band(axes: Axes, x: ArrayLike, data: xr.Dataset, name: str, colour: Any) -> None:
    """Shades and outlines the interval of a curve over `x`; a single point has a line.

    Where bands overlap, outlines tell them apart: black is paler than colours, as a mixture with it looks like another.
    """
    from matplotlib.colors import to_hex, to_rgb  # noqa: PLC0415

    low, high = data[f"{name}_low"].values, data[f"{name}_high"].values
    if len(low) == 1:
        axes.vlines(x, low, high, color=colour, linewidth=0.6)
        return
    shade = (to_hex(colour), 0.16 if max(to_rgb(colour)) > 0.3 else 0.06)
    edge = (to_hex(colour), 0.45)
    axes.fill_between(np.asarray(x), low, high, facecolor=shade, edgecolor=edge, linewidth=0.5)


def every(labels: Sequence[str], characters: int) -> int:
    """Each how manyth label to print so that a row holds no more than this many characters."""
    return max(1, -(-sum(len(label) + 2 for label in labels) // characters))


def _colormap(name: str) -> Any:
    import matplotlib as mpl  # noqa: PLC0415

    return mpl.colormaps[name]
