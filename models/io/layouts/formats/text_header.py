"""How a table of text is split into cells, and what its columns are called, from its first rows."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count, islice

import numpy as np

from ....errors import InputError
from .contents import TextTable, name_and_unit
from .text_lines import DELIMITERS, Lines, OpenQuote, TextBlock, before, cut_line, rows, with_one_delimiter

_FIRST = 30  # rows that are looked at
MISSING = ("", "NA", "N/A", "n/a", "NaN", "nan", "null", "None")
_OLD_COMMENT = re.compile(rb'\A(\s*)[#%]+[ \t]*(?=[\w"\[])')
_LOGGED = re.compile(rb"(?m)^\d{1,2}:\d\d:\d\d(\.\d+)? -> ")
"""Begin of a line of a monitor of serial ports, such as Arduino's."""
_CLOCK = re.compile(r"[\d./T+Z-]* ?\d{1,2}:\d\d[\d.:/T+Z-]*")
_THOUSANDS = re.compile("([-+]?[1-9]\\d{0,2})([\u00a0\u2009\u202f'\u2019])(\\d{3}(?:\\2\\d{3})*(?:[.,]\\d*)?)")
"""A number with thousands apart, by a blank that does not break or is thin, or by an apostrophe."""
_ONE_UNIT = (
    r"(?:[nuµμmcdkMG]?(?:s|sec|m|g|N|Nm|V|A|Pa|Hz|bar|rad|Ω|Ohm|F|H|T|W|J|C|K)|min|h|°C?|deg|%|psi|lbf?|inch|counts?"
    r"|LSB|ADC|a\.?u\.?|samples?)(?:\^?-?\d|[²³])?"
)
_UNIT = re.compile(rf"[\[(]?({_ONE_UNIT}(?:[/*·.]{_ONE_UNIT})*|-?)[\])]?")
"""A unit, in brackets or without, or a dash for none."""
_FORMAT = re.compile(r"[DdMmYyHhSsf:./ -]+")
"""Of dates and times."""
_ARROW = ("->",)
_LABELLED = re.compile(r"([^\W\d][^:\"]*?)[ \t]*:[ \t]*(\S+)")
"""A cell of a line for Arduino's plotter, such as `P1:0.5`."""
_STAND_IN = "\x1f"
"""Delimiter in place of those of several signs."""
type Rows = list[tuple[int, list[str]]]


@dataclass(frozen=True)
class TextLayout:
    """Of a table of text.

    Attributes:
        delimiter: One character; a blank for any number of blanks.
        others: Further delimiters, which are read as if they were this one.
        units: Of the columns, from a row below the header; empty without such a row.
        decimal: Decimal mark.
        names: Of the columns, from the header; those of one name are told apart by numbers.
        spare: Number of columns without a name after them, which are empty.
        omitted: Number of last columns whose cells rows may omit where they are empty, as most of the first rows do.
        start: First line below the header.
        numeric: Whether the first rows of each column hold numbers.
    """

    delimiter: str
    decimal: str
    names: tuple[str, ...]
    spare: int
    start: int
    numeric: tuple[bool, ...]
    others: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    omitted: int = 0
    called: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()

    @property
    def least(self) -> int:
        """Number of cells of a row at least."""
        return len(self.names) - self.omitted

    def number(self, cell: str) -> float:
        """Number of a cell; NaN where it is missing.

        Raises:
            ValueError: It is none.
        """
        if cell in MISSING:
            return np.nan
        if "_" in cell:
            raise ValueError
        cell = without_thousands(cell)
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

    def is_no_name(self, cell: str) -> bool:
        """Whether a cell holds a number or a time of day, which are no names of columns."""
        return self.is_number(cell) or _CLOCK.fullmatch(cell) is not None

    def whole(self, line: int, cells: list[str]) -> list[str]:
        """Cells of a row, those that it omits empty.

        Raises:
            InputError: There are too few or too many.
        """
        width = len(self.names)
        if len(cells) < self.least or len(cells) > width + self.spare or any(cells[width:]):
            found = f"{len(cells)} cell{'s' * (len(cells) != 1)}"
            signs = [*([self.delimiter] if self.delimiter != _STAND_IN else []), *self.others]
            split = " and ".join(map(_named, signs))
            raise InputError(f"line {line}: {found}, but there are {width} columns, split at {split}.")
        return [*cells, *[""] * (width - len(cells))]

    def plain(self, block: TextBlock) -> TextBlock:
        """Lines with the one delimiter in place of all, and without the names before numbers."""
        content = with_one_delimiter(block.content, self.others, self.delimiter) if self.others else block.content
        return block._replace(content=self._without_labels(content) if self.labels else content)

    def _without_labels(self, content: bytes) -> bytes:
        """Lines without the names before numbers; one with other names stays as it is."""
        sign = re.escape(self.delimiter.encode())
        cells = [re.escape(label.encode()) + rb"[ \t]*:[ \t]*" if label else b"" for label in self.labels]
        cells = [rb"%s([^\s%s]*)" % (cell, sign) for cell in cells]
        between = rb"[ \t]+" if self.delimiter == " " else rb"[ \t]*%s[ \t]*" % sign
        line = rb"(?m)^[ \t]*%s[ \t]*%s?[ \t]*$" % (between.join(cells), sign)
        return re.sub(line, self.delimiter.encode().join(rb"\g<%d>" % (n + 1) for n in range(len(cells))), content)

    def cut_line(self, block: TextBlock) -> int:
        """Line of a last row that is cut, 0 without, see `text_lines.cut_line`."""
        return cut_line(self.plain(block), self.delimiter, self.least)


def without_thousands(cell: str) -> str:
    r"""A number without the signs between its thousands; another text as it is.

    >>> without_thousands("-1\u00a0030,80"), without_thousands("12'345'678.5"), without_thousands("it's")
    ('-1030,80', '12345678.5', "it's")
    """
    if cell.isascii() and "'" not in cell:
        return cell
    found = _THOUSANDS.fullmatch(cell)
    return cell if found is None else cell.replace(found[2], "")


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
    found = _whole_or_cut(first, how)
    if how.header and any(map(found.is_number, found.names)) and all(map(found.is_no_name, found.names)):
        raise InputError(
            "numbers stand where the header should be; without a header, set header to false (--no-header)."
        )
    return found


def _whole_or_cut(first: TextBlock, how: TextTable) -> TextLayout:
    """Layout of the first lines, or where they end the file without the last one, which may be cut."""
    try:
        return _split(first, how)
    except InputError:
        last = first.line + first.content.count(b"\n") - 1
        if first.ended or last == first.line:
            raise
        try:
            found = _split(before(first, last), how)
        except InputError:
            found = None
        if found is None or not found.cut_line(first):
            raise
        return found


def _split(first: TextBlock, how: TextTable) -> TextLayout:
    if (labelled := _labelled(first, how)) is not None:
        return labelled
    if how.delimiter:
        delimiter, *others = _delimiters(how)
        return _layout(_first_rows(first, delimiter, others), delimiter, how, others)
    if all(map(_LOGGED.match, first.content.split(b"\n", _FIRST)[:-1])):
        return _logged(first, how)
    return _found(first, how)


def _labelled(first: TextBlock, how: TextTable) -> TextLayout | None:
    """Layout of lines whose numbers have the same names before them, as in `P1:0.5,P2:3`; `None` of others."""
    if b":" not in first.content.split(b"\n", 1)[0]:
        return None
    for delimiter, *others in [_delimiters(how)] if how.delimiter else [[sign] for sign in DELIMITERS.values()]:
        try:
            table = _first_rows(first, delimiter, others)
        except InputError:
            continue
        found = TextLayout(delimiter, how.decimal, (), delimiter != " ", table[0][0] if table else 0, (), tuple(others))
        labels = {_labels([*cells[:-1], *filter(None, cells[-1:])], found) for _, cells in table}
        if len(table) > 1 and len(labels) == 1 and (names := labels.pop()):
            return replace(found, names=told_apart(names), called=names, labels=names, numeric=(True,) * len(names))
    return None


def _labels(cells: Sequence[str], layout: TextLayout) -> tuple[str, ...]:
    """Names before the numbers in cells; empty if one is otherwise."""
    found = [match for cell in cells if (match := _LABELLED.fullmatch(cell)) and layout.is_number(match[2])]
    return tuple(match[1] for match in found) if len(found) == len(cells) else ()


def _check(how: TextTable) -> None:
    if how.decimal not in (".", ","):
        raise InputError(f"decimal (--decimal) must be . or a comma, got {how.decimal!r}.")
    for given in _delimiters(how):
        if not given.isascii() or given.isalnum() or set(given) & set('"\r\n'):
            raise InputError(f"delimiter (--delimiter) must be signs, tab or blank, got {how.delimiter!r}.")
        if given == how.decimal:
            raise InputError(f"delimiter (--delimiter) and decimal mark (--decimal) are both {how.decimal!r}.")


def _delimiters(how: TextTable) -> list[str]:
    """The sign that divides cells, and other delimiters that are read as if they were it."""
    told = (how.delimiter,) if isinstance(how.delimiter, str) else how.delimiter or ()
    signs = [DELIMITERS.get(text, text.strip() or " ") for text in told]
    single = " " if " " in signs else next((sign for sign in signs if len(sign) == 1), _STAND_IN)
    return [single, *(sign for sign in signs if sign != single)]


def _logged(first: TextBlock, how: TextTable) -> TextLayout:
    """Layout of a log, whose lines begin with a time and an arrow, with the delimiter or names of what comes after."""
    behind = first._replace(content=_LOGGED.sub(b"", first.content))
    if (labelled := _labelled(behind, how)) is not None:
        names, called, labels = (("time", *labelled.names), ("time", *labelled.called), ("", *labelled.labels))
        kinds = (False, *labelled.numeric)
        return replace(labelled, names=names, called=called, labels=labels, numeric=kinds, others=_ARROW)
    delimiter = _found(behind, how).delimiter
    found = _layout(_first_rows(first, delimiter, _ARROW), delimiter, how, _ARROW)
    named = how.header and "time" not in found.names and not all(map(found.is_no_name, found.names))
    return replace(found, names=("time", *found.names[1:])) if named else found


def _first_rows(first: TextBlock, delimiter: str, others: Sequence[str] = ()) -> Rows:
    """Up to 30 rows, without a last one whose quoted cell goes on in the next block."""
    found: Rows = []
    if others:
        first = first._replace(content=with_one_delimiter(first.content, others, delimiter))
    try:
        found.extend(islice(rows(first, delimiter), _FIRST + 1))
    except OpenQuote:
        if len(found) <= 1:
            raise
    return found


def _found(first: TextBlock, how: TextTable) -> TextLayout:
    """Layout with the one delimiter that splits all first rows alike."""
    fits, short, whys, single = {}, {}, [], True
    for name, delimiter in DELIMITERS.items():
        if delimiter == how.decimal:
            continue
        table: Rows = []
        try:
            table = _first_rows(first, delimiter)
            layout = _layout(table, delimiter, how)
            for line, cells in table:
                layout.whole(line, cells)
        except InputError as error:
            whys.append(str(error))
        else:
            if len(table[0][1]) > 1:
                (short if layout.omitted else fits)[name] = layout
        single &= len(table) > 0 and (
            _holds_texts(table, how) if name == "blank" else all(len(cells) == 1 for _, cells in table)
        )
    if len(fits) > 1:
        fits.pop("blank", None)
    fits = fits or short
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


def _layout(table: Rows, delimiter: str, how: TextTable, others: Sequence[str] = ()) -> TextLayout:
    if len(table) <= how.header:
        raise InputError("there are no rows below the header." if table else "there are no rows.")
    header, below = table[0][1], table[how.header :]
    width = len(header)
    if how.header:
        while width > 1 and not header[width - 1]:
            width -= 1
    elif width > 1 and all(len(cells) == width and not cells[-1] for _, cells in below):
        width -= 1
    called = tuple((header[i] if how.header else "") or str(i) for i in range(width))
    names = told_apart(called)
    spare = 0 if delimiter == " " else max(1, len(header) - width)
    layout = TextLayout(delimiter, how.decimal, names, spare, below[0][0], (), tuple(others), called=called)
    layout = replace(layout, omitted=_omitted([cells for _, cells in below], layout))
    below = [(line, [*cells, *[""] * (width - max(len(cells), layout.least))]) for line, cells in below]
    if how.header and (units := _units([cells for _, cells in below], layout)):
        below = below[1:]
        layout = replace(layout, start=below[0][0], units=units)
    numeric = (all(layout.is_number(cell) for _, cells in below for cell in cells[i : i + 1]) for i in range(width))
    return replace(layout, numeric=tuple(numeric))


def told_apart(names: Sequence[str]) -> tuple[str, ...]:
    """Names of columns, numbered from 0 where several have one name, before their unit.

    >>> told_apart(["t", "Force [N]", "Force [N]", "a", "a", "a.1"])
    ('t', 'Force.0 [N]', 'Force.1 [N]', 'a.0', 'a.2', 'a.1')
    """
    times, known, found = Counter(names), set(names), list[str]()
    for name in names:
        if times[name] > 1:
            bare = name_and_unit(name)[0]
            numbered = (f"{bare}.{n}{name[len(bare) :]}" for n in count())
            found.append(next(each for each in numbered if each not in known))
            known.add(found[-1])
        else:
            found.append(name)
    return tuple(found)


def _omitted(below: Sequence[Sequence[str]], layout: TextLayout) -> int:
    """Number of last columns whose cells most rows omit, as LabVIEW does with those of comments.

    It is none where a row of numbers is not the first: names of columns may be longer lines before the table.
    """
    least, rows = Counter(map(len, below)).most_common(1)[0]
    numbers = any(cell and layout.is_number(cell) for cell in below[0])
    sure = numbers and layout.delimiter != " " and 2 * rows > len(below) > 1
    return max(0, len(layout.names) - least) if sure and least > 1 else 0


def _units(below: Sequence[Sequence[str]], layout: TextLayout) -> tuple[str, ...]:
    """Units of the columns from the first row below the header; empty where that surely holds nothing else.

    Those of all columns of numbers, and beside them no texts but formats of dates and times.
    """
    either = [replace(layout, decimal=decimal) for decimal in ".,"]
    width = len(layout.names)
    below = below[:-1] if below and len(below[-1]) < width else below  # it may be cut
    if min(width, len(below)) < 2 or any(len(cells) < width for cells in below):
        return ()
    first, rest = below[0][:width], [cells[:width] for cells in below[1:]]
    units = [_UNIT.fullmatch(cell) or _FORMAT.fullmatch(cell) for cell in first]
    columns = zip(*rest, strict=True)
    numeric = [all(any(each.is_number(cell) for each in either) for cell in column) for column in columns]
    found = tuple(unit[1].strip("-") if unit and unit.re is _UNIT else "" for unit in units)
    if not all(units) or not any(unit for unit, numbers in zip(found, numeric, strict=True) if numbers):
        return ()
    certain = all(unit.re is _UNIT for unit, numbers in zip(units, numeric, strict=True) if numbers and unit)
    return found if certain else ()


def _named(delimiter: str) -> str:
    return {",": "commas", ";": "semicolons", "\t": "tabs", " ": "blanks"}.get(delimiter, repr(delimiter))
