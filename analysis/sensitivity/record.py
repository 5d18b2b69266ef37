"""Records of `sensitivity.json`.

Rows of numbers name only the keys that stand in the code; quantities also have their bounds, `active_taps_low` or
`equal_taps_least`, and those of a policy its name in front.
"""

from collections.abc import Mapping
from typing import TypedDict

from ..page.report import GridRecord, TitleRecord


class DefaultRow(TypedDict):
    """Results of the defaults for a policy."""

    policy: str
    what_error: float


class ValueRecord(TypedDict):
    """A number with its own interval, and with that which holds together with all others."""

    value: float | None
    value_low: float | None
    value_high: float | None
    value_least: float | None
    value_most: float | None


class BetterRecord(TypedDict):
    """Quantities in which an option is better than the default."""

    surely: list[str]
    perhaps: list[str]


class OptionRow(TypedDict):
    """Effect of an option, and the quantities behind its verdict."""

    name: str
    verdict: str
    of: list[str]
    better: BetterRecord
    impossible_taps: float
    impossible_trials: float
    stopped: float


class ChoiceRecord(TypedDict):
    """A choice that the paper leaves open: our default and the options."""

    name: str
    paper: str
    record: str
    default: str
    note: str
    strongest: str
    verdict: str
    verdict_of: str
    options: list[OptionRow]


class OptionName(TypedDict):
    """An option of a choice."""

    choice: str
    option: str


class LeftOutOption(OptionName):
    """An option that was not run."""

    reason: str


class PairRow(TypedDict):
    """Change of the object error by two options together, and beyond the sum of both."""

    first: OptionName
    second: OptionName
    beyond: float | None
    beyond_low: float | None
    beyond_high: float | None
    sure: bool


class SourceNumbers(TypedDict):
    """Results for one source of data."""

    name: str
    simulated: bool
    units: str
    number_of_units: int
    scope: str
    policies: list[str]
    intervals: int
    grid: GridRecord
    what_unit: str
    where_unit: str
    blind_error: float
    default: list[DefaultRow]
    advantage: Mapping[str, ValueRecord]
    limits: Mapping[str, float]
    choices: list[ChoiceRecord]
    skipped: list[LeftOutOption]
    not_run: list[LeftOutOption]
    pairs: list[PairRow]
    pair_options: list[OptionName]


class OptionList(TypedDict):
    """Options that are too many for a sentence."""

    key: str
    title: str
    items: list[str]


class SensitivitySource(SourceNumbers):
    """The same with its words."""

    findings: list[str]
    lists: list[OptionList]


class SensitivitySummary(TitleRecord):
    """Content of `sensitivity.json`."""

    versions: Mapping[str, str]
    seed: int
    trials: int
    theta: float
    sources: list[SensitivitySource]
    rules: list[str]
