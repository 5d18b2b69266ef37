"""Records of `summary.json` of a comparison.

Rows of numbers name only the keys that stand in the code; quantities also have their bounds and the difference to the
reference model, `taps_low` or `taps_difference_high`. A number that is missing is `None`, an infinite one a word.
"""

from collections.abc import Mapping
from typing import NotRequired, TypedDict

from ..page.report import GridRecord, UnitsRecord

type Value = float | str | None


class ComparedData(TypedDict):
    """Description of the data."""

    title: str
    command: str
    what_was_run: list[str]
    simulated: bool
    warnings: list[str]


class ComparedGrid(GridRecord):
    """The classes."""

    unit: str


class ComparedModel(TypedDict):
    """A model and how it was fitted."""

    name: str
    relaxes: str
    how: str
    fit: str
    converged: bool
    seconds: float
    power: str
    states: int


class RefusedModel(TypedDict):
    """A model that could not be fitted."""

    name: str
    reason: str


class TapRow(TypedDict):
    """Scores of a model for taps of sessions left out; `weight` is the stacking weight."""

    name: str
    weight: NotRequired[float]
    behind: NotRequired[float]
    behind_se: NotRequired[float]


class SingleTapRow(TapRow):
    """The same, and how it predicts single taps left out."""

    psis: Value
    bad_k: float
    good_k: float
    psis_ranks: bool
    exact: NotRequired[float]
    exact_plug_in: NotRequired[float]


class ClassRow(TypedDict):
    """Scores of a model's belief in the class after some contacts."""

    name: str
    contacts: int


class DecisionRow(TypedDict):
    """Errors and reaction times of a model at a threshold."""

    name: str
    policy: str
    theta: float
    stopped_fraction: Value
    used_up: Value


class EqualTapsRow(TypedDict):
    """The errors of a model at a mean reaction time."""

    name: str
    policy: str
    taps: float


class CheckedModel(TypedDict):
    """A statistic of replicates of a model, and the share of them at or above the observed one."""

    name: str
    replicated: Value
    p: Value


class CheckRow(TypedDict):
    """A predictive check."""

    statistic: str
    assumption: str
    observed: float
    models: list[CheckedModel]


class LevelRecord(TypedDict):
    """A quantity by which models are ranked."""

    title: str
    unit: str


class RankCell(TypedDict):
    """Rank of a model at a level."""

    rank: int
    value: float


class RankRow(TypedDict):
    """Ranks of a model at all levels, `None` where it has no number."""

    name: str
    levels: list[RankCell | None]


class ComparisonSummary(ComparedData):
    """Content of `summary.json`."""

    versions: Mapping[str, str]
    seed: int
    reference: str
    grid: ComparedGrid
    units: UnitsRecord
    test_taps: int
    models: list[ComparedModel]
    refused: list[RefusedModel]
    sessions: str
    taps: list[TapRow | SingleTapRow]
    contacts: list[int]
    classes: list[ClassRow]
    class_interval: str
    decisions: list[DecisionRow]
    shown_theta: float
    equal_taps: list[EqualTapsRow]
    decision_interval: str
    checks: list[CheckRow]
    levels: list[LevelRecord]
    ranks: list[RankRow]
    findings: list[str]
    trials: int
    draws: int
    elapsed_s: Mapping[str, float]
