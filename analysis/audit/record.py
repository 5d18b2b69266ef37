"""Records of `audit.json`, in the order of the page.

Rows of numbers name only the keys that stand in the code. A number that is missing or infinite is `None`; where an
infinite factor has a meaning, `unbounded` says so.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NotRequired, TypedDict

from ..page.report import GridRecord, UnitsRecord
from ..stats.reliability import StoppingRecord

type Triple = Sequence[float | None]
"""A value with the ends of its interval."""


class BesideRecord(TypedDict):
    """Range under a correct model, and the rank of the value in it."""

    value: float | None
    median: float | None
    low: float | None
    high: float | None
    above: float | None
    below: float | None


class FactorRecord(TypedDict):
    """A miscalibration factor, and its range under a correct model."""

    factor: Triple
    unbounded: bool
    beside: BesideRecord


class JudgedRecord(FactorRecord):
    """Factors behind the verdict on beliefs, for all objects and each."""

    wrong: float | None
    exact: bool
    each: Mapping[str, FactorRecord]
    taps: int
    few: str


class VerdictEvidence(TypedDict):
    """Evidence behind the verdict."""

    judged: JudgedRecord
    first_cause: str | None
    remedy: str | None


class VerdictRecord(TypedDict):
    """The verdict."""

    state: str
    sentences: list[str]
    evidence: VerdictEvidence


class BeforeContact(TypedDict):
    """Samples before contact, and what says so."""

    samples: int
    known_by: str | None


class LeakageRecord(TypedDict):
    """Leakage: classification without touch."""

    sentences: list[str]
    judged: bool
    before_contact: BeforeContact
    told: Sequence[Mapping[str, Any]]
    blocks: Mapping[str, Mapping[str, bool]]
    test_taps: int


class PartRow(TypedDict):
    """A part of the variance of evidence: `share`, with its bounds, and ratio to that of independent samples."""

    name: str
    words: str
    ratio: float | None


class SizeRow(TypedDict):
    """How large a disturbance is: `value`, with its bounds."""

    name: str
    words: str


class SuspectRow(TypedDict):
    """An array that was suspected as a cause, and how much of it follows the order of taps."""

    name: str
    p: float | None
    follows_order: float | None


class VarianceRecord(TypedDict):
    """Variance of the evidence, by cause."""

    parts: list[PartRow]
    sizes: list[SizeRow]
    session_p: float | None
    taps: int
    classes: int
    sessions: int
    covariate: str
    covariate_p: float | None
    suspects: list[SuspectRow]


class TaxelTest(TypedDict):
    """A test of the dependence of taxels: `effect`, with its bounds; reasons say why there are no numbers."""

    test: str
    effect_null: float | None
    family_p: float | None
    drift_p: float | None
    contrasts: int
    drift_reason: str
    pairs: int
    rejected_fraction: float | None
    permutations: int
    reason: str


class TaxelsRecord(TypedDict):
    """Dependence across taxels."""

    tests: list[TaxelTest]
    dead: list[int]
    taxels: int
    within_sessions: bool


class TimesRecord(TypedDict):
    """Dependence in time."""

    effective_samples: Triple
    effective_values: Triple
    samples: int
    values: int | None
    lag1: Triple | None
    p: Mapping[str, float | None]
    reason: str


class ComponentRow(TypedDict):
    """A standard deviation of the hierarchical model."""

    quantity: str
    component: str
    mean: float | None
    low: float | None
    high: float | None
    r_hat: float | None
    ess_bulk: float | None


class ComponentsRecord(TypedDict):
    """Dependence between taps."""

    sentences: list[str]
    converged: bool
    standard_deviations: list[ComponentRow]
    effective_taps: Sequence[Mapping[str, Any]]


class CauseEvidence(TypedDict):
    """Where the model fails."""

    leakage: LeakageRecord
    variance: VarianceRecord | None
    no_variance: str
    taxels: TaxelsRecord
    times: TimesRecord
    components: ComponentsRecord
    predictive_checks: Sequence[Mapping[str, Any]]
    samples_per_bin: float | None


class CauseRecord(TypedDict):
    """What to look at first."""

    name: str | None
    words: str
    sentence: str
    evidence: CauseEvidence


class PromiseRecord(TypedDict):
    """Whether a promise of the stopping rule is exceeded."""

    exceeded: bool
    beside: BesideRecord | None


class LostRecord(TypedDict):
    """What is lost against the best model, see `remedy_scores.lost`."""

    model: str | None
    error: float
    low: float | None
    high: float | None
    taps: float | None


class EnoughRow(TypedDict):
    """What a design finds: the factor of a right model, and the least that is detected."""

    sessions: int
    taps: int
    right: float | None
    detectable: float | None


class AfterTapsRow(TypedDict):
    """Scores of beliefs after some taps, of all objects; those of each stand under its name."""

    taps: int
    all: Mapping[str, Triple]


class CostEvidence(TypedDict):
    """What it costs."""

    judged: JudgedRecord
    at_stopping: StoppingRecord
    other_policy: Mapping[str, StoppingRecord]
    after_taps: list[AfterTapsRow]
    guarantees: Mapping[str, Mapping[str, Triple]]
    exceeded: Mapping[str, PromiseRecord]
    guarantee_sentence: str
    intervals: str
    lost: LostRecord
    enough: list[EnoughRow]


class CostRecord(TypedDict):
    """How often decisions are wrong over how often beliefs say so."""

    factor: Triple
    unbounded: bool
    state: str
    evidence: CostEvidence


class OutsideRecord(BesideRecord):
    """The same, and whether it is lower than a right model gives."""

    outside: bool


class TunedRecord(TypedDict):
    """What was tuned beside what a right model gives."""

    sentence: str
    taps: int
    simulations: int
    power: OutsideRecord
    saturation: OutsideRecord | None


class RemedyRow(TypedDict):
    """What a remedy was measured to do, see `remedy_scores.Scored`."""

    name: str
    log_score: Triple
    gain: Triple | None
    sure_gain: float | None
    error: Triple | None
    error_change: Triple | None
    where_error_change: Triple | None
    taps: float | None
    factor: Triple
    stopped: float | None
    unbounded: bool
    gain_per_tap: Triple | None
    title: str
    assumes: str
    how: str
    power: float
    saturation: float | None
    right_model: TunedRecord | None
    worthwhile: NotRequired[bool]


class RefusedRow(TypedDict):
    """A remedy that these taps do not allow."""

    name: str
    reason: str


class ThresholdRecord(TypedDict):
    """What another threshold does, see `run.Recalibrated`."""

    target: float
    reached: bool
    threshold: float
    tuned: float
    error: float
    taps: float
    before: float
    taps_before: float
    tuning: Sequence[float]


class RemedyEvidence(TypedDict):
    """What to do."""

    taps: int
    reaction_time: float
    compared_at: float
    policy: str
    unit: str
    as_it_is: RemedyRow
    ranking: list[RemedyRow]
    refused: list[RefusedRow]
    threshold: ThresholdRecord
    target_error: Mapping[str, Any] | None


class RemedyRecord(TypedDict):
    """What is recommended, and the files that hold it."""

    chosen: str | None
    setting: str
    model: str
    evidence: RemedyEvidence


class AuditedData(TypedDict):
    """The data in words."""

    title: str
    files: Mapping[str, int]
    simulated: bool
    warnings: list[str]
    command: str


class AuditSummary(AuditedData):
    """The file."""

    verdict: VerdictRecord
    first_cause: CauseRecord
    miscalibration: CostRecord
    remedy: RemedyRecord
    parts: str
    threshold: float
    seed: int
    units: UnitsRecord
    grid: GridRecord
    causes: Mapping[str, str]
    elapsed_s: Mapping[str, float]
    version: str
