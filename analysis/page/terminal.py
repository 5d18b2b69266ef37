"""Short version of a page in a terminal: the blocks marked as brief, under the titles of their sections."""

from collections.abc import Iterator, Sequence
from io import StringIO

from rich import box
from rich.console import Console, RenderableType
from rich.padding import Padding
from rich.segment import Segment
from rich.table import Table as RichTable
from rich.text import Text

from ...models.errors import printable
from .page import Brief, Cautions, Listing, Note, Page, Section, Table, briefs, spans

_WIDEST = 500  # characters
_WORD = 16  # characters


def show(page: Page, console: Console | None = None) -> None:
    """Prints what is brief; a table that is too wide for the console even so keeps its numbers whole."""
    console = console or Console()
    for one in gist(page):
        if isinstance(one, RichTable):
            _fit(one, console)
        console.print(one, highlight=False, crop=False)


def cut_to(page: Page, console: Console) -> Iterator[RenderableType]:
    """What is brief, for a live view, which ends with the lines of the console: of too wide a table what has room."""
    for one in gist(page):
        if isinstance(one, RichTable):
            number, wide = len(one.columns), console.options.update(width=_WIDEST)
            while len(one.columns) > 1 and console.measure(one, options=wide).minimum > console.width:
                one.columns.pop()
            _fit(one, console)
            if missing := number - len(one.columns):
                one.caption_justify = "left"
                one.caption = f"This terminal is too narrow for {missing} more column{'s' * (missing > 1)}."
        yield one


def _fit(table: RichTable, console: Console) -> None:
    """Narrows a table to the console or, if it has no room there, to its least width; rich narrows it too little."""
    wide = console.options.update(width=_WIDEST)
    needed, wished = console.measure(table, options=wide)
    if wished <= console.width:
        return
    for table.width in range(max(console.width, needed), needed - 1, -1):
        if max(map(Segment.get_line_length, console.render_lines(table, wide, pad=False))) <= console.width:
            return


def as_text(page: Page, width: int) -> str:
    """What is brief as lines of at most so many characters."""
    text = StringIO()
    show(page, Console(file=text, width=width))
    return text.getvalue().rstrip()


def gist(page: Page) -> Iterator[RenderableType]:
    """The brief blocks, for rich."""
    for section in (Section("", page.intro), *page.sections):
        shown = [one for block in briefs(section.blocks) for one in _renderables(block)]
        if shown and section.title:
            yield Text(section.title, style="bold")
        yield from shown


def rich_table(table: Table, columns: Sequence[int] = ()) -> RichTable:
    """A table for rich.

    Args:
        table: What it holds.
        columns: Those that are shown; empty for all.
    """
    shown = RichTable(
        title=_text(table.caption) if table.caption else None,
        title_justify="left",
        box=box.SIMPLE,
        padding=(0, 1, 0, 0),
        show_header=bool(table.head),
    )
    columns = columns or range(max(map(len, (table.head, *table.rows))))
    for column in columns:
        heading = _text(table.head[column].replace(" (", "\n(")) if table.head else ""
        words = column == 0 or column in table.words
        cells = [_text(row[column]).plain for row in table.rows if column < len(row)]
        least = max((_least_width(cell) if words else len(cell) for cell in cells), default=0)
        shown.add_column(heading, justify="left" if words else "right", overflow="fold", min_width=least)
    for row in table.rows:
        shown.add_row(*(_text(row[column]) for column in columns if column < len(row)))
    return shown


def _least_width(words: str) -> int:
    """Width at which no word is broken that has room in a narrow terminal."""
    return max((len(word) for word in words.split() if len(word) <= _WORD), default=0)


def _renderables(brief: Brief) -> Iterator[RenderableType]:
    match brief.block:
        case str(text):
            yield _text(text)
        case Table():
            if brief.block.rows:
                yield rich_table(brief.block, brief.columns)
        case Cautions(sentences):
            yield from (_text(f"Warning: {sentence}") for sentence in sentences)
        case Listing(items, title):
            if title:
                yield _text(f"{title}:{'' if items else ' none.'}")
            yield from (Padding(_text(f"- {item}"), (0, 0, 0, 2 if title else 0), expand=False) for item in items)
        case Note(blocks):
            for block in blocks:
                if isinstance(block, str | Table | Listing | Note | Cautions):
                    yield from _renderables(Brief(block))


def _text(text: str) -> Text:
    """With strong words in bold; of links the words."""
    shown = Text()
    for words, kind in spans(text):
        shown.append("\n".join(map(printable, words.split("\n"))), "bold" if kind == "strong" else "")
    return shown
