"""The report: one self-contained HTML page that a person can mail or print."""

import base64
import json
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from jinja2 import ChainableUndefined, Environment, FunctionLoader

from ...models.storage import complete_file
from .figure_style import PNG_DPI, save
from .numbers import factor, interval, number, percent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_IMAGE_BYTES = 4_000_000  # of all figures together; base64 adds a third


class DrawnPicture(NamedTuple):
    """A figure and what is said of it."""

    name: str
    title: str
    caption: str
    figure: "Figure"


def write_report(folder: str | Path, summary: Mapping[str, Any], figures: Sequence[Mapping[str, Any]]) -> Path:
    """Writes `report.html` into a folder and returns its path.

    Args:
        folder: Where to write; an older report there is replaced.
        summary: What `summary.json` holds. Sections whose keys are missing are left out.
        figures: One mapping per figure with `name`, `title`, `caption` and the files `png` and `svg`.

    Raises:
        InputError: The file cannot be written.
    """
    path = Path(folder) / "report.html"
    page = render_report(summary, figures)
    with complete_file(path, force=True) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path


def render_report(summary: Mapping[str, Any], figures: Sequence[Mapping[str, Any]]) -> str:
    """The page as text, with every figure inside it."""
    return render_page("report.html", summary, figures)


def write_page(
    folder: Path, template: str, summary: Mapping[str, Any], pictures: Iterable[DrawnPicture], name: str
) -> None:
    """Writes figures, what they and the page show as JSON, and the page, into a folder that is complete later.

    Args:
        folder: Where to, see `storage.complete_folder`.
        template: Of the page.
        summary: What it shows.
        pictures: Its figures.
        name: Of the JSON file.
    """
    figures = []
    for picture in pictures:
        png, svg = save(picture.figure, folder, picture.name)
        figures.append(
            {"name": picture.name, "title": picture.title, "caption": picture.caption, "png": png, "svg": svg}
        )
    text = json.dumps(summary, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    (folder / name).write_text(text, encoding="utf-8")
    (folder / "report.html").write_text(render_page(template, summary, figures), encoding="utf-8")


def render_page(template: str, summary: Mapping[str, Any], figures: Sequence[Mapping[str, Any]]) -> str:
    """A page of this package as text.

    Args:
        template: Name of its file.
        summary: What it shows.
        figures: As `write_report`.
    """
    environment = Environment(
        loader=FunctionLoader(_file),
        autoescape=True,
        undefined=ChainableUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        number=lambda value, *digits: number(None if isinstance(value, ChainableUndefined) else value, *digits),
        percent=percent,
        interval=interval,
        factor=factor,
    )
    share = _IMAGE_BYTES // max(1, len(figures))
    images = [
        dict(figure) | {"data": image_uri(figure["png"], figure["svg"], share), "width": page_width(figure["png"])}
        for figure in figures
    ]
    return environment.get_template(template).render(summary=summary, figures=images, style=_file("page.css"))


def _file(name: str) -> str:
    return resources.files(__package__ or "").joinpath(name).read_text("utf-8")


def image_uri(png: Path, svg: Path, limit: int) -> str:
    """A picture as a data URI: the drawing where it is no larger than `limit` bytes, else the smaller of both."""
    chosen = svg if svg.stat().st_size <= limit else min(png, svg, key=lambda path: path.stat().st_size)
    kind = "svg+xml" if chosen == svg else "png"
    return f"data:image/{kind};base64,{base64.b64encode(chosen.read_bytes()).decode('ascii')}"


def page_width(png: Path) -> int:
    """The width of a figure in CSS pixels (96 per inch), from the header of its PNG file."""
    return round(int.from_bytes(png.read_bytes()[16:20], "big") * 96 / PNG_DPI)
