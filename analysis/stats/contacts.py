"""Accuracy against the number of contacts on one class, without stopping rule or moves."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ...inference.filter import fold, share, temper
from ...inference.trials.records import TapTable
from ...inference.trials.resampling import Spread, widened
from ...models import seeds
from ...models.grid import TapPool
from ...models.threads import cores, in_order
from .metrics import CONFIDENCE, NO_SPREAD, with_noise

CONTACTS = (1, 2, 5, 10, 20)
_DRAWS = 50
_RESAMPLED_DRAWS = 1000  # on a resample, of all classes together
_AT_ONCE = 1 << 18  # beliefs of classes worked on at a time
# Share of the classes that must have n distinct test taps: with fewer, dropping the hard ones would look like growth.
_ENOUGH = 0.9


class Accuracy(NamedTuple):
    """Share of right answers after n contacts, averaged over the test taps' classes.

    Attributes:
        contacts: n.
        classes: Number of classes with at least n distinct test taps in a session; only they count.
        hits: Share of right joint, where and what answers in each of those classes and sessions, shape (cells, 3).
        weight: Number of test taps of each, shape (cells,).
        noise: Variance of the mean over classes by the draws of contacts, shape (3,).
        resampled: The mean over classes on resamples of the test taps, shape (R, 3).
        resampled_noise: Mean of their variance by the draws of contacts, shape (3,).
        resampled_draws: How many draws of each class they have.
        several: Whether there are several answers of each kind, shape (3,); else none can be wrong.
    """

    contacts: int
    classes: int
    hits: NDArray[np.float64]
    weight: NDArray[np.float64]
    noise: NDArray[np.float64] = np.zeros(3)
    resampled: NDArray[np.float64] = np.empty((0, 3))
    resampled_noise: NDArray[np.float64] = np.zeros(3)
    resampled_draws: int = _DRAWS
    several: NDArray[np.bool_] = np.ones(3, dtype=np.bool_)

    @property
    def mean(self) -> NDArray[np.float64]:
        """Share of right joint, where and what answers, classes weighed by their taps, shape (3,)."""
        return self.weight @ self.hits / self.weight.sum()


def accuracy(
    table: TapTable, seed: int, contacts: Sequence[int] = CONTACTS, pools: Sequence[TapPool] = ()
) -> list[Accuracy]:
    """Accuracy after each number of contacts that some class has distinct test taps for.

    One contact uses every test tap once; more are drawn without replacement, 50 times per class. A number that less
    than nine tenths of the classes have test taps for is left out. Taps that leave no class possible count as wrong.
    """
    single = np.empty((len(table.log_likelihood), 3))
    cell = np.empty(len(single), np.intp)
    (L, M), count = table.pool.shape, table.pool.count.ravel()
    cell[table.pool.order] = np.repeat(np.arange(len(count)) % (L * M), count)
    single[table.pool.order] = _right(table, table.pool.order[:, np.newaxis], cell[table.pool.order])

    def on(task: tuple[int, TapPool], n: int, draws: int) -> Accuracy | None:
        number, pool = task
        generator = seeds.generator(seed, seeds.Purpose.CONTACTS, number, n)
        return _accuracy(table, pool, n, draws, single, generator)

    rows = []
    for n in contacts:
        row = on((0, table.pool), n, _DRAWS)
        if row is None:
            continue
        if pools:
            draws = int(np.clip(_RESAMPLED_DRAWS // row.classes, 2, _DRAWS))
            tasks = (partial(on, task, n, draws) for task in enumerate(pools, 1))
            played = [part for part in in_order(tasks, cores(None)) if part is not None]
            if played:
                resampled = np.full((len(pools), 3), np.nan)
                resampled[: len(played)] = [part.mean for part in played]
                noise = np.mean([part.noise for part in played], axis=0)
                row = row._replace(resampled=resampled, resampled_noise=noise, resampled_draws=draws)
        rows.append(row._replace(several=np.array([L * M > 1, L > 1, M > 1])))
    return rows


def summarise(rows: Sequence[Accuracy], spread: Spread = NO_SPREAD) -> dict[str, float | int]:
    """Accuracies of one number of contacts pooled over data sets, with intervals, see `accuracy_interval_sentence`."""
    hits = np.concatenate([row.hits for row in rows])
    weight = np.concatenate([row.weight for row in rows])
    mean = (weight / weight.sum()) @ hits
    first = rows[0]
    if len(rows) > 1:
        means = np.array([row.mean for row in rows])
        error = spread.factor * means.std(axis=0, ddof=1) / np.sqrt(len(rows))
        half = stdtrit(len(rows) - 1, 0.5 + CONFIDENCE / 2) * error
        ends, center = (np.clip(mean - half, 0, 1), np.clip(mean + half, 0, 1)), mean
    elif len(first.resampled):
        drawn = with_noise(
            first.resampled.T, first.noise, first.resampled_noise, first.resampled_draws / _DRAWS, spread.factor
        )
        samples = np.concatenate([mean[:, np.newaxis], drawn], axis=1)
        ends, center = spread.interval(samples, 0, 1), spread.center(samples)
    else:
        ends, center = (np.full(3, np.nan), np.full(3, np.nan)), mean
    independent = len(rows) * spread.taps / first.contacts
    low, high = widened(ends[0], ends[1], mean, center, independent, first.several.astype(np.float64))
    summary: dict[str, float | int] = {"contacts": first.contacts, "classes": max(row.classes for row in rows)}
    for i, name in enumerate(("joint", "where", "what")):
        summary[name] = float(mean[i])
        summary[f"{name}_low"] = float(low[i])
        summary[f"{name}_high"] = float(high[i])
    return summary


def _accuracy(
    table: TapTable,
    pool: TapPool,
    n: int,
    draws: int,
    single: NDArray[np.float64],
    generator: np.random.Generator,
) -> Accuracy | None:
    """Accuracy after n contacts on one selection of the test taps; `None` where too few classes have as many.

    Args:
        table: Test taps.
        pool: The selection.
        n: Contacts.
        draws: Of each class, for n above 1.
        single: Whether each tap alone gives the right joint, where and what answer, shape (N, 3).
        generator: Of the draws.
    """
    count, first, classes = pool.count.ravel(), pool.first.ravel(), pool.per_class.size
    cells = np.flatnonzero(count >= n)
    if len(cells) < _ENOUGH * np.count_nonzero(count):
        return None
    if n == 1:
        right, size = single[pool.order], count[cells]
    else:
        cell = np.repeat(cells, draws)
        right, size = _right(table, _draw(pool.order, first[cell], count[cell], n, generator), cell % classes), draws
    group = np.repeat(np.arange(len(cells)), size)
    number = np.bincount(group)[:, np.newaxis]
    hits = np.column_stack([np.bincount(group, column) for column in right.T]) / number
    weight = count[cells].astype(np.float64)
    noise = np.zeros(3) if n == 1 else (weight / weight.sum()) ** 2 @ (hits * (1 - hits) / np.maximum(number - 1, 1))
    return Accuracy(n, len(np.unique(cells % classes)), hits, weight, noise)


def _draw(
    order: NDArray[np.intp],
    first: NDArray[np.intp],
    count: NDArray[np.intp],
    n: int,
    generator: np.random.Generator,
) -> NDArray[np.intp]:
    """Numbers of distinct taps, shape (draws, n), in each row of the `count` that begin at `first` in `order`."""
    place = np.empty((len(first), n), np.intp)
    for i in range(n):  # Floyd's sampling: of the first j + 1 one, or the last of them where that one is taken
        j = count - n + i
        chosen = (generator.random(len(first)) * (j + 1)).astype(np.intp)
        taken = (place[:, :i] == chosen[:, np.newaxis]).any(axis=1)
        place[:, i] = np.where(taken, j, chosen)
    return order[first[:, np.newaxis] + place]


def _right(table: TapTable, taps: NDArray[np.intp], cell: NDArray[np.intp]) -> NDArray[np.float64]:
    """Whether the joint, where and what answers to sequences of taps are right, shape (n, 3).

    Args:
        table: Test taps.
        taps: Their numbers, shape (n, contacts).
        cell: l M + m of the class that each sequence is of, shape (n,).
    """
    _, M = table.pool.shape
    step = max(1, _AT_ONCE // table.log_prior.size)
    parts = []
    for begin in range(0, len(taps), step):
        part, own = taps[begin : begin + step], cell[begin : begin + step]
        log_belief = table.log_prior + table.log_likelihood[part[:, 0]]
        for column in part.T[1:]:
            log_belief += table.log_likelihood[column]
        left = (log_belief > -np.inf).any(axis=(1, 2))  # where no class is left, no answer is right
        log_belief = np.where(left[:, np.newaxis, np.newaxis], log_belief, 0.0)
        log_belief = temper(log_belief, share(taps.shape[1], table.saturation))
        belief = fold(np.exp(log_belief - log_belief.max(axis=(1, 2), keepdims=True)), M)
        joint = belief.reshape(len(belief), -1).argmax(axis=1) == own
        where = belief.sum(axis=2).argmax(axis=1) == own // M
        what = belief.sum(axis=1).argmax(axis=1) == own % M
        parts.append(np.column_stack([joint & left, where & left, what & left]))
    return np.concatenate(parts).astype(np.float64)
