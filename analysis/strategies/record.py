"""Records of `strategies.json`.

Rows of numbers name only the keys that stand in the code; quantities also have their bounds and the difference to the
fixation point or the paper's rule, `taps_low` or `taps_difference_most`. A number that is not known is `None`.
"""

from collections.abc import Mapping
from typing import TypedDict

from ..page.report import GridRecord, TitleRecord


class CurvePoint(TypedDict):
    """Results of a strategy at one level of a stopping rule."""

    level: float
    way: float | None
    given_up: float | None
    unstopped: float | None


class StrategyRow(TypedDict):
    """Numbers of a strategy."""

    strategy: str


class EqualRow(StrategyRow):
    """A strategy at a mean number of taps."""

    taps: int
    given_up: float | None
    what_error_difference: float | None
    what_error_difference_least: float | None
    what_error_difference_most: float | None


class RuleRow(TypedDict):
    """A stopping rule with the fixation point at a mean number of taps."""

    rule: str
    taps: int
    what_error: float | None
    given_up: float | None


class TrustRow(StrategyRow):
    """Miscalibration, its ratio to that of the fixation point, gain, and expected and gained information."""

    given_up: float
    factor: float | None
    factor_low: float | None
    factor_high: float | None
    factor_ratio: float | None
    factor_ratio_low: float | None
    factor_ratio_high: float | None


class FamilyRecord(TypedDict):
    """A stopping rule and its levels."""

    name: str
    parameter: str


class PowerRecord(TypedDict):
    """Results for one exponent of the likelihood: curves by rule and strategy, rows at equal taps by rule."""

    power: str
    exponent: float
    strategies: list[str]
    families: list[FamilyRecord]
    curves: Mapping[str, Mapping[str, list[CurvePoint]]]
    shown: list[StrategyRow]
    equal: Mapping[str, list[EqualRow]]
    rules: list[RuleRow]
    trust: list[TrustRow]


class StrategyGrid(GridRecord):
    """The classes."""

    where_value: list[float]
    where_unit: str


class StrategyNumbers(TypedDict):
    """Results for one kind of data."""

    name: str
    simulated: bool
    units: str
    grid: StrategyGrid
    what_unit: str
    where_unit: str
    border: str
    fixation: int
    strategies: list[str]
    powers: list[PowerRecord]
    paths: Mapping[str, list[list[int]]]


class StrategySource(StrategyNumbers):
    """The same in sentences as well."""

    findings: list[str]


class RegretPrice(StrategyRow):
    """Cost of a strategy with a stopping rule, above the minimum and above the cheapest strategy."""

    kind: str
    rule: str
    cost: float
    best: bool
    shown: str
    regret: float
    regret_low: float | None
    regret_high: float | None
    more_low: float | None


class RegretCase(TypedDict):
    """A case at a cost of taps."""

    name: str
    exact: bool
    places: list[float]
    rods: list[float]
    tap_cost: float
    bounds: Mapping[str, float]
    described: str
    caption: str
    prices: list[RegretPrice]
    strategies: list[str]
    said: str


class RegretSummary(TypedDict):
    """Regret of all strategies."""

    trials: int
    seed: int
    way_cost: float
    kinds: list[str]
    rules: list[str]
    cases: list[RegretCase]
    findings: list[str]


class StrategiesSummary(TitleRecord):
    """Content of `strategies.json`."""

    versions: Mapping[str, str]
    seed: int
    trials: int
    deadline: int
    pool: int
    theta: float
    look: int
    rules: list[str]
    strategy_words: Mapping[str, str]
    rule_words: Mapping[str, str]
    sources: list[StrategySource]
    regret: RegretSummary | None
    findings: list[str]
