"""Rank of each model at each level of a comparison, and the best ones beside the second and the reference."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from ..page.numbers import listed
from ..page.page import Row
from .run import Comparison

_ALIKE = 1e-9  # relative to values, and to the 1 nat from which log beliefs near 0 are rounded


class Criterion(NamedTuple):
    """One way to rank models.

    Attributes:
        title: For the head of a column.
        said: What models are good in, for a sentence.
        unit: Of the values.
        larger: Whether larger is better.
        values: Of each model that has one.
        difference: Ends of the intervals of differences to the reference model.
        step: Ends of the intervals of differences to the model with the next smaller value.
    """

    title: str
    said: str
    unit: str
    larger: bool
    values: dict[str, float]
    difference: dict[str, tuple[float, float]]
    step: dict[str, tuple[float, float]]

    def rank(self, name: str) -> int:
        """Rank of a model: 1 plus the number of better ones; models that are equal but for rounding share a rank."""
        sign, values = 1 if self.larger else -1, self.values.values()
        rounding = _ALIKE * max(float(self.unit.startswith("nat")), *map(abs, values))
        return 1 + sum(sign * (value - self.values[name]) > rounding for value in values)

    @property
    def best(self) -> list[str]:
        """All models of rank 1."""
        return [name for name in self.values if self.rank(name) == 1]

    @property
    def second(self) -> str | None:
        """The first of the best models below rank 1, `None` if there is none."""
        return min((name for name in self.values if self.rank(name) > 1), key=self.rank, default=None)


def levels(comparison: Comparison) -> list[Criterion]:
    """All levels that the comparison can rank by."""
    found = []
    means = comparison.left_out_groups
    if means is not None and "integrated" in means:
        said, score = f"predicting the taps of a left-out {means.attrs['unit']}", "integrated"
        if point_fits(means):  # an integral over a posterior predicts better than a point does
            said, score = f"{said} by plug-in parameters", "plug_in"
        found.append(_level("taps", said, "nat per tap", True, means, score))
    contacts = comparison.classes["contacts"].values
    for n in dict.fromkeys((int(contacts[0]), int(contacts[-1]))):
        title = f"class after {n} tap{'s' * (n > 1)}"
        scores = comparison.classes.sel(contacts=n)
        found.append(_level(title, f"inferring the {title}", "nat", True, scores, "log_score_joint"))
    unit = comparison.grid.what_error_unit
    for policy in comparison.equal["policy"].values:
        taps = _ranking_time(comparison.equal, str(policy))
        if taps is None:
            continue
        at = comparison.equal.sel(policy=policy, taps=taps)
        title = f"{policy} object error at {taps:g} tap{'s' * (taps != 1)}"
        found.append(_level(title, title, "" if unit == "P(wrong)" else unit, False, at, "what_error"))
    return [level for level in found if level.values]


def point_fits(means: xr.Dataset) -> list[str]:
    """Models whose posterior is a single point, as after a fit of most probable values: both scores are equal."""
    if "integrated" not in means:
        return []
    alike = np.isclose(means["integrated"], means["plug_in"], rtol=_ALIKE, atol=0.0)
    return [str(name) for name in means["model"].values[alike]]


def rank_rows(levels: Sequence[Criterion], names: Sequence[str]) -> list[Row]:
    """A row per model: its rank and value at each level, `None` where it has none."""
    return [
        {
            "name": name,
            "levels": [
                {"rank": level.rank(name), "value": level.values[name]} if name in level.values else None
                for level in levels
            ],
        }
        for name in names
    ]


def headline(levels: Sequence[Criterion], reference: str) -> str:
    """Which models are best at what, and by how sure a difference; empty where a single model is ranked."""
    ranked = _ranked(levels)
    return f"{_best_at(ranked)} {_unsure(ranked, reference)}".strip() if ranked else ""


def _best_at(ranked: Sequence[Criterion]) -> str:
    always = [name for name in ranked[0].best if all(name in level.best for level in ranked)]
    if always:
        levels_named = "at all levels" if len(ranked) > 1 else f"in {ranked[0].said}"
        return f"{listed(always)} {'is' if len(always) == 1 else 'are equally'} best {levels_named}."
    at: dict[tuple[str, ...], list[str]] = {}
    for level in ranked:
        at.setdefault(tuple(level.best), []).append(level.said)
    (first, said), *others = at.items()
    parts = [f"{listed(first)} {'is' if len(first) == 1 else 'are equally'} best in {listed(said)}"]
    parts += [f"{listed(names)} {'equally ' * (len(names) > 1)}in {listed(said)}" for names, said in others]
    return f"No model is best at all levels: {'; '.join(parts)}."


def _unsure(ranked: Sequence[Criterion], reference: str) -> str:
    """At which levels the best model may be no better than the second."""
    within, without = [], []
    for level in ranked:
        found = None if level.second is None else _difference(level, level.second, reference)
        if found is None:
            continue
        _, low, high = found
        if low is None or high is None:
            without.append(level.said)
        elif low <= 0 <= high:
            within.append(level.said)
    said = [f"is not significant in {listed(within)}"] if within else []
    said += [f"has no interval in {listed(without)}"] if without else []
    return f"The difference from the second {' and '.join(said)}." if said else ""


def best_rows(levels: Sequence[Criterion], reference: str) -> list[Row]:
    """A row per level at which several models are ranked: the best one beside the second and the reference model.

    `second` is `None` where all are equally good, and `less_second` and `less_reference`, differences with the ends of
    their intervals, where there is no such model or it is itself the best. Ends are `None` without an interval.
    """
    return [
        {
            "title": level.title,
            "unit": level.unit,
            "best": level.best,
            "value": level.values[level.best[0]],
            "second": level.second,
            "second_value": None if level.second is None else level.values[level.second],
            "less_second": None if level.second is None else _difference(level, level.second, reference),
            "less_reference": _difference(level, reference, reference),
        }
        for level in _ranked(levels)
    ]


def _ranked(levels: Sequence[Criterion]) -> list[Criterion]:
    """Levels at which there is something to rank."""
    return [level for level in levels if len(level.values) > 1]


def _level(title: str, said: str, unit: str, larger: bool, data: xr.Dataset, name: str) -> Criterion:
    ends = {
        kind: {key: (low[key], high[key]) for key in low if key in high}
        for kind in ("difference", "step")
        for low, high in [[_finite(data[f"{name}_{kind}_{end}"]) for end in ("low", "high")]]
    }
    return Criterion(title, said, unit, larger, _finite(data[name]), **ends)


def _finite(values: xr.DataArray) -> dict[str, float]:
    pairs = zip(values["model"].values, values.values, strict=True)
    return {str(name): float(value) for name, value in pairs if np.isfinite(value)}


def _ranking_time(equal: xr.Dataset, policy: str) -> float | None:
    """The longest mean reaction time that all models reach, or else most."""
    at = equal.sel(policy=policy)
    if not at.sizes["taps"]:
        return None
    reached = np.isfinite(at["what_error"].values).sum(axis=0)
    return float(at["taps"].values[np.flatnonzero(reached == reached.max())[-1]])


def _difference(level: Criterion, other: str, reference: str) -> list[float | None] | None:
    """The best model's value less another's, and the ends of the interval."""
    if other not in level.values or other in level.best:
        return None
    best = reference if reference in level.best else level.best[0]
    if reference in (best, other):
        ends, flipped = level.difference.get(other if best == reference else best), best == reference
    elif len(level.best) > 1:  # steps lead from one of equal models to the other
        ends, flipped = None, False
    else:
        ends, flipped = level.step.get(best if level.larger else other), not level.larger
    low, high = (None, None) if ends is None else (-ends[1], -ends[0]) if flipped else ends
    return [level.values[best] - level.values[other], low, high]
