"""Selections of the test taps, which tell how much a result varies with them: what `inference.resampling` plays on."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..hardware.pool import TapPool, pool_of
from ..models import seeds
from .trial_plan import TapTable

LEFT_OUT = 1 / 3
"""Mean number left out for each that stays in `thinned_pools`, so that these vary a third as much as data sets do."""
_REMAIN = 0.9  # of the classes, without a session


def resampled_pools(table: TapTable, resamples: int, seed: int) -> Iterator[TapPool]:
    """The pool of a table as it is, then resamples of the taps of each class with replacement.

    Where several sessions test, see `sessions_drawn`, each is left out in turn instead.

    Args:
        table: Test taps; only their classes and sessions matter.
        resamples: How many.
        seed: Of the resamples.
    """
    return _pools(table, resamples, seed, _Group.drawn)


def thinned_pools(table: TapTable, resamples: int, seed: int) -> Iterator[TapPool]:
    """The pool of a table as it is, then selections of it that leave out a quarter of the taps of each class.

    Where a quarter of a number is no whole one, one more is left out so often that the number left out for each that
    stays is 1/3 on average. The last tap of a class stays. Where several sessions test, see `sessions_drawn`, each is
    left out in turn instead.

    Args:
        table: Test taps; only their classes and sessions matter.
        resamples: How many.
        seed: Of the selections.
    """
    return _pools(table, resamples, seed, _Group.thinned)


def sessions_drawn(table: TapTable) -> int:
    """How many sessions would be drawn anew if a study were repeated: those that test, if they hold the same classes.

    Where less than nine tenths of the classes remain without one of them, sessions cannot be told from classes, and
    only the taps within sessions count as drawn: that is 1.
    """
    _, cell, groups = _grouped(table)
    classes = [np.unique(cell[group.member]) for group in groups]
    sessions_with = np.bincount(np.concatenate(classes))
    lost = max(np.count_nonzero(sessions_with[held] == 1) for held in classes)
    alike = lost <= (1 - _REMAIN) * np.count_nonzero(sessions_with)
    return len(groups) if alike else 1


def _pools(
    table: TapTable, resamples: int, seed: int, select: Callable[["_Group", np.random.Generator], NDArray[np.intp]]
) -> Iterator[TapPool]:
    """The pool of a table, then what `select` takes of each session, or all sessions but one."""
    yield table.pool
    taps, cell, groups = _grouped(table)
    in_turn = sessions_drawn(table) > 1
    generator = seeds.generator(seed, seeds.Purpose.RESAMPLES)
    for r in range(resamples):
        if in_turn:
            kept = [group.member for s, group in enumerate(groups) if s != r % len(groups)]
        else:
            kept = [select(group, generator) for group in groups]
        selected = np.concatenate(kept)
        yield pool_of(taps[selected], cell[selected], table.pool.nearest.shape)


def _left_out(size: NDArray[np.intp], generator: np.random.Generator) -> NDArray[np.intp]:
    """How many of groups of these sizes are left out; 1/3 for each that stays on average, but for groups of one."""
    fewer = size // 4
    least, more = fewer / (size - fewer), (fewer + 1) / np.maximum(size - fewer - 1, 1)
    return fewer + (generator.random(len(size)) * (more - least) < LEFT_OUT - least) * (size > 1)


class _Group(NamedTuple):
    """The taps of one session, class by class.

    Attributes:
        member: Their numbers, shape (n,).
        first: Where each class begins among them, shape (classes,).
        size: How many it has, shape (classes,).
        of: Class of each tap, by its place among those that are there, shape (n,).
    """

    member: NDArray[np.intp]
    first: NDArray[np.intp]
    size: NDArray[np.intp]
    of: NDArray[np.intp]

    def drawn(self, generator: np.random.Generator) -> NDArray[np.intp]:
        """As many of each class as there are, with replacement."""
        place = (generator.random(len(self.member)) * self.size[self.of]).astype(np.intp)
        return self.member[self.first[self.of] + place]

    def thinned(self, generator: np.random.Generator) -> NDArray[np.intp]:
        """Three quarters of each class, in random order."""
        shuffled = np.lexsort((generator.random(len(self.member)), self.of))
        rank = np.arange(len(self.member)) - self.first[self.of]  # classes are in order
        return self.member[shuffled[rank >= _left_out(self.size, generator)[self.of]]]


def _grouped(table: TapTable) -> tuple[NDArray[np.intp], NDArray[np.intp], list[_Group]]:
    """Taps class by class, their classes, and sessions of them."""
    pool = table.pool
    count = pool.count.ravel()
    cell = np.repeat(np.arange(len(count)), count)
    taps = np.concatenate([pool.order[f : f + n] for f, n in zip(pool.first.flat, count, strict=True)])
    session, groups = sessions_of(table)[taps], []
    for s in np.unique(session):
        member = np.flatnonzero(session == s)
        _, first, of, size = np.unique(cell[member], return_index=True, return_inverse=True, return_counts=True)
        groups.append(_Group(member, first, size, of))
    return taps, cell, groups


def sessions_of(table: TapTable) -> NDArray[np.intp]:
    """Session of each tap of a table, shape (N,)."""
    N = len(table.log_likelihood)
    return np.zeros(N, np.intp) if table.session is None else np.asarray(table.session, np.intp)
