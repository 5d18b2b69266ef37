"""Models compared by classification after fixed numbers of taps, without stopping rule or moves.

All models see the same sequences of distinct test taps, and the same sequences from resamples of these taps, so that
differences pair; see `inference.trials.resampling` for what is drawn anew and how that gives intervals.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import groupby
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...inference.filter import share
from ...inference.trials.judged_sequences import without_replacement
from ...inference.trials.records import TapTable
from ...inference.trials.resampling import CONFIDENCE, spread
from ...inference.trials.selections import thinned_pools
from ...models import seeds
from ...models.errors import InputError
from ...models.grid import TapPool
from ...models.threads import cores, in_order
from ..stats.contacts import CONTACTS
from ..stats.pairing import check_tables, reference_name, with_intervals
from .scored import score

MEANS = {
    "log_score_joint": "mean log belief in the true class",
    "log_score_what": "mean log belief in the true object",
    "brier_joint": "Brier score over classes",
    "brier_what": "Brier score over objects",
    "accuracy_joint": "fraction of right classes",
    "accuracy_where": "fraction of right positions",
    "accuracy_what": "fraction of right objects",
    "impossible": "fraction of sequences whose true class has belief 0",
    "no_class_left": "fraction of sequences that are impossible under every class",
}
RANKED = "log_score_joint"
"""By which models are ranked."""
IMPOSSIBLE = ("impossible", "no_class_left")
CALIBRATIONS = {
    "calibration_what": "calibration error of the belief in the most probable object",
    "calibration_where": "calibration error of the belief in the most probable position",
}
_UNKNOWN = np.full(len(MEANS) + len(CALIBRATIONS), np.nan)  # of a resample in which too few classes have the taps
CALIBRATION_BINS = 10
_DIGITS = 12  # of beliefs, below which they are equal
_DRAWS, _RESAMPLE_DRAWS = 50, 20  # per class, at least
# Share of the classes that must have n distinct test taps: with fewer, dropping the hard ones would look like growth.
_ENOUGH = 0.9
_RESAMPLES = 100


type _Class = tuple[int, int, list[NDArray[np.intp]]]
"""Where and what class, and its taps in each session."""


class _Sequences(NamedTuple):
    """Sequences of n taps of one class.

    Attributes:
        taps: Shape (sequences, n).
        where: Their where class, shape (sequences,).
        what: Their what class, shape (sequences,).
        weight: How many test taps each stands for, shape (sequences,).
    """

    taps: NDArray[np.intp]
    where: NDArray[np.intp]
    what: NDArray[np.intp]
    weight: NDArray[np.float64]

    def part(self, piece: slice) -> "_Sequences":
        """Some of them."""
        return _Sequences(self.taps[piece], self.where[piece], self.what[piece], self.weight[piece])


class _Scores(NamedTuple):
    """What a model scores on sequences.

    Attributes:
        values: `MEANS` of each sequence in that order, shape (sequences, 9).
        top: Belief in the most probable object and position, shape (sequences, 2).
        hit: Whether these are right, shape (sequences, 2).
    """

    values: NDArray[np.float64]
    top: NDArray[np.float64]
    hit: NDArray[np.float64]

    def part(self, piece: slice | NDArray[np.intp]) -> "_Scores":
        """Some of them."""
        return _Scores(self.values[piece], self.top[piece], self.hit[piece])


def class_scores(
    tables: Mapping[str, TapTable],
    seed: int,
    contacts: Sequence[int] = CONTACTS,
    reference: str | None = None,
    resamples: int = _RESAMPLES,
) -> xr.Dataset:
    """Scores of every model after each number of contacts, with intervals and paired differences to one of them.

    One contact uses every test tap once; more are drawn without replacement, at least 50 times per class, from one
    session each. Classes count by their test taps. A number that less than nine tenths of the classes have test taps
    for in some session is left out. What is drawn for one number does not depend on the others.

    A log score is -inf where the belief in the true class of some sequence is 0, and stays so: nothing is dropped or
    floored, and `impossible` tells how many these are, `no_class_left` how many of them are impossible under every
    class: these count as wrong, with belief 0 in everything. The interval ends in -inf where resamples do; the
    difference of two models that both score -inf is NaN.

    The calibration error is the mean distance between belief and fraction right, over `CALIBRATION_BINS` bins of
    about equally many sequences by belief, equal beliefs in one bin. Noise makes it larger, by chance and not by
    miscalibration: see `stats.pairing.with_intervals` for its interval.

    Args:
        tables: The same test taps as every model sees them, by the model's name.
        seed: Of the draws and the resamples.
        contacts: Numbers of contacts.
        reference: Model that the others are compared with, by default the first.
        resamples: Of the test taps.

    Returns:
        Dims (model, contacts): `MEANS` (log scores in nats) and `CALIBRATIONS`, each with `_low`, `_high`,
        `_difference` (model less reference), `_difference_low` and `_difference_high`; of `RANKED` also `_step`,
        see `stats.pairing.with_intervals`; and over (contacts) the numbers of `classes` and `sequences`.

    Raises:
        InputError: The tables do not hold the same taps, or no number of contacts is left.
    """
    check_tables(tables)
    if resamples < 1:
        raise InputError(f"Intervals need at least one resample, got {resamples}.")
    names = list(tables)
    base = names.index(reference_name(names, reference))
    table = tables[names[0]]
    N = len(table.log_likelihood)
    session = np.zeros(N, dtype=np.intp) if table.session is None else np.asarray(table.session)
    pools = [_by_class(pool, session) for pool in thinned_pools(table, resamples, seed)]
    answered, samples, classes, count = [], [], [], []
    for n in dict.fromkeys(contacts):
        sequences = _draw(pools[0], n, seeds.generator(seed, seeds.Purpose.CONTACT_SCORES, n, 0))
        if sequences is None:
            continue
        generator = seeds.generator(seed, seeds.Purpose.CONTACT_SCORES, n, 1)
        drawn = [_draw(pool, n, generator, _RESAMPLE_DRAWS) for pool in pools[1:]]
        samples.append([_samples(table, sequences, drawn) for table in tables.values()])
        answered.append(n)
        classes.append(len(np.unique(np.stack([sequences.where, sequences.what]), axis=1).T))
        count.append(len(sequences.taps))
    if not answered:
        raise InputError(f"Too few classes have test taps for sequences of {', '.join(map(str, contacts))} taps.")
    joined = np.array(samples).swapaxes(0, 1)  # (model, contacts, 1 + 3 resamples, quantity)
    result = xr.Dataset(
        {"classes": ("contacts", np.array(classes)), "sequences": ("contacts", np.array(count))},
        {"model": np.array(names, dtype=np.str_), "contacts": np.array(answered)},
        {
            "reference": names[base],
            "seed": seed,
            "resamples": resamples,
            "calibration_bins": CALIBRATION_BINS,
        },
    )
    how, independent = (
        spread(table, noise=_RESAMPLE_DRAWS / _DRAWS, thinned=True),
        int(table.pool.count.sum()) / np.array(answered),
    )
    L, M = table.pool.shape
    answers = {"accuracy_where": L, "accuracy_what": M}
    for i, (name, meaning) in enumerate((MEANS | CALIBRATIONS).items()):
        attributes = {"long_name": meaning, "units": "nat" if name.startswith("log_score") else ""}
        result.update(
            with_intervals(
                name,
                joined[..., i],
                ("model", "contacts"),
                base,
                attributes,
                how,
                limits=_limits(name),
                biased=name in CALIBRATIONS,
                smallest=float(answers.get(name, 2) > 1),
                independent=independent if name.startswith("accuracy") or name in IMPOSSIBLE else None,
                steps=name == RANKED,
            )
        )
    return result


def class_interval_sentence() -> str:
    """Sentence that explains the intervals of `class_scores`."""
    return (
        f"Intervals are {CONFIDENCE:.0%} jackknife intervals, leaving out a quarter of the test taps of each class, "
        "or one test session at a time if there are several, the same for all models."
    )


def _limits(name: str) -> tuple[float, float]:
    """Least and greatest value of a score."""
    if name.startswith("log_score"):
        return -np.inf, 0.0
    return 0.0, 2.0 if name.startswith("brier") else 1.0


def _by_class(pool: TapPool, session: NDArray[np.generic]) -> list[_Class]:
    """The taps of each class that has some, session by session."""
    found: list[_Class] = []
    for l, m in np.argwhere(pool.per_class > 0).tolist():
        own = pool.taps(l, m)
        labels = session[own]
        found.append((l, m, [own[labels == s] for s in np.unique(labels)]))
    return found


def _draw(known: list[_Class], n: int, generator: np.random.Generator, draws: int = _DRAWS) -> _Sequences | None:
    """Sequences of n taps, class by class; `None` where too few classes have so many."""
    if n < 1:
        raise InputError(f"A sequence has at least one contact, got {n}.")
    groups: list[tuple[int, int, NDArray[np.intp], int]] = []
    for l, m, each in known:
        enough = [group for group in each if len(group) >= n]
        total = sum(map(len, enough))
        groups += [(l, m, group, -(-draws * len(group) // total)) for group in enough]
    if not groups:
        return None
    taps, count = [], []
    for (_, wanted), alike in groupby(groups, lambda group: (len(group[2]), group[3])):
        together = np.stack([group for *_, group, _ in alike])  # drawn at once, which takes less time
        drawn = together.reshape(-1, 1) if n == 1 else without_replacement(together, n, wanted, generator)
        taps.append(drawn)
        count += [len(drawn) // len(together)] * len(together)
    if len({group[:2] for group in groups}) < _ENOUGH * len(known):  # not before, so that later draws stay the same
        return None
    where, what, size = np.array([(l, m, len(group)) for l, m, group, _ in groups]).T
    columns = (np.repeat(column, count) for column in (where, what, size / np.array(count)))
    return _Sequences(np.concatenate(taps), *columns)


def _scores(table: TapTable, sequences: _Sequences) -> _Scores:
    n, (count, length) = len(MEANS), sequences.taps.shape
    scores = _Scores(np.empty((count, n)), np.empty((count, 2)), np.empty((count, 2)))
    power, M = share(length, table.saturation), table.pool.shape[1]
    logs = np.ascontiguousarray(table.log_likelihood), np.ascontiguousarray(table.log_prior)
    taps, where, what = map(np.ascontiguousarray, sequences[:3])  # other layouts would be compiled anew
    score(*logs, M, power, taps, where, what, *scores)
    return scores


def _samples(table: TapTable, sequences: _Sequences, drawn: Sequence[_Sequences | None]) -> NDArray[np.float64]:
    """Summaries of sequences, of resampled ones, and of halves of these, as `Spread.interval` wants them in rows.

    Single taps are all used: they are scored once, and nothing varies between halves.
    """
    every, place = _scores(table, sequences), np.empty(len(table.log_likelihood), dtype=np.intp)
    single = sequences.taps.shape[1] == 1
    if single:
        place[sequences.taps[:, 0]] = np.arange(len(sequences.taps))
    first = _summary(every, sequences, _alike(every.top))

    def layers(some: _Sequences | None) -> list[NDArray[np.float64]]:
        if some is None:
            return [_UNKNOWN] * 3
        scores = every.part(place[some.taps[:, 0]]) if single else _scores(table, some)
        alike = _alike(scores.top)
        whole = _summary(scores, some, alike)
        if single:
            return [whole] * 3
        halves = slice(0, None, 2), slice(1, None, 2)
        return [whole, *(_summary(scores.part(half), some.part(half), alike[:, half]) for half in halves)]

    found = in_order((partial(layers, some) for some in drawn), cores(None))
    return np.concatenate([first[np.newaxis], *np.array(list(found)).swapaxes(0, 1)])


def _summary(scores: _Scores, sequences: _Sequences, alike: NDArray[np.intp]) -> NDArray[np.float64]:
    """`MEANS` and `CALIBRATIONS` of sequences, shape (11,), whose beliefs are `_alike`."""
    weight = sequences.weight / sequences.weight.sum()
    columns = [weight @ scores.values]
    for group, top, hit in zip(alike, scores.top.T, scores.hit.T, strict=True):
        gap = np.bincount(_bins(group, weight), weight * (hit - top), CALIBRATION_BINS)
        columns.append(np.abs(gap).sum(keepdims=True))
    return np.concatenate(columns)


def _alike(beliefs: NDArray[np.float64]) -> NDArray[np.intp]:
    """Rank of each belief (n, q) among all, by increasing size, the same where they are equal but for rounding."""
    return np.array([np.unique(belief, return_inverse=True)[1] for belief in beliefs.round(_DIGITS).T])


def _bins(alike: NDArray[np.intp], weight: NDArray[np.float64]) -> NDArray[np.intp]:
    """The calibration bin of each belief by its rank: bins weigh about the same, and equal beliefs share one."""
    mass = np.bincount(alike, weight)
    middle = (np.cumsum(mass) - mass / 2) / mass[mass > 0].sum()
    return np.minimum((middle * CALIBRATION_BINS).astype(np.intp), CALIBRATION_BINS - 1)[alike]
