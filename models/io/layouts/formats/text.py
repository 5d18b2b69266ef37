"""Tables of text: CSV, TSV and others, with a delimiter, decimal mark and encoding of their own."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any, override

import numpy as np
from numpy.typing import NDArray

from ....errors import InputError
from .columns import Part, gathered
from .contents import Contents, TextTable, Values, Variable, name_and_unit
from .text_header import MISSING, TextLayout, layout_of, without_thousands
from .text_lines import BLOCK, Lines, TextBlock, before, rows, whole_rows

_END, _TAB, _QUOTE = b'\n\t"'
_SHOWN = 40
_MOST_ODD = 10_000
_TRUTHS = (b"rue", b"RUE", b"alse", b"ALSE")  # pandas takes columns of them for numbers


def open_text(path: Path, how: TextTable) -> Contents:
    """A table of text in UTF-8, in UTF-16 with a byte order mark, or else in that of Windows (Latin-1).

    Raises:
        InputError: It is no such table, or how it is split is not clear; the message names the option that tells.
    """
    return TextContents(path, how)


class TextContents(Contents):
    """Columns of a table of text; whether they hold numbers is told by the first rows.

    Args:
        path: The file.
        how: How it is written.
        size: Bytes that are read at a time.
    """

    table = True

    def __init__(self, path: Path, how: TextTable, size: int = BLOCK) -> None:
        self.path, self.unreadable, self.attributes = path, {}, {}
        self._layout = layout_of(Lines(path, how.skip_rows, how.comment), how)
        self._lines = Lines(path, self._layout.start - 1, how.comment, size)
        kinds = (np.dtype(np.float64 if numeric else np.str_) for numeric in self._layout.numeric)
        units = self._layout.units or [""] * len(self._layout.names)
        columns = zip(self._layout.names, kinds, units, strict=True)
        if self._layout.omitted:
            last = list(self._layout.names[self._layout.least :])
            what = f"column {last[0]}, which is" if len(last) == 1 else f"columns {', '.join(last)}, which are"
            self.told = (f"Rows end before {what} read as missing.",)
        self.variables = {name: Variable((None,), kind, name_and_unit(name)[1] or unit) for name, kind, unit in columns}

    @property
    @override
    def repeated(self) -> Sequence[str]:
        pairs = zip(self._layout.called, self._layout.names, strict=False)
        return list(dict.fromkeys(called for called, name in pairs if called != name))

    @override
    def named(self, name: str) -> str:
        if name not in self.variables:
            pairs = [*zip(self._layout.called, self._layout.names, strict=False)]
            pairs = [(called, full) for called, full in pairs if called != full]
            several = [full for called, full in pairs if name in (called, name_and_unit(called)[0])]
            if several:
                raise InputError(f"column {name} is repeated; say which: {', '.join(several[:_SHOWN])}.")
        return super().named(name)

    @override
    def read(self, names: Sequence[str], columns: Sequence[str] = ()) -> tuple[dict[str, Values], NDArray[Any] | None]:
        texts, numbers = self._places(names), self._places(columns)

        def parts() -> Iterator[Part]:
            for block in self._blocks():
                part = _quickly(block, self._layout, texts, numbers)
                yield _exactly(block, self._layout, texts, numbers) if part is None else part

        return gathered(parts, list(names), len(columns), self.most)

    @override
    def place(self, row: int) -> str:
        for block in self._blocks():
            length = _length(block.content, self._layout) if len(self.variables) > 1 else None  # as it counts blanks
            if length is None or row < length:
                lines = [line for line, _ in rows(block, self._layout.delimiter)]
                if row < len(lines):
                    return f"line {lines[row]}"
                length = len(lines)
            row -= length
        raise IndexError(row)

    def _blocks(self) -> Iterator[TextBlock]:
        layout = self._layout
        for block in whole_rows(map(layout.plain, self._lines), layout.delimiter):
            cut = 0 if block.ended or not self.without_cut else layout.cut_line(block)
            if cut:
                self.damage = f"line {cut} left out: the file ends within it."
            yield before(block, cut) if cut else block

    def _places(self, names: Iterable[str]) -> list[int]:
        """Numbers of columns."""
        return [self._layout.names.index(self.named(name)) for name in names]


def _quickly(block: TextBlock, layout: TextLayout, texts: list[int], numbers: list[int]) -> Part | None:
    """Rows as pandas reads them; `None` where it may read something else, or a cell is not a number."""
    import pandas as pd  # noqa: PLC0415

    length = _length(block.content, layout)
    if not length or set(texts) & set(numbers) or any(truth in block.content for truth in _TRUTHS):
        return None
    width, used = range(len(layout.names)), sorted({*texts, *numbers})
    kinds: Any = {i: "float64" if i in numbers else "object" for i in used}
    how: dict[str, Any] = {"sep": r"\s+" if layout.delimiter == " " else layout.delimiter, "decimal": layout.decimal}
    how |= {"keep_default_na": False, "na_values": {i: list(MISSING) for i in numbers}, "low_memory": False}
    try:
        frame = pd.read_csv(
            BytesIO(block.content), header=None, names=width, usecols=used, dtype=kinds, index_col=False, **how
        )
    except (ValueError, IndexError):
        return None
    if len(frame) != length:
        return None
    words = [np.array(list(map(str.strip, frame[i])), np.str_) for i in texts]
    words = [_with_points(of, layout, i, block) for of, i in zip(words, texts, strict=True)]
    return Part(words, frame[numbers].to_numpy(np.float64))


def _length(content: bytes, layout: TextLayout) -> int | None:
    """Number of rows that surely are whole; `None` where that takes a closer look."""
    signs = np.frombuffer(content, np.uint8)
    ends, delimiters = signs == _END, signs == ord(layout.delimiter)
    width, least = len(layout.names), layout.least
    if layout.delimiter == " ":
        blank = delimiters | (signs == _TAB) | ends
        delimiters = ~blank & np.concatenate(([True], blank[:-1]))  # where cells begin
        width, least = width + 1, least + 1
        if b'"' in content:
            return None
    elif layout.delimiter == "\t" and b" \t" in content:  # pandas would take both for blanks
        return None
    if b'"' in content:
        quotes = np.flatnonzero(signs == _QUOTE)
        around = np.frombuffer(b"\n" + content + b"\n", np.uint8)[
            np.where(np.arange(len(quotes)) % 2, quotes + 2, quotes)
        ]
        if len(layout.names) == 1 or not np.isin(around, [ord(layout.delimiter), _END, _QUOTE]).all():
            return None
        inside = np.add.accumulate(signs == _QUOTE, dtype=np.uint8) % 2 == 1
        ends &= ~inside
        delimiters &= ~inside
    end = np.flatnonzero(ends)
    found = np.diff(np.searchsorted(np.flatnonzero(delimiters), end), prepend=0)
    whole = (found >= least - 1) & (found <= width - 1)
    if layout.delimiter != " ":
        whole |= (found == width) & delimiters[end - 1]  # with one at the end of the row
    odd = np.flatnonzero(~whole)
    if len(odd) > _MOST_ODD or any(content[end[i - 1] + 1 if i else 0 : end[i]].strip() for i in odd):
        return None
    return len(end) - len(odd)


def _exactly(block: TextBlock, layout: TextLayout, texts: list[int], numbers: list[int]) -> Part:
    """Rows cell by cell.

    Raises:
        InputError: One has too many or too few cells, or a cell is not a number; the message names the line.
    """
    read, words = [], []
    for line, there in rows(block, layout.delimiter):
        cells = layout.whole(line, there)
        words.append([cells[i] for i in texts])
        try:
            read.append([layout.number(cells[i]) for i in numbers])
        except ValueError:
            raise _not_a_number(line, cells, layout, numbers) from None
    table = np.array(read, np.float64).reshape(len(read), len(numbers))
    columns = (np.array([row[j] for row in words], np.str_) for j in range(len(texts)))
    return Part([_with_points(of, layout, i, block) for of, i in zip(columns, texts, strict=True)], table)


def _with_points(words: NDArray[np.str_], layout: TextLayout, column: int, block: TextBlock) -> NDArray[np.str_]:
    """Cells of a column of numbers with a decimal point and without signs between thousands, others as they are."""
    if not layout.numeric[column]:
        return words
    if not block.content.isascii() or b"'" in block.content:
        words = np.array(list(map(without_thousands, words.tolist())), np.str_)
    return np.char.replace(words, layout.decimal, ".") if layout.decimal != "." else words


def _not_a_number(line: int, cells: Sequence[str], layout: TextLayout, numbers: Sequence[int]) -> InputError:
    bad = next(i for i in numbers if not layout.is_number(cells[i]))
    where = f"line {line}, column {layout.names[bad]}: {cells[bad][:_SHOWN]!r} is not a number"
    if re.fullmatch(r"[-+]?\d{1,3}(\.\d{3})+", cells[bad]) and layout.decimal == ",":
        return InputError(f"{where}; write thousands without points.")
    if line == layout.start and not any(layout.is_number(cells[i]) for i in numbers):
        return InputError(
            f"{where}; if this line is no row of data, --skip-rows {line} --no-header reads those below it, with "
            "columns called by their numbers from 0."
        )
    if re.fullmatch(r"[-+]?\d{1,3}( \d{3})+([.,]\d*)?", cells[bad]):
        return InputError(f"{where}; write thousands without blanks.")
    other = "," if layout.decimal == "." else "."
    if replace(layout, decimal=other).is_number(cells[bad]):
        return InputError(f"{where} with decimal mark {layout.decimal!r}; --decimal changes it.")
    return InputError(f"{where}.")
