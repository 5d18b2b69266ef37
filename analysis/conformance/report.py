"""Verdicts on an implementation, and what they come to."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from ..page.page import Brief, Page, Table
from ..page.report import Report
from .catalogue import Kit
from .formats.as_json import Claim, report_object
from .formats.as_junit import junit
from .levels import LevelResult, level_results, level_sentence
from .verdict import Verdict, described, summary

_COLUMNS = ("status", "tap", "quantity", "sentence", "cause")


@dataclass(frozen=True, eq=False, repr=False)
class ConformanceReport(Report):
    """Verdicts on an implementation.

    Attributes:
        title: What was checked.
        found: All results, by the name of the case.
        kit: The cases, and their version.
        precision: Of the implementation's numbers.
        without: Quantities that were not compared.
    """

    title: str
    found: Mapping[str, Verdict]
    kit: Kit
    precision: str = "double"
    without: tuple[str, ...] = ()

    def _page(self) -> Page:
        rows = [[verdict.case, described(verdict)] for verdict in self._shown(False)]
        return Page(self.title, [Brief(Table(("case", "verdict"), rows, words={1})), *map(Brief, self.sentences)], [])

    def _shown(self, passed: bool) -> list[Verdict]:
        return [verdict for verdict in self.found.values() if passed or described(verdict) != "pass"]

    @property
    def passed(self) -> bool:
        """Whether all cases pass that were not left out, and there is one."""
        return summary([*self.found.values()])[1]

    @property
    def sentences(self) -> list[str]:
        """The likely causes, the number of cases that pass, what of the kit is not known, and the levels that pass."""
        claim = level_sentence(self.kit.version, [*self.levels.values()], self.precision, self.without)
        return [*summary([*self.found.values()])[0], *self.kit.sentences, claim]

    @cached_property
    def levels(self) -> Mapping[str, LevelResult]:
        """What was found in each level of which a case was asked; `passes` says whether the level does."""
        return level_results(self.kit.sizes, self.kit.cases, self.found)

    @property
    def results(self) -> xr.Dataset:
        """Status, first tap and quantity that differ (NaN and empty for none), sentence and likely cause, dim case."""
        columns = {name: [getattr(verdict, name) for verdict in self.found.values()] for name in _COLUMNS}
        columns["tap"] = [np.nan if tap is None else tap for tap in columns["tap"]]
        return xr.Dataset({name: ("case", column) for name, column in columns.items()}, {"case": [*self.found]})

    def as_object(self) -> dict[str, Any]:
        """All of it as JSON has it, by `report.schema.json` of the kit."""
        claim = Claim(self.kit.version, self.precision, self.without)
        verdicts = [*self.found.values()]
        levels = [*self.levels.values()]
        return report_object(self.title, claim, levels, verdicts, self.kit.cases, self.sentences, self.passed)

    def as_json(self) -> str:
        """The text of `as_object`."""
        return json.dumps(self.as_object(), indent=1) + "\n"

    def as_junit(self) -> str:
        """The XML of JUnit, a suite for each level and a test for each case."""
        return junit(self.as_object())

    def lines(self, passed: bool = True) -> list[str]:
        """A line for each case and the sentences, as the command prints them.

        Args:
            passed: Whether cases that pass have a line.
        """
        width = max(map(len, self.found), default=0)
        return [f"{one.case:{width}}  {described(one)}" for one in self._shown(passed)] + self.sentences
