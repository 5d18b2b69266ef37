"""Content of a page: sections of text, tables and figures; `html` writes it, `terminal` prints a short version.

Text may hold `**strong**` words, `` `code` `` and links to sections, `[words](#id)`.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

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
    """

    name: str
    title: str
    caption: str
    draw: "Callable[[], Figure | None]"


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


class Cautions(NamedTuple):
    """Warnings that affect the numbers; nothing without a sentence."""

    sentences: Sequence[str]


class Folded(NamedTuple):
    """Terms and what they mean, behind a title that opens them."""

    title: str
    terms: Sequence[Mapping[str, str]]


class Section(NamedTuple):
    """Blocks under a heading, in the navigation by its id; sections within have none."""

    title: str
    blocks: "Sequence[Block]"
    id: str = ""


class Brief(NamedTuple):
    """A block that a terminal shows as well, of a table these columns or all."""

    block: "str | Table | Listing | Note | Cautions"
    columns: Sequence[int] = ()


type Row = Mapping[str, Any]
"""Names and values of a summary, as its JSON file holds them."""
type Block = str | Table | Picture | Embedded | Listing | Verbatim | Note | Cautions | Folded | Section | Brief


class Page(NamedTuple):
    """A title, blocks before the first section, and the sections."""

    title: str
    intro: Sequence[Block]
    sections: Sequence[Section]

    @property
    def pictures(self) -> list[Picture]:
        """All figures in their order."""
        return [block for block in blocks_of([*self.intro, *self.sections]) if isinstance(block, Picture)]


def blocks_of(blocks: Iterable[Block]) -> Iterator[Block]:
    """All blocks in their order, those of the sections among them, too."""
    for block in blocks:
        yield block
        if isinstance(block, Section):
            yield from blocks_of(block.blocks)


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
