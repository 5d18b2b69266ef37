"""Records of `summary.json` of a reproduction.

Rows of numbers name only the keys that stand in the code; quantities also have their bounds, `taps_low`.
"""

from collections.abc import Mapping
from typing import TypedDict

from ..page.report import GridRecord, TitleRecord, UnitsRecord

ANSWERS = {"joint": "object and position", "where": "position", "what": "object"}
"""What accuracies are about, by their keys."""


class TapsRecord(TypedDict):
    """A preset or a file."""

    name: str
    taps: int
    sessions: str
    description: str


class SplitRecord(TypedDict):
    """How taps are divided into training and test taps."""

    method: str
    description: str
    warning: str


class ExperimentGrid(GridRecord):
    """The classes, and the numbers of taxels and samples."""

    K: int
    J: int
    where: str
    what: str
    where_value: list[float]
    what_name: list[str]
    left_out: list[str]


class FixationRecord(TypedDict):
    """The fixation point."""

    index: int
    value: float


class ErrorRow(TypedDict):
    """Errors and taps of a policy, or the difference of two, at a threshold."""

    policy: str
    theta: float
    what_error: float
    what_wrong: float | None


class PolicyRow(ErrorRow):
    """The same with fractions of trials."""

    stopped_fraction: float | None
    clamped_fraction: float | None
    substituted_fraction: float | None
    no_class_left_fraction: float | None


class HeadlineSide(TypedDict):
    """Both policies and their difference on one kind of test taps."""

    meaning: str
    rows: list[ErrorRow]


class HeadlineRecord(TypedDict):
    """Headline numbers of both policies, see `headline.headline`."""

    answer: list[str]
    theta: float
    stored: HeadlineSide
    fresh: HeadlineSide
    enough: HeadlineSide | None
    used_up: float
    few: str | None
    still: str | None


class AccuracyRow(TypedDict):
    """Fractions of right answers after some contacts."""

    contacts: int
    classes: int
    where: float
    what: float


class PaperRow(TypedDict):
    """A number of the paper and ours."""

    quantity: str
    curve: str
    error: str
    paper: float
    ours: float | None
    ours_low: float | None
    ours_high: float | None
    unit: str
    source: str


class ReproductionSummary(TitleRecord):
    """Content of `summary.json`."""

    what_was_run: list[str]
    simulated: bool
    versions: Mapping[str, str]
    model: str
    seed: int
    data_sets: list[str]
    options: Mapping[str, object]
    data: list[TapsRecord]
    split: SplitRecord
    grid: ExperimentGrid
    units: UnitsRecord
    fixation: FixationRecord | None
    headline: HeadlineRecord
    results: list[PolicyRow]
    differences: list[ErrorRow]
    shown_theta: float
    interval: str
    accuracy: list[AccuracyRow]
    paper: list[PaperRow] | None
    crosscheck: Mapping[str, object]
    warnings: list[str]
    skipped: list[str]
    elapsed_s: Mapping[str, float]
