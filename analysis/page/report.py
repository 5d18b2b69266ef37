"""Report of a study: its page, numbers and figures, printed or saved in a folder."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ...models.errors import InputError
from ...models.progress import Progress, no_progress
from ...models.storage import complete_folder
from .ahead import draw_ahead
from .figure_sizes import StyleName, drawn_as, is_drawn_for_pages
from .html import draw_pictures, render_brief, write_page
from .page import Page, Picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure
from typing import TypedDict


class GridRecord(TypedDict):
    """Numbers of position and object classes."""

    L: int
    M: int


class UnitsRecord(TypedDict):
    """Units of errors."""

    what: str
    where: str


class TitleRecord(TypedDict):
    """Title and command."""

    title: str
    command: str


_WIDTH = 110  # characters


class Report(ABC):
    """Results as a page: `print` shows a short version, a notebook adds the tables."""

    @cached_property
    def page(self) -> Page:
        """The whole page."""
        return self._page()

    @abstractmethod
    def _page(self) -> Page: ...

    @cached_property
    def pictures(self) -> Sequence[Picture]:
        """The page's figures."""
        return self.page.pictures

    @property
    def figures(self) -> dict[str, str]:
        """Names of the page's figures, each with its title."""
        return {picture.name: picture.title for picture in self.pictures}

    def plot(
        self, name: str, figure: "Figure | SubFigure | None" = None, style: StyleName = "page"
    ) -> "Figure | SubFigure":
        """Draws one of the page's figures.

        Args:
            name: One of `figures`.
            figure: Where to draw, such as part of a figure of your own; `None` for a new figure.
            style: Sizes of a new figure: `page`, `paper` (88 mm or, of figures that need it, 180 mm wide, with type of
                7 points) or `talk` (16:9, with large type).

        Returns:
            The figure; its panels are `figure.axes`.

        Raises:
            InputError: There is no such figure or style.
        """
        pictures = {picture.name: picture for picture in self.pictures}
        if name not in pictures:
            known = ", ".join(pictures) or "none"
            raise InputError(f"The report has no figure {name!r}; its figures are {known}.")
        with drawn_as(style, figure):
            drawn = pictures[name].draw()
        if drawn is None:
            raise InputError(f"The figure {name!r} is empty.")
        return drawn

    def __repr__(self) -> str:
        from .terminal import as_text  # noqa: PLC0415 - a page is written without it

        return as_text(self.page, _WIDTH)

    def _repr_html_(self) -> str:
        return render_brief(self.page)


class StudyReport(Report):
    """The report of a study, which also has a summary and can be saved as a folder.

    Attributes:
        summary: Numbers and sentences of the page, as a JSON file of the folder holds them.
        SUMMARY: Name of that file.
    """

    SUMMARY: ClassVar[str] = "summary.json"

    summary: Any

    def save(
        self,
        folder: str | Path,
        force: bool = False,
        progress: Progress = no_progress,
        style: StyleName = "page",
    ) -> None:
        """Writes the page as `report.html`, the summary, the figures and further files, all or none.

        Args:
            folder: Where to.
            force: Whether files in an existing folder may be replaced.
            progress: Called with the name and size of the stage; returns the function that advances it.
            style: Sizes of the figures, see `plot`.

        Raises:
            InputError: The folder cannot be written, or there is no such style.
        """
        with drawn_as(style), complete_folder(folder, force) as temporary:
            if is_drawn_for_pages():
                draw_ahead(draw for one in self.pictures for draw in (one.draw, *one.narrow_draws))
            self._write_more(temporary)
            page = self.page
            images = draw_pictures(temporary, page.pictures, progress("Drawing figures", len(page.pictures)))
            write_page(temporary, page, self.summary, self.SUMMARY, images)

    def _write_more(self, folder: Path) -> None:
        """Writes what else belongs into the folder."""
