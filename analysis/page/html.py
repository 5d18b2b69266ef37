"""A page as one self-contained HTML file."""

import base64
import json
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cache, partial
from importlib import resources
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING, Any, NamedTuple
from warnings import warn

from markupsafe import Markup, escape

from ...models.errors import InputError
from .ahead import drawn_ahead
from .figure_curves import CurvePanel
from .figure_sizes import is_drawn_for_pages
from .figure_style import Drawing, drawn, save
from .page import Page, Picture, Section, blocks_of, brief, spans

if TYPE_CHECKING:
    from jinja2 import Environment, Template

_IMAGE_BYTES = 2_200_000  # of all figures together; a page has less than 3 MB
_FIGURES = 10  # among which they are shared at most: pixels of figures below their share take no fewer bytes
_IN_URI = {"%": "%25", "#": "%23", "&": "%26", "'": "%26apos;", '"': "'"}  # one after the other
_TOLD_PANELS, _TOLD_SERIES = 6, 3
_ELEMENTS = {"": Markup("{0}"), "strong": Markup("<strong>{0}</strong>"), "code": Markup("<code>{0}</code>")}
_BRACKET = re.compile(r"[\[(].*?[\])]")
_LINK = Markup('<a href="{1}">{0}</a>')


class Image(NamedTuple):
    """A figure inside a page.

    Attributes:
        data: Its file as a data URI.
        narrow: Likewise, for narrow windows; empty where it is the same.
        width: In CSS pixels, 96 per inch.
        curves: What is read off and switched off on the page, as JSON; empty without curves.
        words: What its panels show, after title and caption, for who cannot see them.
    """

    data: str
    width: int
    curves: str = ""
    words: str = ""
    narrow: str = ""


def write_page(
    folder: Path, page: Page, summary: Mapping[str, Any], name: str, images: Mapping[str, Image | str]
) -> None:
    """Writes a page and the numbers behind it into a folder.

    Args:
        folder: Where to, see `storage.complete_folder`.
        page: The page, `report.html`.
        summary: Content of the JSON file.
        name: Of the JSON file.
        images: The figures, from `draw_pictures`.
    """
    text = json.dumps(summary, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    (folder / name).write_text(text, encoding="utf-8")
    (folder / "report.html").write_text(render_page(page, images), encoding="utf-8")


def draw_pictures(
    folder: Path, pictures: Sequence[Picture], advance: Callable[[int], object]
) -> dict[str, Image | str]:
    """Writes figures into a folder, and returns them for a page by name, or why one could not be drawn."""
    images: dict[str, Image | str] = {}
    for_pages = is_drawn_for_pages()
    _code()  # while figures are drawn

    def drawing_by(draw: Callable[[], Any]) -> Drawing | None:
        known = drawn_ahead(draw) if for_pages else None
        return drawn(draw) if known is None else known[1]

    for picture in pictures:
        try:
            drawing = drawing_by(picture.draw)
            if drawing is not None:
                files = save(drawing, folder, picture.name, _IMAGE_BYTES // min(len(pictures), _FIGURES))
                image = embedded(files, round(96 * drawing.inches))
                images[picture.name] = image._replace(
                    curves=_as_json(drawing.curves if picture.curves else ()),
                    words=in_words(drawing.curves),
                    narrow="".join(_narrow(drawing_by(draw)) for draw in picture.narrow_draws if for_pages),
                )
        except InputError:  # of the folder
            raise
        except Exception as error:  # a figure must not cost the results
            reason = f"The figure {picture.name} could not be drawn: {type(error).__name__}, {error}"
            images[picture.name] = reason
            warn(reason, stacklevel=2)
        advance(1)
    return images


def render_page(page: Page, images: Mapping[str, Image | str] | None = None) -> str:
    """The page as text.

    Args:
        page: What it shows.
        images: Its figures by name, or why one is missing; others are left out.
    """
    images = images or {}
    page = page.filled(images)
    style, script = _file("page.css"), _file("page.js")
    return _template(page).render(page=page, images=images, style=style, script=script, whole=True)


def render_brief(page: Page) -> str:
    """The short version of the page, without figures and styles, as part of another page."""
    page = brief(page).filled()
    return _template(page).render(page=page, images={}, whole=False)


def embedded(files: Sequence[Path], width: int) -> Image:
    """A figure for a page, `width` pixels wide: the smallest of its files."""
    chosen = min(files, key=lambda path: path.stat().st_size)
    data = chosen.read_bytes()
    return Image(_svg_uri(data) if chosen.suffix == ".svg" else _png_uri(data), width)


def _narrow(drawing: Drawing | None) -> str:
    """An address among others, which spaces part."""
    return "" if drawing is None else _svg_uri(drawing.svg).replace(" ", "%20")


def _svg_uri(data: bytes) -> str:
    """An address to stand in quotation marks, of an SVG whose attributes do; a browser knows links by a short name."""
    text = data.decode().replace("xlink:href", "href").replace(">\n", ">").replace("\n", " ")
    for character, written in _IN_URI.items():  # faster than `translate`
        text = text.replace(character, written)
    return f"data:image/svg+xml,{text}"


def _png_uri(data: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(data).decode('ascii')}"


@cache
def _code() -> CodeType:
    """The template of pages, compiled."""
    return _environment().compile(_file("page.html"))


def _environment(ids: Collection[str] = ()) -> "Environment":
    """Of templates; `ids` are places of the page that links may lead to."""
    from jinja2 import Environment, StrictUndefined  # noqa: PLC0415 - not before there is a page

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    marked = partial(_marked, ids=ids)
    environment.filters.update(kind=lambda block: type(block).__name__, marked=marked, unbroken=_unbroken)
    return environment


def _template(page: Page) -> "Template":
    blocks = [*blocks_of([*page.intro, *page.sections])]
    ids = {block.id for block in blocks if isinstance(block, Section)}
    ids |= {f"figure-{block.name}" for block in blocks if isinstance(block, Picture)}
    environment = _environment(ids - {""})
    return environment.template_class.from_code(environment, _code(), environment.make_globals(None))


def in_words(panels: Sequence[CurvePanel]) -> str:
    """Axes of panels, and where their first curves begin and end; as much as is listened to."""
    more = len(panels) - _TOLD_PANELS
    told = [*map(_panel_in_words, panels[:_TOLD_PANELS]), f"{more} more panel{'s' * (more > 1)}." * (more > 0)]
    return " ".join(filter(None, told))


def _panel_in_words(panel: CurvePanel) -> str:
    """Axes, and the ends of some curves, each with its value."""
    name = f"Panel {panel.title}: " * bool(panel.title)
    ends = (
        f"{one.label} from {one.points[0][3]} at {one.points[0][2]} to {one.points[-1][3]} at {one.points[-1][2]}"
        if len(one.points) > 1
        else f"{one.label} {one.points[0][3]} at {one.points[0][2]}"
        for one in panel.series[:_TOLD_SERIES]
    )
    axes = " against ".join(filter(None, (panel.y, panel.x)))
    return f"{name}{'; '.join(filter(None, [axes, ', '.join(ends)]))}."


def _as_json(curves: Sequence[CurvePanel]) -> str:
    """Curves for the page's script, as an attribute in single quotes; records by the names of their fields."""
    panels = [panel._asdict() | {"series": [one._asdict() for one in panel.series]} for panel in curves]
    text = json.dumps(panels, ensure_ascii=False, separators=(",", ":")) if panels else ""
    return Markup(str(escape(text)).replace("&#34;", '"'))  # noqa: S704 - escaped but for quotation marks


def _marked(text: str, ids: Collection[str]) -> Markup:
    """The text with its marks as elements, all else escaped; what would lead nowhere is no link."""
    known = ((words, "" if kind.startswith("#") and kind[1:] not in ids else kind) for words, kind in spans(text))
    return Markup("").join(_ELEMENTS.get(kind, _LINK).format(words, kind) for words, kind in known)


def _unbroken(text: str) -> str:
    """The text of a number, which may be broken before a bracket but not in it."""
    return _BRACKET.sub(lambda found: found[0].replace(" ", "\N{NO-BREAK SPACE}"), text)


def _file(name: str) -> str:
    return resources.files(__package__ or "").joinpath(name).read_text("utf-8")
