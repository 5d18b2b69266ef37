"""Summary of a comparison of strategies: `strategies.json`, from which page and document are made."""

from collections.abc import Sequence
from itertools import islice
from typing import Any

import numpy as np

from ...inference.moves.control import default_fixation
from ..experiment.settings import SHOWN_THETA
from ..page.figure_style import unit_name
from ..page.numbers import STORED_ONLY, versions
from ..page.page import Row
from ..page.report import TitleRecord
from ..stats.jackknife import Interval, Means, as_factor, as_numbers, interval, jackknife
from .curves import AT_TAPS, QUANTITIES, at_taps, curve, differences, quantities
from .findings import FIXED, LOOK, PAPER, RULES, TAPS, findings, source_findings
from .run import BASE, PlayedStrategies, StrategySettings, StrategyStudy

STRATEGY_WORDS = {
    "passive": "never moves",
    "random": "moves to a random position",
    "step": "moves by one class to either side of the most probable position",
    "fixation": "moves to the fixation point, the middle of the range (the paper's active perception)",
    "fixation:0.8": "moves to the fixation point only if the belief in a position exceeds 0.8",
    "info-what": "maximises the expected information of the next tap about the object",
    "info-where": "maximises the expected information of the next tap about the position",
    "info-joint": "maximises the expected information of the next tap about object and position",
    "info-what-per-mm": "maximises the expected information about the object per millimetre of travel (5 mm per tap)",
    "info-what-per-s": "maximises the expected information about the object per second (1 s per tap, moves at 20 mm/s)",
    "table": "moves to the position that a table, learned from training taps, lists for the most probable position",
    "risk": "minimises the expected error of a decision after one more tap plus the cost of travel",
}
"""By the names of `inference.moves.strategies`; `risk` is played where costs are told only."""
RULE_WORDS = {
    "what": "the belief in an object exceeds a threshold (the paper's rule)",
    "where": "the belief in a position exceeds a threshold",
    "both": "both beliefs exceed the same threshold",
    "number of taps": "a fixed number of taps",
    "msprt": "multihypothesis sequential probability ratio test: one threshold per object, which rises as taps become "
    "cheaper and as the object differs more from the most similar one",
    "lookahead": "one more tap is expected to reduce the error by no more than it costs",
    "what, at N taps decide": "the paper's rule with a deadline: after N taps the most probable object is chosen",
    "what, at N taps give up": "the paper's rule with null decisions: after N taps the trial ends undecided",
}
"""By the names of `curves.families`, N for half the deadline."""


_GIVEN_UP, _WRONG = QUANTITIES.index("given_up"), QUANTITIES.index("wrong")
_AMOUNT, _SHARE = (0.0, np.inf), (0.0, 1.0)
_LIMITS = {
    **dict.fromkeys(("what_error", "where_error", "taps", "way", "expected"), _AMOUNT),
    **dict.fromkeys(("wrong", "given_up", "unstopped"), _SHARE),
}
_ALIKE = 1e-12  # width of an interval that rounding leaves
_PACKAGES = ("solidtouch", "numpy", "scipy", "numba", "xarray", "matplotlib")


def summarise(
    studies: Sequence[StrategyStudy],
    settings: StrategySettings,
    described: TitleRecord,
    regret: Row | None = None,
) -> Row:
    """Content of `strategies.json`.

    Args:
        studies: One for each kind of data.
        settings: What was asked for.
        described: What was asked for, in words.
        regret: See `regret_summary.summarise_regret`; `None` where it was not asked for.
    """
    sources = [_source(one) for one in studies]
    return {
        **described,
        "versions": versions(_PACKAGES),
        "seed": settings.seed,
        "trials": settings.trials,
        "deadline": settings.deadline,
        "pool": settings.pool,
        "theta": SHOWN_THETA,
        "look": LOOK,
        "rules": rules(settings),
        "strategy_words": STRATEGY_WORDS,
        "rule_words": {name.replace(" N ", f" {settings.deadline // 2} "): text for name, text in RULE_WORDS.items()},
        "sources": sources,
        "regret": regret,
        "findings": [*findings(sources), *(regret["findings"] if regret else ())],
    }


def rules(settings: StrategySettings) -> list[str]:
    """How it is compared, in sentences."""
    return [
        "All strategies start from the same positions and objects with the same random numbers. Trials end after "
        f"{settings.deadline} taps at the latest, with the most probable classes. Errors are those of trials with a "
        "decision, taps and travel those of all trials; null decisions are listed separately.",
        STORED_ONLY,
        f"Look-ahead strategies enumerate about {settings.pool} training taps, evenly chosen from all classes; they "
        "never see test taps.",
        "Equal taps are mean numbers of taps along the curve of a stopping rule, interpolated between its levels. "
        f'Differences are relative to the strategy "{BASE}" on the same trials; negative means a lower error.',
        "Brackets are 95% t-intervals over units, clipped to the possible range of errors, travel and fractions; a "
        "number without brackets has no interval, because its units are too few or identical. A dash means that the "
        "curve does not reach that number of taps. Significant means at the 5% level for all strategies and numbers "
        "of taps of a table together (Bonferroni); with many tables, one may still be wrong.",
        f"Miscalibration is P(wrong object) over the mean of 1 − belief after {LOOK} taps (1 if calibrated). Expected "
        "information is what strategies expect the taps after the first to add about the object; gained information "
        "is the actual increase of the log belief in the true object, both in nats. Typical taps are frequent among "
        "training taps and count twice, so the expected information is too low even for a correct model, and lowest "
        "where objects differ most; compare its difference from the fixation point with that of a correct model.",
    ]


def _source(study: StrategyStudy) -> Row:
    """What came out for one kind of data."""
    bench, grid = study.bench, study.bench.grid
    powers = [_power(one, first=i == 0) for i, one in enumerate(study.played)]
    numbers = {
        "name": bench.name,
        "simulated": bench.simulated,
        "units": bench.units,
        "grid": {"L": grid.L, "M": grid.M, "where_value": grid.where_value.tolist(), "where_unit": grid.axis_unit},
        "what_unit": grid.what_error_unit,
        "where_unit": unit_name(grid.where_unit),
        "border": bench.border,
        "fixation": default_fixation(grid.L),
        "strategies": powers[0]["strategies"],
        "powers": powers,
        "paths": {name: path.tolist() for name, path in study.played[0].paths.items()},
    }
    return {**numbers, "findings": source_findings(numbers)}


def _power(played: PlayedStrategies, *, first: bool) -> Row:
    """One root of the likelihood; only the first has the curves of all rules."""
    strategies = list(played.nats)
    shown = [family for family in played.families if first or family.name in RULES]
    return {
        "power": played.power,
        "exponent": played.exponents,
        "strategies": strategies,
        "families": [{"name": family.name, "parameter": family.parameter} for family in shown],
        "curves": {
            family.name: {name: _curve(played.means[name, family.name], family.levels) for name in strategies}
            for family in shown
        },
        "shown": _shown(played) if first else [],
        "equal": {family: _equal(played, family, strategies) for family in RULES},
        "rules": _rules(played) if first else [],
        "trust": [_trust(played, name) for name in strategies],
    }


def _shown(played: PlayedStrategies) -> list[Row]:
    """Taps and way of each strategy at the shown threshold less those of the fixation point, paired."""
    levels = next(family.levels for family in played.families if family.name == PAPER)
    at = int(np.argmin(np.abs(np.array(levels) - SHOWN_THETA)))
    base, rows = played.means[BASE, PAPER][:, at], []
    for name in played.nats:
        values, errors = jackknife(
            [played.means[name, PAPER][:, at], base], lambda new, old: quantities(new) - quantities(old)
        )
        row: dict[str, Any] = {}
        for quantity in ("taps", "way"):
            i = QUANTITIES.index(quantity)
            row |= _numbers(interval(values[i], errors[i], len(base), 1), f"{quantity}_difference")
        rows.append({"strategy": name, **row})
    return rows


def _numbers(value: Interval, name: str) -> dict[str, float | None]:
    """The numbers of an interval, cut where the quantity ends; no interval where all units are alike."""
    low, high = _LIMITS.get(name, (-np.inf, np.inf))
    if value.high - value.low <= _ALIKE:
        value = Interval(value.value, *[np.nan] * 4)
    return as_numbers(Interval(value.value, *(float(np.clip(end, low, high)) for end in value[1:])), name)


def _curve(means: Means, levels: Sequence[float]) -> list[Row]:
    """`QUANTITIES` at every level, each with its 95% interval."""
    found = []
    for level, row in zip(levels, curve(means), strict=True):
        point: dict[str, float | None] = {"level": float(level)}
        for quantity, value in zip(QUANTITIES, row, strict=True):
            point |= islice(_numbers(value, quantity).items(), 3)
        found.append(point)
    return found


def _equal(played: PlayedStrategies, family: str, strategies: Sequence[str]) -> list[Row]:
    """Each strategy at equal taps, and by how much it differs from the fixation point."""
    base = played.means[BASE, family]
    count = max(1, len(strategies) - 1) * len(TAPS)
    return [
        {"strategy": name, **row} for name in strategies for row in _against(played.means[name, family], base, count)
    ]


def _rules(played: PlayedStrategies) -> list[Row]:
    """Stopping rules with the fixation point, held against the paper's at equal mean numbers of taps."""
    base = played.means[BASE, PAPER]
    count = (len(played.families) - 1) * len(TAPS)
    return [
        {"rule": family.name, **row}
        for family in played.families
        for row in _against(played.means[BASE, family.name], base, count)
    ]


def _against(means: Means, base: Means, count: int) -> list[dict[str, Any]]:
    """`AT_TAPS` of a curve at `TAPS`, and what they differ from those of another."""
    values, errors = jackknife([means], lambda mean: at_taps(mean, TAPS))
    changes = differences(means, base, TAPS, count)
    rows = []
    for i, taps in enumerate(TAPS):
        row: dict[str, Any] = {"taps": taps}
        for j, quantity in enumerate(AT_TAPS):
            row |= _numbers(interval(values[i, j], errors[i, j], len(means), 1), quantity)
            row |= _numbers(changes[i][j], f"{quantity}_difference")
        rows.append(row)
    return rows


def _trust(played: PlayedStrategies, name: str) -> Row:
    """Miscalibration, gain over the fixation point and what taps were expected to tell, after `LOOK` taps."""
    levels = next(family.levels for family in played.families if family.name == FIXED)
    at = levels.index(LOOK)
    means, base = (played.means[one, FIXED][:, at] for one in (name, BASE))
    nats, base_nats = (played.nats[one][:, LOOK - 1] for one in (name, BASE))
    n = len(means)

    def statistic(new: Means, old: Means, told: Means, told_base: Means) -> np.ndarray:
        found, before = quantities(new), quantities(old)
        with np.errstate(divide="ignore", invalid="ignore"):
            factors = np.log([found[-1], before[-1]])
        excess, base_excess = told[0] - told[1], told_base[0] - told_base[1]
        gain = before[_WRONG] - found[_WRONG]
        return np.array([*factors, factors[0] - factors[1], gain, *told, excess, base_excess, excess - base_excess])

    values, errors = jackknife([means, base, nats, base_nats], statistic)
    row: dict[str, Any] = {}
    names = ("factor", "base_factor", "factor_ratio", "gain", "expected", "told", "excess", "base_excess")
    for key, value, error in zip((*names, "excess_difference"), values, errors, strict=True):
        found = interval(value, error, n, 1)
        row |= _numbers(as_factor(found) if "factor" in key else found, key)
    return {"strategy": name, "given_up": float(quantities(means.mean(axis=0))[_GIVEN_UP]), **row}
