"""Content of a page: sections of text, tables and figures; `html` writes it, `terminal` prints a short version.

Text may hold `**strong**` words, `` `code` `` and links to sections, `[words](#id)`.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from .figure_sizes import for_all_widths

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MARKS = re.compile(r"\*\*(?P<strong>[^*]+)\*\*|`(?P<code>[^`]+)`|\[(?P<words>[^\]]+)\]\((?P<link>#[\w-]+)\)")


class Table(NamedTuple):
    """A table; one without rows is not shown.

    Attributes:
        head: Headings of the columns; empty for a list of names and values.
        rows: Cells, the first of each row naming it; the last of a short row spans what is left.
        caption: Above it.
        words: Columns of prose, which may be broken into lines; all but these and the first hold numbers.
        dense: Whether it is set small.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    words: Collection[int] = ()
    dense: bool = False


class Picture(NamedTuple):
    """A figure with its title and caption.

    Attributes:
        name: Of its files.
        title: Its name on the page.
        caption: What is to be seen.
        draw: Draws it; `None` where there is nothing to draw, which leaves it out.
        curves: Whether the page tells the values of its curves and can switch them off, see `figure_curves`.
        narrow: Whether it is drawn a second time for narrow windows, without curves that are told.
    """

    name: str
    title: str
    caption: str
    draw: "Callable[[], Figure | None]"
    curves: bool = False
    narrow: bool = False

    @property
    def narrow_draws(self) -> "list[Callable[[], Figure | None]]":
        """What draws it for narrow windows, if anything does."""
        return for_all_widths(self.draw, self.narrow)[1:]


class Listing(NamedTuple):
    """Items below each other; none is shown by its title alone, or not at all."""

    items: Sequence[str]
    title: str = ""


class Verbatim(NamedTuple):
    """Text as it is, such as a command line; an empty one is not shown."""

    text: str


class Embedded(NamedTuple):
    """HTML of this project as it is, for the page alone.

    Attributes:
        html: The HTML.
        caption: What is to be seen.
    """

    html: str
    caption: str


class Note(NamedTuple):
    """Blocks that stand out."""

    blocks: "Sequence[Block]"


class SideBySide(NamedTuple):
    """Blocks that stand beside each other where there is room."""

    blocks: "Sequence[Block]"


class Cautions(NamedTuple):
    """Warnings that affect the numbers; nothing without a sentence."""

    sentences: Sequence[str]


class Terms(NamedTuple):
    """Terms and what they mean."""

    meanings: Mapping[str, str]


class Section(NamedTuple):
    """Blocks under a heading; one without any is left out.

    Attributes:
        title: The heading.
        blocks: What is under it.
        id: That links name, unique on the page; sections of a page are in the navigation by it.
        folded: Whether the heading has to be opened first; links and printing do so.
    """

    title: str
    blocks: "Sequence[Block]"
    id: str = ""
    folded: bool = False


class Brief(NamedTuple):
    """A block that a terminal shows as well, of a table these columns or all."""

    block: "str | Table | Listing | Note | Cautions"
    columns: Sequence[int] = ()


type Row = Mapping[str, Any]
"""Names and values of a summary, as its JSON file holds them."""
type Block = (
    str | Table | Picture | Listing | Verbatim | Note | SideBySide | Cautions | Terms | Embedded | Section | Brief
)


_GROUPS = Section, Note, SideBySide


class Page(NamedTuple):
    """A title, blocks before the first section, and the sections."""

    title: str
    intro: Sequence[Block]
    sections: Sequence[Section]

    @property
    def pictures(self) -> list[Picture]:
        """All figures in their order."""
        return [block for block in blocks_of([*self.intro, *self.sections]) if isinstance(block, Picture)]

    def filled(self, pictures: Collection[str] = ()) -> "Page":
        """What shows something, of figures those of these names, so that every section has a content."""
        sections = [block for block in filled(self.sections, pictures) if isinstance(block, Section)]
        return self._replace(intro=filled(self.intro, pictures), sections=sections)


def blocks_of(blocks: Iterable[Block]) -> Iterator[Block]:
    """All blocks in their order, those of the sections among them, too."""
    for block in blocks:
        yield block
        if isinstance(block, _GROUPS):
            yield from blocks_of(block.blocks)


def filled(blocks: Iterable[Block], pictures: Collection[str]) -> list[Block]:
    """Blocks that show something, with what does so in them; of figures those of these names."""
    kept = (
        block._replace(blocks=filled(block.blocks, pictures)) if isinstance(block, _GROUPS) else block
        for block in blocks
    )
    return [block for block in kept if _shows(block, pictures)]


def _shows(block: Block, pictures: Collection[str]) -> bool:
    match block:
        case Brief(shown):
            return bool(filled([shown], pictures))
        case Picture(name):
            return name in pictures
        case Listing(items, title):
            return bool(items or title)
        case Table(rows=content) | Section(blocks=content) | Note(content) | SideBySide(content):
            return bool(content)
        case str(content) | Verbatim(content) | Cautions(content) | Terms(content) | Embedded(content):
            return bool(content)


def briefs(blocks: Iterable[Block]) -> Iterator[Brief]:
    """Those that a terminal shows."""
    return (block for block in blocks_of(blocks) if isinstance(block, Brief))


def brief(page: Page) -> Page:
    """What a terminal shows of a page, and the sections that hold some of it."""
    sections = (section._replace(blocks=[*briefs(section.blocks)]) for section in page.sections)
    return Page(page.title, [*briefs(page.intro)], [section for section in sections if section.blocks])


def spans(text: str) -> Iterator[tuple[str, str]]:
    """Parts of a text, each with `""`, `"strong"`, `"code"` or the `#id` that it leads to.

    >>> list(spans("See `fit` and [the rules](#rules), **surely** [0.1, 0.2]."))[:4]
    [('See ', ''), ('fit', 'code'), (' and ', ''), ('the rules', '#rules')]
    """
    end = 0
    for found in _MARKS.finditer(text):
        yield text[end : found.start()], ""
        kind = str(found.lastgroup)
        yield (found["words"], found["link"]) if kind == "link" else (found[kind], kind)
        end = found.end()
    yield text[end:], ""
