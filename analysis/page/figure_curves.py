"""Curves of a drawn figure as data, for a page on which they can be read off and switched off.

A curve is a line of plot that has a label or looks like one that has; its intervals are the band, or the bars, in
its colour around its points. So what a page says is what the figure shows, and no study draws a second time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, cast
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .numbers import number, rounded

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.container import Container
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend
    from matplotlib.lines import Line2D

type _Numbers = NDArray[np.float64]
type _Look = tuple[str, str, str]
type CurvePoint = tuple[float, float, str, str, str]
"""Place in the figure (fractions of its width and height from the upper left), the texts of x and y, and a name."""

_MOST_POINTS = 100  # of a curve; of one with more, every nth is given
_INSIDE = 0.51  # of a panel, from its middle: others are cut off
_DIGITS = 6  # of what has no interval, as thresholds are close to 1


class _Told(NamedTuple):
    """See `read_off`."""

    names: list[str]
    x: list[str]
    low: ArrayLike
    high: ArrayLike
    at: Sequence[int] | None
    y: list[str]


_TOLD: WeakKeyDictionary[Artist, _Told] = WeakKeyDictionary()


class CurveSeries(NamedTuple):
    """One curve of a panel.

    Attributes:
        label: What the legend calls it.
        colour: Of its line.
        parts: Ids of its elements in the drawing.
        points: See `CurvePoint`.
    """

    label: str
    colour: str
    parts: list[str]
    points: list[CurvePoint]


class CurvePanel(NamedTuple):
    """The curves of one panel.

    Attributes:
        title: Its letter and title.
        x: Label of the horizontal axis.
        y: Label of the vertical axis.
        box: Left, top, right and bottom, as of the points.
        series: The curves.
    """

    title: str
    x: str
    y: str
    box: tuple[float, float, float, float]
    series: list[CurveSeries]


def read_off(
    line: Line2D,
    names: Sequence[str] = (),
    x: Sequence[str] = (),
    low: ArrayLike = (),
    high: ArrayLike = (),
    at: Sequence[int] | None = None,
    y: Sequence[str] = (),
) -> None:
    """Says of the points of a line what its panel does not show.

    Args:
        line: The line.
        names: What each is, such as "threshold 0.9".
        x: Texts of their x, if they are drawn beside it.
        low: Lower ends of their intervals, if these are not drawn.
        high: Upper ends.
        at: Numbers of the points that are told, for which the rest is given; `None` for all.
        y: Texts of their y, if they are drawn beside it.
    """
    _TOLD[line] = _Told([*names], [*x], low, high, at, [*y])


def curves_of(figure: Figure) -> list[CurvePanel]:
    """The curves of a figure that is laid out; gives their elements the ids by which a page finds them."""
    known = _looks(figure)
    return [panel for i, axes in enumerate(figure.axes) if (panel := _panel(figure, axes, known, f"curve-{i}"))]


def _panel(figure: Figure, axes: Axes, known: dict[_Look, str], prefix: str) -> CurvePanel | None:
    found: list[CurveSeries] = []
    _ = axes.viewLim  # fits the data, if nothing has asked for it yet
    for i, line in enumerate(_lines(axes)):
        label = _public(line) or known.get(_look(line), "")
        points = [*_points(figure, axes, line)] if label else []
        if points:
            parts = _marked(axes, line, f"{prefix}-{i}")
            found.append(CurveSeries(label, _colour(line.get_color()), parts, points))
    if not found:
        return None
    (left, bottom), (right, top) = figure.transFigure.inverted().transform(axes.bbox.get_points()).tolist()
    title = " ".join(filter(None, (axes.get_title("left"), axes.get_title()))).replace("\n", " ")
    box = tuple(round(value, 4) for value in (left, 1 - top, right, 1 - bottom))
    return CurvePanel(title, _axis_label(axes, "x"), _axis_label(axes, "y"), cast("tuple", box), found)


def _lines(axes: Axes) -> list[Line2D]:
    """Lines of plot, but none that only spans the panel or stands for others in a key."""
    shown = (line for line in axes.lines if line.get_visible() and _of_data(axes, line))
    return [line for line in shown if np.isfinite(np.asarray(line.get_ydata(), dtype=float)).any()]


def _of_data(axes: Axes, artist: Artist) -> bool:
    """Whether both coordinates are values; those of `axhline` are not."""
    return all(artist.get_transform().contains_branch_seperately(axes.transData))


def _points(figure: Figure, axes: Axes, line: Line2D) -> Iterator[CurvePoint]:
    told = _TOLD.get(line, _Told([], [], (), (), None, []))
    chosen = slice(None) if told.at is None else told.at
    xs, ys = (np.asarray(values, dtype=np.float64)[chosen] for values in line.get_data())
    low, high = (np.asarray(end, dtype=np.float64) for end in (told.low, told.high))
    around = [*_intervals(axes, line)]
    if not low.size:
        low, high = _interval(around, xs, ys)
    left, right = _interval(around, ys, xs, flipped=True)
    words, read = (_words(axes.xaxis), _words(axes.yaxis)), axes.fmt_xdata
    shown, inside = (axes.transData + to.inverted() for to in (figure.transFigure, axes.transAxes))
    known = np.flatnonzero(np.isfinite(xs) & np.isfinite(ys))
    known = known[:: -(-len(known) // _MOST_POINTS) or 1]
    points = np.column_stack([xs[known], ys[known]])
    seen = np.all(np.abs(inside.transform(points) - 0.5) <= _INSIDE, axis=1)
    for i, (x, y) in zip(known[seen].tolist(), shown.transform(points[seen]).tolist(), strict=True):
        text = told.x[i] if told.x else read(float(xs[i])) if read else _text(words[0], xs[i], left[i], right[i])
        name = told.names[i] if told.names else ""
        value = told.y[i] if told.y else _text(words[1], ys[i], low[i], high[i])
        yield round(x, 4), round(1 - y, 4), text, value, name


def _interval(
    around: Sequence[LineCollection | PolyCollection], along: _Numbers, values: _Numbers, *, flipped: bool = False
) -> tuple[_Numbers, _Numbers]:
    """Ends of the narrowest interval around each value; NaN without one."""
    spans = [span for artist in around for span in _spans(artist, flipped)]
    if not spans:
        return np.full(len(values), np.nan), np.full(len(values), np.nan)
    at, low, high = np.transpose(spans)[:, :, None]
    inside = (np.abs(along - at) <= 1e-9 * np.abs(at)) & (low <= values) & (values <= high)
    narrowest = np.argmin(np.where(inside, high - low, np.inf), axis=0)
    known = inside.any(axis=0)
    return np.where(known, low[narrowest, 0], np.nan), np.where(known, high[narrowest, 0], np.nan)


def _intervals(axes: Axes, line: Line2D) -> Iterator[LineCollection | PolyCollection]:
    """Bands and bars in the colour of a line."""
    from matplotlib.collections import LineCollection, PolyCollection  # noqa: PLC0415

    colour = _colour(line.get_color())
    for artist in axes.collections:
        if not isinstance(artist, LineCollection | PolyCollection) or not _of_data(axes, artist):
            continue
        colours = artist.get_facecolor() if isinstance(artist, PolyCollection) else artist.get_edgecolor()
        if len(colours) == 1 and _colour(colours[0]) == colour:
            yield artist


def _spans(artist: LineCollection | PolyCollection, flipped: bool) -> Iterator[tuple[float, float, float]]:
    """Where each interval is, and its ends: bars along either axis, and bands along y."""
    from matplotlib.collections import LineCollection  # noqa: PLC0415

    bars = isinstance(artist, LineCollection)
    for path in artist.get_paths() if bars or not flipped else ():
        corners = np.asarray(path.vertices, dtype=float)[:, :: -1 if flipped else 1]
        corners = corners[np.isfinite(corners).all(axis=1)]
        if bars and len(corners) != 2:  # a curve of many
            continue
        for at in np.unique(corners[:, 0]).tolist():
            values = corners[corners[:, 0] == at, 1]
            if len(values) > 1:
                yield at, float(values.min()), float(values.max())


def _marked(axes: Axes, line: Line2D, name: str) -> list[str]:
    """Ids of the elements of a curve: its line, and intervals that are nobody else's."""
    line.set_gid(name)
    alike = [one for one in _lines(axes) if _colour(one.get_color()) == _colour(line.get_color())]
    parts = [name]
    for i, artist in enumerate(_intervals(axes, line) if alike == [line] else ()):
        artist.set_gid(f"{name}-{i}")
        parts.append(f"{name}-{i}")
    return parts


def _text(words: Mapping[float, str], value: Any, low: Any, high: Any) -> str:
    """A coordinate with its interval, or the label at its axis that stands for it."""
    if value in words:
        return words[value]
    if not low < high:
        return number(value, _DIGITS)
    text, *ends = rounded(value, low, high)
    return f"{text} [{', '.join(ends)}]"


def _words(axis: Axis) -> dict[float, str]:
    """What stands at an axis for numbers, but for numbers themselves."""
    from matplotlib.ticker import FixedLocator  # noqa: PLC0415

    places = axis.get_majorticklocs().tolist() if isinstance(axis.get_major_locator(), FixedLocator) else []
    words = {place: axis.get_major_formatter()(place, i) for i, place in enumerate(places)}
    return {place: word for place, word in words.items() if not _is_number(word)}


def _is_number(word: str) -> bool:
    return not word or word.replace("\N{MINUS SIGN}", "-").replace(".", "").lstrip("-").isdigit()


def _axis_label(axes: Axes, which: str) -> str:
    """The label of an axis, of an equal one below or left of it, or of the whole figure."""
    others = [one for one in axes.figure.axes if _stands_for(one, axes, which)]
    others.sort(key=lambda one: abs(one.bbox.y0 - axes.bbox.y0) + abs(one.bbox.x0 - axes.bbox.x0))
    labels = [getattr(one, f"get_{which}label")() for one in (axes, *others)]
    return next(filter(None, [*labels, getattr(axes.figure, f"get_sup{which}label")()]), "").replace("\n", " ")


def _stands_for(other: Axes, axes: Axes, which: str) -> bool:
    """Whether an axis of another panel has the same ends and is where the label of many is."""
    ends = (getattr(one, f"get_{which}lim")() for one in (axes, other))
    further = other.bbox.y0 - axes.bbox.y0 if which == "x" else other.bbox.x0 - axes.bbox.x0
    return bool(further < 1 and np.allclose(*ends))


def _looks(figure: Figure) -> dict[_Look, str]:
    """Labels of lines by their looks, those of keys first."""
    from matplotlib.lines import Line2D  # noqa: PLC0415

    keys = [*figure.legends, *(key for axes in figure.axes if (key := axes.get_legend()))]
    found = {look: label for key in keys for look, label in _entries(key)}
    for axes in figure.axes:
        for line in _lines(axes):
            if label := _public(line):
                found.setdefault(_look(line), label)
        for container in axes.containers:
            lines = [line for line in container.get_children() if isinstance(line, Line2D)]
            if lines and (label := _public(container)):
                found.setdefault(_look(lines[0]), label)
    return found


def _entries(key: Legend) -> Iterator[tuple[_Look, str]]:
    for handle, text in zip(key.legend_handles, key.get_texts(), strict=True):
        line = handle[0] if isinstance(handle, tuple) else handle
        if hasattr(line, "get_marker"):
            yield _look(cast("Line2D", line)), text.get_text()


def _look(line: Line2D) -> _Look:
    return _colour(line.get_color()), str(line.get_linestyle()), str(line.get_marker())


def _public(artist: Artist | Container) -> str:
    label = str(artist.get_label())
    return "" if label.startswith("_") else label.strip("\N{ZERO WIDTH SPACE}")


def _colour(colour: object) -> str:
    from matplotlib.colors import to_hex  # noqa: PLC0415

    return to_hex(cast("str", colour))
