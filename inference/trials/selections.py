"""Selections of the test taps for `resampling`, which show the sampling variation of results."""

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...models import seeds
from ...models.grid import FEW_TAPS, TapPool, pool_of, sessions_alike
from .records import TapTable

LEFT_OUT = 1 / 3
"""Mean number left out for each that stays in `thinned_pools`, so that these vary a third as much as data sets do."""
_KEPT = 1 << 20  # taps of all selections of a table that are kept
_DROPPED = 0.5  # of the resamples lack a class of one tap


def resampled_pools(table: TapTable, resamples: int, seed: int) -> Iterator[TapPool]:
    """Pool of a table, then resamples of the taps of each class with replacement.

    Where several sessions test, see `session_sizes`, each is left out in turn instead. Where most classes have several
    taps, classes of one are left out in half of the resamples, see `uncaught`.

    Args:
        table: Test taps; only their classes and sessions matter.
        resamples: How many.
        seed: Random seed of the resamples.
    """
    return _pools(table, resamples, seed, _Group.drawn)


def thinned_pools(table: TapTable, resamples: int, seed: int) -> Iterator[TapPool]:
    """Pool of a table, then selections without a quarter of the taps of each class.

    Where a quarter of a number is no whole one, one more is left out so often that the number left out for each that
    stays is 1/3 on average. Where most classes have several taps, classes of one are left out in half of the
    selections, see `uncaught`. Where several sessions test, see `session_sizes`, each is left out in turn instead.

    Args:
        table: Test taps; only their classes and sessions matter.
        resamples: How many.
        seed: Random seed of the selections.
    """
    return _pools(table, resamples, seed, _Group.thinned)


def session_sizes(table: TapTable) -> NDArray[np.intp]:
    """Number of taps of each session that a repeated study would redraw.

    These are the sessions that test, if they hold the same classes, see `sessions_alike`. If not, taps count as drawn,
    all as of one session.
    """
    taps, cell = _in_classes(table)
    L, M = table.pool.shape
    session = sessions_of(table)[taps]
    if not sessions_alike(cell % (L * M), session):
        return np.array([len(taps)])
    return np.unique(session, return_counts=True)[1]


def sessions_drawn(table: TapTable) -> int:
    """Number of sessions that a repeated study would redraw; 1 if only taps, see `session_sizes`."""
    return len(session_sizes(table))


def sessions_in_words(table: TapTable) -> str:
    """Sentence on the sessions that a trial draws taps of; empty where one tests."""
    tested = np.unique(sessions_of(table)[table.pool.order])
    if len(tested) == 1:
        return ""
    if len(table.pool.count) > 1:
        return f"Each trial stays in one of the {len(tested)} test sessions."
    why = f"a class has fewer than {FEW_TAPS} taps in one" if sessions_drawn(table) > 1 else "they hold other classes"
    return (
        f"Each trial draws taps of all {len(tested)} test sessions, as {why}, so differences between sessions average "
        "out; errors within one session may be larger."
    )


def _pools(
    table: TapTable, resamples: int, seed: int, select: Callable[["_Group", np.random.Generator], NDArray[np.intp]]
) -> Iterator[TapPool]:
    """Pool of a table, then `select` of its taps, or all sessions but one."""
    yield table.pool
    taps, cell = _in_classes(table)
    known = _Taps(taps.tobytes(), cell.tobytes(), sessions_of(table)[taps].tobytes(), table.pool.count.shape)
    if resamples * len(taps) > _KEPT:
        yield from _selected(known, sessions_drawn(table), resamples, seed, select)
    else:
        yield from _kept(known, sessions_drawn(table), resamples, seed, select)


class _Taps(NamedTuple):
    """Taps sorted by session and class, their class and session, as bytes of arrays, and the shape (S, L, M)."""

    taps: bytes
    cell: bytes
    session: bytes
    shape: tuple[int, int, int]


def _selected(
    known: _Taps,
    drawn: int,
    resamples: int,
    seed: int,
    select: Callable[["_Group", np.random.Generator], NDArray[np.intp]],
) -> Iterator[TapPool]:
    """`_pools` but the first."""
    taps, cell, session = (np.frombuffer(part, np.intp) for part in known[:3])
    sessions = [np.flatnonzero(session == s) for s in np.unique(session)]
    group, generator = _Group.of_taps(cell), seeds.generator(seed, seeds.Purpose.RESAMPLES)
    for r in range(resamples):
        if drawn > 1:
            selected = np.concatenate([member for s, member in enumerate(sessions) if s != r % drawn])
        else:
            selected = select(group, generator)
        yield pool_of(taps[selected], cell[selected], known.shape)


@lru_cache(maxsize=4)
def _kept(*arguments: Any) -> list[TapPool]:
    """Selections that models, policies and thresholds share."""
    return list(_selected(*arguments))


def _left_out(size: NDArray[np.intp], generator: np.random.Generator) -> NDArray[np.intp]:
    """Number of groups of these sizes to leave out; on average 1/3 for each that stays."""
    fewer = size // 4
    least, more = fewer / (size - fewer), (fewer + 1) / np.maximum(size - fewer - 1, 1)
    chance = np.where(_alone(size), _DROPPED, (LEFT_OUT - least) / (more - least) * (size > 1))
    return fewer + (generator.random(len(size)) < chance)


def _alone(size: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Mask of classes with a single tap; empty if most classes have no more, as tap variation is then unknown."""
    return (size == 1) & (np.median(size) > 1)


def uncaught(table: TapTable, factor: float) -> tuple[float, float]:
    """Ratio of the variance of a mean over classes to that of its resamples, and its degrees of freedom.

    A class of one tap does not vary by itself. It is left out in half of the resamples instead: the mean over classes
    then varies with how such classes differ from the others, that is by their taps and more, a quarter as much as it
    would if each were drawn anew. What is missing is taken from the classes with more taps, each of which counts more
    where others are left out. So few taps tell their variance, with few degrees of freedom (Satterthwaite 1946).

    Args:
        table: Test taps.
        factor: By which deviations of resamples are enlarged.

    Returns:
        Without a lone tap 1 and infinite.
    """
    size = table.pool.per_class[table.pool.per_class > 0]
    alone = np.count_nonzero(_alone(size))
    others, counts = (1 / size[size > 1]).sum(), len(size) / (len(size) - _DROPPED * alone)
    if not alone:
        return 1.0, np.inf
    caught = counts**2 * (others + alone * factor**2 * _DROPPED * (1 - _DROPPED))
    parts = alone**2 / max(alone - 1, 1) + others**2 / (size - 1).sum()
    return float((others + alone) / caught), float((others + alone) ** 2 / parts)


class _Group(NamedTuple):
    """Taps grouped by class.

    Attributes:
        first: Where each class begins among them, shape (classes,).
        size: How many it has, shape (classes,).
        of: Class of each tap, by its place among those that are there, shape (n,).
    """

    first: NDArray[np.intp]
    size: NDArray[np.intp]
    of: NDArray[np.intp]

    @classmethod
    def of_taps(cls, cell: NDArray[np.intp]) -> Self:
        """Group of taps sorted by class (n,)."""
        _, first, of, size = np.unique(cell, return_index=True, return_inverse=True, return_counts=True)
        return cls(first, size, of)

    def drawn(self, generator: np.random.Generator) -> NDArray[np.intp]:
        """Resample with replacement, class by class."""
        selected = self.first[self.of] + (generator.random(len(self.of)) * self.size[self.of]).astype(np.intp)
        alone = _alone(self.size)
        if not alone.any():
            return selected
        return selected[~(alone & (generator.random(len(alone)) < _DROPPED))[self.of]]

    def thinned(self, generator: np.random.Generator) -> NDArray[np.intp]:
        """Three quarters of each class, in random order."""
        shuffled = np.lexsort((generator.random(len(self.of)), self.of))
        rank = np.arange(len(self.of)) - self.first[self.of]  # classes are in order
        return shuffled[rank >= _left_out(self.size, generator)[self.of]]


def _in_classes(table: TapTable) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Taps sorted by session and class, and these as (s L + l) M + m."""
    pool = table.pool
    count = pool.count.ravel()
    cell = np.repeat(np.arange(len(count)), count)
    taps = np.concatenate([pool.order[f : f + n] for f, n in zip(pool.first.flat, count, strict=True)])
    return taps, cell


def sessions_of(table: TapTable) -> NDArray[np.intp]:
    """Session of each tap of a table, shape (N,)."""
    N = len(table.log_likelihood)
    return np.zeros(N, np.intp) if table.session is None else np.asarray(table.session, np.intp)
