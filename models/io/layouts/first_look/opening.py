"""Opens a file of a recording and finds how its table is written: with a header or without, below which lines."""

import re
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ....errors import InputError
from ..formats.contents import Contents
from ..formats.registry import ENDINGS, ending, open_contents
from ..formats.text import TextContents
from ..mapping import TapMap
from .beside import is_row
from .guess import Guess

BLOCKS = 4
"""Blocks of a table or of messages that are read for it."""
_BEGIN, _MOST_SKIPPED = 1 << 14, 60
_GERMAN = re.compile(r"-?(\d+|\d{1,3}(\.\d{3})+),\d+")
"""A number with a decimal comma."""
_MOST_CELLS = 40


def opened(path: Path, how: TapMap, guesses: list[Guess]) -> tuple[TapMap, Contents]:
    """A file, and the map that opens it, with guesses of how a table is written.

    A first row of numbers is no header, and lines before a table have other cells.

    Raises:
        InputError: It cannot be opened.
    """
    try:
        contents = open_contents(path, how.text_table, how.format, BLOCKS)
    except InputError:
        found = _opened_below(path, how)
        if found is None:
            raise
        written, contents = found
    else:
        written = how
        if isinstance(contents, TextContents) and how.header and is_row(contents):
            written = how.changed(header=False)
            contents = open_contents(path, written.text_table, how.format, BLOCKS)
    reasons = {"comment": "lines before the table", "skip_rows": "lines before the table"}
    reasons |= {"decimal": "decimal commas", "header": "numbers in the first row"}
    changed = [key for key in reasons if getattr(written, key) != getattr(how, key)]
    guesses += [Guess(key, getattr(written, key), reasons[key]) for key in changed]
    return written, contents


def _opened_below(path: Path, how: TapMap) -> tuple[TapMap, Contents] | None:
    """A table of text below other lines or without a header, with a column of numbers; `None` where there is none."""
    if (how.format or ENDINGS.get(ending(path.name))) != "text" or how.skip_rows:
        return None
    try:
        begin = path.read_bytes()[:_BEGIN].lstrip()
    except OSError:
        return None
    mark = next((mark for mark in ("#", "%", "//", ";") if begin.startswith(mark.encode())), None)
    most = min(_MOST_SKIPPED, begin.count(b"\n") // 2)  # else the last rows of a table that is broken before them
    starts = [{"skip_rows": n} for n in range(most + 1)]
    for start in [{"comment": mark}, *starts] if mark and not how.comment else starts:
        for decimal, header in product({how.decimal: None, ",": None}, (True, False)):
            written = how.changed(**start, decimal=decimal, header=header)
            try:
                contents = open_contents(path, written.text_table, how.format, BLOCKS)
            except InputError:
                continue
            kinds = [of.dtype.kind for of in contents.variables.values()]
            if is_row(contents) if header else any(kind != "f" for kind in kinds[1:]):
                continue
            if "f" in kinds and (len(kinds) > 1 or not start.get("skip_rows")):
                return written, contents
    return None


def with_comma(values: Mapping[str, NDArray[Any]], how: TapMap) -> Guess | None:
    """Whether columns hold numbers with a decimal comma."""
    if how.decimal != ".":
        return None
    texts = [of for of in values.values() if of.dtype.kind == "U" and of.ndim == 1 and of.size]
    found = [of for of in texts if all(map(_GERMAN.fullmatch, of[:_MOST_CELLS].tolist()))]
    return Guess("decimal", ",", f"numbers such as {found[0][0]}") if found else None
