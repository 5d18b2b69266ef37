"""Sizes, ranges and data-quality warnings of taps: the function `solidtouch.inspect` and its report."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from ...models.grid import ClassGrid
from ...models.io.load import TapSource, names_of, taps_of
from ...models.settings import Missing
from ..page.page import Page
from ..page.report import Report
from .page import inspection_page
from .run import Inspection, inspect_taps


@dataclass(frozen=True, eq=False, repr=False)
class InspectionReport(Report):
    """Sizes, ranges and data-quality warnings of a tap set, and which questions it can answer.

    Attributes:
        found: All results.
        grid: The classes in which taps are counted.
        title: Name of the tap set.
    """

    found: Inspection
    grid: ClassGrid
    title: str

    def _page(self) -> Page:
        return inspection_page(self.found, self.title)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Data-quality warnings, one sentence each."""
        return self.found.warnings

    @property
    def answers(self) -> xr.Dataset:
        """Which questions the taps can answer: `answer` ("yes", "partly" or "no") and `why`, dim question."""
        found = self.found.answers
        return xr.Dataset(
            {"answer": ("question", [one.answer for one in found]), "why": ("question", [one.why for one in found])},
            {"question": [one.question for one in found]},
        )

    @property
    def counts(self) -> xr.DataArray:
        """Taps per class, dims session, where and what."""
        coords = {"session": list(self.found.sessions), **self.grid.coords()}
        return xr.DataArray(self.found.counts, coords, ("session", "where", "what"), "counts", {"units": "taps"})

    @property
    def taxels(self) -> xr.Dataset:
        """Range of each taxel, and whether it is constant or saturated, dim taxel."""
        number, units = np.arange(len(self.found.low)), {"units": self.found.units}
        return xr.Dataset(
            {
                "low": ("taxel", self.found.low, units),
                "high": ("taxel", self.found.high, units),
                "constant": ("taxel", np.isin(number, self.found.constant)),
                "saturated": ("taxel", np.isin(number, self.found.saturated)),
            },
            {"taxel": number},
        )


def inspect(
    data: TapSource, where_cell: str | None = None, what_cell: str | None = None, missing: Missing | None = None
) -> InspectionReport:
    """Sizes, ranges and data-quality warnings of taps, and which questions they can answer.

    >>> import solidtouch as st
    >>> taps, _ = st.simulate("paper", sessions=2, seed=4)
    >>> report = st.inspect(taps, where_cell="2mm")
    >>> int(report.counts.sel(session=0, where=3.0, what="8 mm rod"))
    40
    >>> [sentence.partition(":")[0] for sentence in report.warnings]
    ['There is only one session', 'Recorded in blocks']
    >>> report.answers["answer"].sel(question=["single taps", "new sessions"]).values.tolist()
    ['yes', 'no']

    Args:
        data: A tap set or its file.
        where_cell: Width of the position classes with unit, such as `"3mm"`; `None` for the positions of the taps.
        what_cell: Width of the object classes.
        missing: `"drop"` to accept samples that are NaN, and to say how many are; as in `load_taps`.

    Raises:
        InputError: The taps cannot be read, or have no such classes.
    """
    taps = taps_of(data, missing)
    grid = taps.grid(where_cell, what_cell)
    return InspectionReport(inspect_taps(taps, grid), grid, names_of([data])[0])
