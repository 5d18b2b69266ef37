"""How a table of text is split into cells, and what its columns are called, from its first rows."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ....errors import InputError
from .contents import TextTable
from .text_lines import DELIMITERS, Lines, OpenQuote, TextBlock, rows

_FIRST = 30  # rows that are looked at
MISSING = ("", "NA", "N/A", "n/a", "NaN", "nan", "null", "None")
_OLD_COMMENT = re.compile(rb'\A(\s*)[#%]+[ \t]*(?=[\w"\[])')
type Rows = list[tuple[int, list[str]]]


@dataclass(frozen=True)
class TextLayout:
    """Of a table of text.

    Attributes:
        delimiter: One character; a blank for any number of blanks.
        decimal: Decimal mark.
        names: Of the columns, from the header.
        spare: Number of columns without a name after them, which are empty.
        start: First line below the header.
        numeric: Whether the first rows of each column hold numbers.
    """

    delimiter: str
    decimal: str
    names: tuple[str, ...]
    spare: int
    start: int
    numeric: tuple[bool, ...]

    def number(self, cell: str) -> float:
        """Number of a cell; NaN where it is missing.

        Raises:
            ValueError: It is none.
        """
        if cell in MISSING:
            return np.nan
        if "_" in cell:
            raise ValueError
        if self.decimal != ".":
            if "." in cell:
                raise ValueError
            cell = cell.replace(self.decimal, ".")
        return float(cell)

    def is_number(self, cell: str) -> bool:
        """Whether a cell holds a number or none is there."""
        try:
            self.number(cell)
        except ValueError:
            return False
        return True

    def check_width(self, line: int, cells: Sequence[str]) -> None:
        """Checks the number of cells of a row.

        Raises:
            InputError: There are too few or too many.
        """
        width = len(self.names)
        if len(cells) < width or len(cells) > width + self.spare or any(cells[width:]):
            found = f"{len(cells)} cell{'s' * (len(cells) != 1)}"
            raise InputError(f"line {line}: {found}, but there are {width} columns, split at {_named(self.delimiter)}.")


def layout_of(lines: Lines, how: TextTable) -> TextLayout:
    """How a table is split, where that is not given, and the names of its columns.

    Raises:
        InputError: It has no rows, or its delimiter is not clear.
    """
    _check(how)
    first = next(iter(lines), None)
    if first is None:
        raise InputError(f"there are no lines{f' after the {how.skip_rows} skipped ones' if how.skip_rows else ''}.")
    if how.header:
        first = first._replace(content=_OLD_COMMENT.sub(rb"\1", first.content))
    if how.delimiter:
        delimiter = DELIMITERS.get(how.delimiter, how.delimiter)
        found = _layout(_first_rows(first, delimiter), delimiter, how)
    else:
        found = _found(first, how)
    if how.header and all(found.is_number(name) for name in found.names):
        raise InputError(
            "numbers stand where the header should be; without a header, set header to false (--no-header)."
        )
    return found


def _check(how: TextTable) -> None:
    if how.decimal not in (".", ","):
        raise InputError(f"decimal (--decimal) must be . or a comma, got {how.decimal!r}.")
    given = DELIMITERS.get(how.delimiter or ",", how.delimiter or ",")
    if len(given) != 1 or not given.isascii() or given.isalnum() or given in '"\r\n':
        raise InputError(f"delimiter (--delimiter) must be one sign, tab or blank, got {how.delimiter!r}.")
    if how.delimiter == how.decimal:
        raise InputError(f"delimiter (--delimiter) and decimal mark (--decimal) are both {how.decimal!r}.")


def _first_rows(first: TextBlock, delimiter: str) -> Rows:
    """Up to 30 rows, without a last one whose quoted cell goes on in the next block."""
    found: Rows = []
    try:
        found.extend(islice(rows(first, delimiter), _FIRST + 1))
    except OpenQuote:
        if len(found) <= 1:
            raise
    return found


def _found(first: TextBlock, how: TextTable) -> TextLayout:
    """Layout with the one delimiter that splits all first rows alike."""
    fits, whys, single = {}, [], True
    for name, delimiter in DELIMITERS.items():
        if delimiter == how.decimal:
            continue
        table: Rows = []
        try:
            table = _first_rows(first, delimiter)
            layout = _layout(table, delimiter, how)
            for line, cells in table:
                layout.check_width(line, cells)
        except InputError as error:
            whys.append(str(error))
        else:
            if len(table[0][1]) > 1:
                fits[name] = layout
        single &= len(table) > 0 and (
            _holds_texts(table, how) if name == "blank" else all(len(cells) == 1 for _, cells in table)
        )
    if len(fits) > 1:
        fits.pop("blank", None)
    if len(fits) == 1:
        return fits.popitem()[1]
    if fits:
        raise InputError(f"{' and '.join(fits)} may be the delimiter; say which by --delimiter.")
    if single:
        delimiter = ";" if how.decimal == "," else ","
        return _layout(_first_rows(first, delimiter), delimiter, how)
    if len(set(whys)) == 1 < len(whys):
        raise InputError(whys[0])
    raise InputError(
        "none of , ; tab | blank splits the first rows into as many cells as the header; give --delimiter, or "
        f"--skip-rows or --comment for lines before it ({max(whys, key=_line, default='')[:-1]})."
    )


def _holds_texts(table: Rows, how: TextTable) -> bool:
    """Whether rows split at blanks may be those of one column: of single cells or of texts, below one word if any."""
    below = [cells for _, cells in table[how.header :]]
    if how.header and len(table[0][1]) > 1:
        return all(len(cells) == 1 for cells in below)
    layout = TextLayout(" ", how.decimal, (), 0, 0, ())
    return all(len(cells) == 1 or not all(map(layout.is_number, cells)) for cells in below)


def _line(why: str) -> int:
    """Line that a message begins with."""
    found = re.match(r"line (\d+)", why)
    return int(found[1]) if found else 0


def _layout(table: Rows, delimiter: str, how: TextTable) -> TextLayout:
    if len(table) <= how.header:
        raise InputError("there are no rows below the header." if table else "there are no rows.")
    header, below = table[0][1], table[how.header :]
    width = len(header)
    if how.header:
        while width > 1 and not header[width - 1]:
            width -= 1
    elif width > 1 and all(len(cells) == width and not cells[-1] for _, cells in below):
        width -= 1
    names = tuple((header[i] if how.header else "") or str(i) for i in range(width))
    spare = 0 if delimiter == " " else max(1, len(header) - width)
    layout = TextLayout(delimiter, how.decimal, names, spare, below[0][0], ())
    numeric = (all(layout.is_number(cell) for _, cells in below for cell in cells[i : i + 1]) for i in range(width))
    return replace(layout, numeric=tuple(numeric))


def _named(delimiter: str) -> str:
    return {",": "commas", ";": "semicolons", "\t": "tabs", " ": "blanks"}.get(delimiter, repr(delimiter))
