"""Rank of each model at each level of a comparison, and disagreement between the levels."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from ..page.numbers import number, spanned
from ..page.page import Row
from .run import Comparison

_ALIKE = 1e-9


class Criterion(NamedTuple):
    """One way to rank models.

    Attributes:
        title: For the head of a column.
        said: What the best model does, for a sentence.
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
        """Rank of a model: 1 plus the number of better ones; ties share a rank."""
        sign = 1 if self.larger else -1
        return 1 + sum(sign * value > sign * self.values[name] for value in self.values.values())

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
        said, score = f"predicts the taps of a left-out {means.attrs['unit']} best", "integrated"
        if point_fits(means):  # an integral over a posterior predicts better than a point does
            said, score = f"{said}, by plug-in parameters", "plug_in"
        found.append(_level("taps", said, "nat per tap", True, means, score))
    contacts = comparison.classes["contacts"].values
    for n in dict.fromkeys((int(contacts[0]), int(contacts[-1]))):
        title = f"class after {n} tap{'s' * (n > 1)}"
        scores = comparison.classes.sel(contacts=n)
        found.append(_level(title, f"infers the {title} best", "nat", True, scores, "log_score_joint"))
    unit = comparison.grid.what_error_unit
    for policy in comparison.equal["policy"].values:
        taps = _ranking_time(comparison.equal, str(policy))
        if taps is None:
            continue
        at = comparison.equal.sel(policy=policy, taps=taps)
        number_of = f"{taps:g} tap{'s' * (taps != 1)}"
        title = f"{policy} object error at {number_of}"
        said = f"has the lowest {policy} object error at a mean reaction time of {number_of}"
        found.append(_level(title, said, "" if unit == "P(wrong)" else unit, False, at, "what_error"))
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


def findings(levels: Sequence[Criterion], reference: str, own: Sequence[str] = ()) -> list[str]:
    """Sentences: the best model at each level, by how much, and how the best predictor and own models do at the others.

    The best model is compared with the second and with the reference model.

    Args:
        levels: See `levels`.
        reference: The reference model.
        own: Models that are to be in a sentence at every level.
    """
    sentences = []
    for level in levels:
        if len(level.values) == 1 < max(len(other.values) for other in levels):
            continue  # no other model has a value
        best = reference if reference in level.best else level.best[0]
        equal = [name for name in level.best if name != best]
        sentence = f"{best} {level.said}: {_value(level, best)}"
        sentence += f" (equally good: {', '.join(equal)})" * bool(equal)
        first = levels[0].best[0]
        predicts = f"{first}, which {'predicts taps best' if levels[0].title == 'taps' else levels[0].said}"
        second = None if equal and best != reference else level.second  # of equal ones, which has the interval?
        others = dict.fromkeys(name for name in (second, reference) if name in level.values and name != best)
        for number_of, other in enumerate(others):
            named = predicts if other == first else other
            sentence += f"{'; and with' if number_of else ', compared with'} {_value(level, other)} for {named}"
            sentence += _interval(level, best, other, reference)
        for name in dict.fromkeys((first, *own)):
            if name not in (*level.best, *others) and name in level.values:
                sentence += f"; {f'{predicts},' if name == first else name} has {_value(level, name)}"
        sentences.append(sentence + ".")
    if levels and not set.intersection(*(set(level.best) for level in levels)):
        sentences.append("No model is best at all levels; see the table of ranks.")
    return sentences


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


def _value(level: Criterion, name: str) -> str:
    return f"{number(level.values[name])} {level.unit}".strip()


def _interval(level: Criterion, best: str, other: str, reference: str) -> str:
    """The difference of the best model to the reference or to the second."""
    if reference in (best, other):
        ends, flipped = level.difference.get(other if best == reference else best), best == reference
    else:
        ends, flipped = level.step.get(best if level.larger else other), not level.larger
    if ends is None:
        why = "too few test taps" if level.larger else "too close to the end of a curve"
        return f" ({why} for an interval)"
    low, high = (-ends[1], -ends[0]) if flipped else ends
    unsure = ", not significant" if low <= 0 <= high else ""
    return f"; difference {spanned(level.values[best] - level.values[other], low, high)}{unsure}"
