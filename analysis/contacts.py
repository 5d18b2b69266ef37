"""How accuracy grows with the number of contacts on one class, without stopping rule or moves."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from ..inference.saturation import share, temper
from ..inference.trial_plan import TapTable
from ..models import seeds
from ..models.states import fold
from .metrics import CONFIDENCE

CONTACTS = (1, 2, 5, 10, 20)
_DRAWS = 50
# Share of the classes that must have n distinct test taps: with fewer, dropping the hard ones would look like growth.
_ENOUGH = 0.9


class Accuracy(NamedTuple):
    """Share of right answers after n contacts, averaged over the test taps' classes.

    Attributes:
        contacts: n.
        classes: Number of classes with at least n distinct test taps; only they count.
        hits: Share of right joint, where and what answers in each of those classes, shape (classes, 3).
        weight: Number of test taps of each, shape (classes,).
    """

    contacts: int
    classes: int
    hits: NDArray[np.float64]
    weight: NDArray[np.float64]


def accuracy(table: TapTable, seed: int, contacts: Sequence[int] = CONTACTS) -> list[Accuracy]:
    """Accuracy after each number of contacts that some class has distinct test taps for.

    One contact uses every test tap once; more are drawn without replacement, 50 times per class. A number that less
    than nine tenths of the classes have test taps for is left out. Taps that leave no class possible count as wrong.

    Args:
        table: Test taps.
        seed: Of the draws.
        contacts: Numbers of contacts.
    """
    generator = seeds.generator(seed, seeds.Purpose.CONTACTS)
    rows = []
    for n in contacts:
        cells = np.argwhere(table.pool.count >= n)
        if len(cells) < _ENOUGH * np.count_nonzero(table.pool.count):
            continue
        hits = [_hits(table, l, m, _draw(table, l, m, n, generator)) for l, m in cells]
        weight = table.pool.count[cells[:, 0], cells[:, 1]].astype(np.float64)
        rows.append(Accuracy(n, len(cells), np.array(hits), weight))
    return rows


def summarise(rows: Sequence[Accuracy]) -> dict[str, float | int]:
    """Accuracies of one number of contacts pooled over data sets, with intervals, see `accuracy_interval_sentence`.

    Args:
        rows: The same number of contacts in every data set.
    """
    hits = np.concatenate([row.hits for row in rows])
    weight = np.concatenate([row.weight for row in rows])
    weight = weight / weight.sum()
    mean = weight @ hits
    if len(rows) > 1:
        means = np.array([row.weight @ row.hits / row.weight.sum() for row in rows])
        half = t.ppf(0.5 + CONFIDENCE / 2, len(rows) - 1) * means.std(axis=0, ddof=1) / np.sqrt(len(rows))
    else:
        # Sampling variance of a weighted mean over independent classes.
        variance = (weight**2) @ (hits - mean) ** 2 * len(hits) / max(len(hits) - 1, 1)
        half = norm.ppf(0.5 + CONFIDENCE / 2) * np.sqrt(variance)
    summary: dict[str, float | int] = {"contacts": rows[0].contacts, "classes": max(row.classes for row in rows)}
    for i, name in enumerate(("joint", "where", "what")):
        summary[name] = float(mean[i])
        summary[f"{name}_low"] = float(max(0.0, mean[i] - half[i]))
        summary[f"{name}_high"] = float(min(1.0, mean[i] + half[i]))
    return summary


def accuracy_interval_sentence(data_sets: int) -> str:
    """What the intervals of `summarise` mean, in a sentence."""
    if data_sets > 1:
        return f"Intervals are {CONFIDENCE:.0%} t-intervals of the mean over {data_sets} data sets."
    return (
        f"Intervals are {CONFIDENCE:.0%} normal intervals that take classes as the units, as taps of one err together."
    )


def _draw(table: TapTable, l: int, m: int, n: int, generator: np.random.Generator) -> NDArray[np.intp]:
    """Tap indices, shape (draws, n)."""
    first, count = table.pool.first[l, m], table.pool.count[l, m]
    own = table.pool.order[first : first + count]
    if n == 1:
        return own[:, np.newaxis]
    return np.stack([generator.choice(own, size=n, replace=False) for _ in range(_DRAWS)])


def _hits(table: TapTable, l: int, m: int, taps: NDArray[np.intp]) -> tuple[float, float, float]:
    log_belief = table.log_prior + table.log_likelihood[taps].sum(axis=1)
    left = (log_belief > -np.inf).any(axis=(1, 2))
    log_belief = np.where(left[:, np.newaxis, np.newaxis], log_belief, 0.0)
    log_belief = temper(log_belief, share(taps.shape[1], table.saturation))
    belief = fold(np.exp(log_belief - log_belief.max(axis=(1, 2), keepdims=True)), table.pool.nearest.shape[1])
    joint = belief.reshape(len(belief), -1).argmax(axis=1) == l * belief.shape[2] + m
    where = belief.sum(axis=2).argmax(axis=1) == l
    what = belief.sum(axis=1).argmax(axis=1) == m
    return (joint & left).mean(), (where & left).mean(), (what & left).mean()
