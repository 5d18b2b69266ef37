"""Page of an inspection."""

from collections.abc import Iterator

import numpy as np

from ...models.errors import counted
from ..page.page import Brief, Cautions, Page, Section, Table
from .run import Inspection

ANSWERS = "What can these data show?"
_ROWS, _COLUMNS = 40, 8  # a larger grid of cells is condensed to its smallest, middle and largest count


def inspection_page(inspection: Inspection, title: str = "") -> Page:
    """What the data can show, and the warnings; then sizes and ranges, and taps per cell."""
    overview = Table((), [*overview_lines(inspection)], title, words={1})
    found = Cautions(inspection.warnings) if inspection.warnings else "No data-quality warnings."
    sizes = Section("Sizes and ranges", [Brief(overview), Brief(_counts(inspection))])
    return Page(title, [Brief(_answers(inspection)), Brief(found)], [sizes])


def _answers(inspection: Inspection) -> Table:
    return Table((), [*inspection.answers], ANSWERS, words={1, 2})


def overview_lines(inspection: Inspection) -> Iterator[tuple[str, str]]:
    """Name and value of each line of the overview; what is unknown is left out."""
    taps, samples, taxels = inspection.size
    yield "taps", f"{taps} of {counted(samples, 'sample')} from {counted(taxels, 'taxel')}"
    yield "sessions", f"{len(inspection.sessions)} ({_condensed([str(s) for s in inspection.sessions])})"
    yield "objects", f"{len(inspection.what_label)} ({_condensed(inspection.what_label)})"
    yield "positions", f"{len(inspection.where_label)} ({_condensed(inspection.where_label)})"
    if inspection.where_unit:
        yield "unit of position", inspection.where_unit
    yield "values", _range(inspection)
    chosen = ", ".join(f"{name} {value}" for name, value in inspection.preprocessing.items())
    yield "preprocessing", chosen or "unknown; taps were imported unchanged"
    yield from ((name, text) for name, text in inspection.attributes.items() if text)


def _range(inspection: Inspection) -> str:
    low, high = inspection.low, inspection.high
    spans = high - low
    if np.isnan(spans).all():
        return "none is known"
    narrow, wide = int(np.nanargmin(spans)), int(np.nanargmax(spans))
    unit = f" {inspection.units}" if inspection.units else ""
    return (
        f"{np.nanmin(low):g} to {np.nanmax(high):g}{unit}; narrowest taxel {narrow}: {low[narrow]:g} to "
        f"{high[narrow]:g}, widest taxel {wide}: {low[wide]:g} to {high[wide]:g}"
    )


def _counts(inspection: Inspection) -> Table:
    """Taps per cell, sessions joined by `+`; or the spread of the counts where the grid is large."""
    counts, rows, columns = inspection.counts, inspection.where_label, inspection.what_label
    if len(rows) < len(columns):
        counts, rows, columns = counts.transpose(0, 2, 1), columns, rows
    if len(rows) > _ROWS or len(columns) > _COLUMNS or len(counts) > _COLUMNS:
        return _condensed_counts(inspection)
    heads = columns if len(columns) > 1 else ("taps",)
    cells = [[name, *("+".join(map(str, counts[:, r, c])) for c in range(len(columns)))] for r, name in enumerate(rows)]
    return Table(["", *heads], cells, _caption(inspection))


def _condensed_counts(inspection: Inspection) -> Table:
    rows = []
    for session, counts in zip(inspection.sessions, inspection.counts, strict=True):
        filled = f"{np.count_nonzero(counts)} of {counts.size}"
        spread = counts.min(), np.median(counts), counts.max()
        rows.append([str(session), str(counts.sum()), filled, *(f"{value:g}" for value in spread)])
    return Table(["session", "taps", "filled cells", "fewest", "median", "most"], rows, _caption(inspection))


def _caption(inspection: Inspection) -> str:
    return "Taps per cell" + (", session by session" if len(inspection.sessions) > 1 else "")


def _condensed(names: tuple[str, ...] | list[str]) -> str:
    return ", ".join(names) if len(names) <= _COLUMNS else f"{', '.join(names[:3])}, ..., {names[-1]}"
