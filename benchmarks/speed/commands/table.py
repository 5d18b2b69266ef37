"""The table of commands, and what a page already says of them."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.page import block_of, table, table_rows
from benchmarks.speed.commands.process import Spent
from benchmarks.speed.commands.stages import OTHER
from benchmarks.speed.commands.works import GIB, Work
from benchmarks.speed.report import ratio

_BEFORE = "seconds before"
_COLUMNS = ("command", "seconds", "at most", "processor seconds", "peak memory", "share by stage")
_NONE = "–"


class Timed(NamedTuple):
    """The runs of a command.

    Attributes:
        work: The command.
        now: One for each round.
        before: Those of the older installation in the same rounds, empty without one.
        shares: Share of each stage in the processor time, of one more run.
    """

    work: Work
    now: list[Spent]
    before: list[Spent]
    shares: dict[str, float]


class Stored(NamedTuple):
    """What a block of a page says: its first lines, what it calls the older installation, and its rows by command."""

    head: str
    older: str
    rows: dict[str, list[str]]


def stored(document: Path | None, block: str) -> Stored:
    """The block of a page; empty without a page or a table."""
    text = block_of(document, block)
    older = re.search(rf"{_BEFORE} \((.*?)\)", text)
    return Stored(text.partition("\n\n")[0], older[1] if older else "", table_rows(text))


def commands_table(timed: Sequence[Timed], works: Sequence[Work], older: str, kept: Stored) -> str:
    """All commands; a row that was not measured now stays as it is on the page, as do seconds before.

    Args:
        timed: The measured commands.
        works: All commands, in the order of the table.
        older: The older installation, empty without one.
        kept: What the page says.
    """
    measured = {one.work.name: one for one in timed}
    lines = []
    for name in (work.name for work in works):
        old = kept.rows.get(name)
        if name in measured:
            lines.append([*_cells(measured[name]), *_compared(measured[name], old)])
        elif old is not None:
            lines.append(old)
    return table([*_COLUMNS, f"{_BEFORE} ({older or kept.older or 'not measured'})", "times as fast"], lines)


def load(timed: Sequence[Timed]) -> str:
    """How many rounds were measured and how busy other processes kept the machine, as a sentence."""
    rounds = sorted({len(one.now) for one in timed})
    others = [spent.others for one in timed for spent in (*one.now, *one.before)]
    return (
        f"- load: other processes took {np.median(others):.0%} of the machine's processor time in the median run, "
        f"{max(others):.0%} at most; rounds of a command: {', '.join(map(str, rounds))}"
    )


def _cells(one: Timed) -> list[str]:
    work, peak = one.work, max(spent.peak for spent in one.now)
    most = [] if work.most_s is None else [f"{work.most_s:g} s"]
    most += [] if work.most_bytes is None else [f"{work.most_bytes / GIB:g} GiB"]
    shares = [f"{name} {share:.0%}" for name, share in one.shares.items()]
    times = [_median([getattr(spent, name) for spent in one.now]) for name in ("seconds", "processor_s")]
    memory = f"{peak / GIB:.2f} GiB"
    return [work.name, times[0], ", ".join(most) or _NONE, times[1], memory, ", ".join(shares) or OTHER]


def _compared(one: Timed, old: list[str] | None) -> list[str]:
    """Seconds before and the ratio of the rounds; without an older installation, those of the page."""
    if not one.before:
        return [_NONE, _NONE] if old is None else old[len(_COLUMNS) :]
    now, before = ([spent.seconds for spent in runs] for runs in (one.now, one.before))
    peak = f", {max(spent.peak for spent in one.before) / GIB:.2f} GiB" if one.work.most_bytes is not None else ""
    return [f"{_median(before)}{peak}", ratio(before, now)]


def _median(values: Sequence[float]) -> str:
    """Of the rounds, with the smallest and the largest."""
    spread = f" ({min(values):.3g}–{max(values):.3g})" if len(values) > 1 else ""
    return f"{np.median(values):.3g}{spread}"
