"""Pages of the documentation that benchmarks fill: tables, numbers with intervals, marked blocks, figures."""

import re
import shutil
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import binomtest, t
from solidtouch.analysis.page.figure_style import save
from solidtouch.models.storage import complete_file

from benchmarks.study import OUT

_CODE_OR_MINUS = re.compile(r"(?P<code>```.*?```|`[^`\n]*`)|(?<=[ \[(*])-(?=\.?\d)", re.DOTALL)


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *lines))


def mean_interval(values: ArrayLike, digits: int = 2) -> str:
    """A mean with its 95% t-interval, `-` for less than two values."""
    values = np.asarray(values, dtype=np.float64)
    if len(values) < 2:
        return "-"
    half = t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    low, high = values.mean() - half, values.mean() + half
    return f"{values.mean():z.{digits}f} [{low:z.{digits}f}, {high:z.{digits}f}]"


def share_interval(hits: int, n: int) -> str:
    """A proportion with its 95% Wilson interval."""
    interval = binomtest(hits, n).proportion_ci(method="wilson")
    return f"{hits / n:.3f} [{interval.low:.3f}, {interval.high:.3f}]"


def parsed(parser: ArgumentParser, *blocks: str) -> Namespace:
    """The options of a study, with `--document`, a page to update that has a place for each of its blocks."""
    parser.add_argument("--document", type=Path, help="page to update")
    options = parser.parse_args()
    check_block(options.document, *blocks)
    return options


def check_block(document: Path | None, *names: str) -> None:
    """Checks that a page has a place for each block, before hours are spent on their content.

    Raises:
        ValueError: A block has no place.
    """
    page = "" if document is None else document.read_text(encoding="utf-8")
    for name in names if document is not None else ():
        if not _place(name).search(page):
            raise ValueError(f"{document} has no lines <!-- begin {name} --> and <!-- end {name} -->.")


def write_block(document: Path | None, name: str, text: str) -> None:
    """Replaces what stands between the lines `<!-- begin NAME -->` and `<!-- end NAME -->` of a page, if there is one.

    Negative numbers outside code get a real minus sign.
    """
    if document is None:
        return
    page = document.read_text(encoding="utf-8")
    text = _CODE_OR_MINUS.sub(lambda found: found["code"] or "−", text)
    page = _place(name).sub(lambda found: f"{found[1]}{text}\n{found[2]}", page)
    with complete_file(document, force=True) as temporary:
        temporary.write_text(page, encoding="utf-8")


def block_of(document: Path | None, name: str) -> str:
    """What a block of a page says; empty without a page."""
    found = None if document is None else _place(name).search(document.read_text(encoding="utf-8"))
    return "" if found is None else found[0].partition("\n")[2].rpartition("\n")[0]


def table_rows(text: str) -> dict[str, list[str]]:
    """Rows of a Markdown table by their first cell, without its head."""
    lines = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in text.splitlines() if line[:1] == "|"]
    return {line[0]: line for line in lines[2:]}


def write_rows(document: Path | None, name: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Writes a table as a block; lines of what these rows do not name in their first cell stay as they are."""
    kept = table_rows(block_of(document, name))
    write_block(document, name, table(head, (kept | {row[0]: list(row) for row in rows}).values()))


def publish(figure: Any, document: Path, name: str) -> None:
    """Writes a figure beside what was measured, and as `images/NAME.svg` beside the page."""
    OUT.mkdir(parents=True, exist_ok=True)
    (picture,) = save(figure, OUT, name)
    images = document.parent / "images"
    images.mkdir(exist_ok=True)
    with complete_file(images / picture.name, force=True) as temporary:
        shutil.copyfile(picture, temporary)


def _place(name: str) -> re.Pattern[str]:
    return re.compile(rf"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
