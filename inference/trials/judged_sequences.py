"""Sequences of taps of one class, and the log belief in the true class at each exponent of the likelihood."""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...models import seeds
from ...models.compiled import compiled
from ...models.elementary import LEAST, exponential
from ...models.errors import InputError
from ...models.measurement.model import TapModel
from ...models.taps import TapSet
from ..filter import share

type Floats = NDArray[np.float64]

_DRAWS = 10  # sequences of each class and session that has more taps than one sequence
_KEPT = 256  # drawn sequences, of one session and length each, that are kept


class JudgedSession(NamedTuple):
    """Log-likelihoods of the taps of one session.

    Attributes:
        log_likelihood: At power 1, shape (N, L, S M).
        where: True class, shape (N,).
        what: Likewise.
        model: The model.
    """

    log_likelihood: Floats
    where: NDArray[np.intp]
    what: NDArray[np.intp]
    model: TapModel

    @classmethod
    def by(cls, model: TapModel, taps: TapSet) -> Self:
        """Session of taps of trained classes."""
        return cls(model.log_likelihood(taps.samples) / model.exponent, *taps.indices(model.grid), model)


class Sequences(NamedTuple):
    """Q sequences; C = L S M classes and states.

    Attributes:
        log_likelihood: Log-likelihood of the sums over their taps at power 1, shape (Q, C).
        group: What belief is asked in: the class in whatever state, shape (C,).
        true: The group that is true, shape (Q,).
        weight: How many taps each stands for, shape (Q,).
        share: The power at which beliefs are read, shape (Q,).
        log_prior: Shape (C,).
    """

    log_likelihood: Floats
    group: NDArray[np.intp]
    true: NDArray[np.intp]
    weight: Floats
    share: Floats
    log_prior: Floats

    @classmethod
    def draw(cls, judged: JudgedSession, n: int, seed: int, session: int, again: bool = False) -> Self:
        """Sequences of n taps; a class with fewer gives all of them, or repeats some with `again`."""
        _, where, what, model = judged
        (L, H), M = judged.log_likelihood.shape[1:], model.grid.M
        values = judged.log_likelihood.reshape(len(where), L * H)
        true = (where * M + what).astype(np.int64)
        sums, first, weight, shares = [], [], [], []
        for chosen, taps in _drawn(true.tobytes(), n, seed, session & 0xFFFFFFFF, again):
            sums.append(sum_taps(values, chosen))
            first += [chosen[0, 0]] * len(chosen)
            weight += [taps / len(chosen)] * len(chosen)
            shares += [share(chosen.shape[1], model.saturation)] * len(chosen)
        group = (np.arange(L)[:, np.newaxis] * M + np.arange(H) % M).ravel()
        return cls(
            np.concatenate(sums), group, true[first], np.array(weight), np.array(shares), model.log_prior.ravel()
        )


@lru_cache(maxsize=_KEPT)
def _drawn(true: bytes, n: int, seed: int, session: int, again: bool) -> list[tuple[NDArray[np.intp], int]]:
    """Sequences of each class, shape (Q, n), and its number of taps; the same ones for all taps of these classes.

    Drawing takes longer than adding the taps up, and studies tune on many data sets alike.
    """
    generator, classes = seeds.generator(seed, seeds.Purpose.SEQUENCES, n, session), np.frombuffer(true, np.int64)
    found = []
    for c in np.unique(classes):
        members = np.flatnonzero(classes == c)
        if n == 1:
            chosen = members[:, np.newaxis]
        elif n < len(members) or (again and n > len(members)):
            chosen = np.array([generator.choice(members, size=n, replace=n > len(members)) for _ in range(_DRAWS)])
        else:
            chosen = members[np.newaxis]
        found.append((chosen, len(members)))
    return found


def mean_log_belief(sequences: Sequence[Sequences], exponent: float, power: float | None = None) -> float:
    """Mean log belief in the true class over all sessions, each tap with the same weight.

    Args:
        sequences: Sequences of each session.
        exponent: Exponent of the likelihood.
        power: At which beliefs are read; `None` for that of each sequence.
    """
    total = weight = 0.0
    for part in sequences:
        if power is not None:
            part = part._replace(share=np.full(len(part.true), power))  # noqa: PLW2901
        total += float(part.weight @ log_beliefs(part, exponent))
        weight += float(part.weight.sum())
    return total / weight


def log_beliefs(sequences: Sequences, exponent: float = 1.0) -> Floats:
    """Log belief in the true class after each sequence, shape (Q,); NaN if no class is left.

    Args:
        sequences: Sequences of one session.
        exponent: Exponent of the likelihood.
    """
    found = np.empty(len(sequences.true))
    _log_beliefs(*sequences, exponent, found)
    return found


def refuse_impossible(sequences: Iterable[Sequences]) -> None:
    """Checks that every sequence is possible under its own class.

    Raises:
        InputError: One is impossible under its own class.
    """
    impossible = 0
    for part in sequences:
        other = part.group != part.true[:, np.newaxis]
        impossible += int((other | np.isneginf(part.log_likelihood)).all(axis=1).sum())
    if impossible:
        raise InputError(
            f"The power cannot be learned: {impossible} sequences of held-out taps are impossible under their own "
            "class; use a --pseudocount above 0."
        )


def without_replacement(
    group: NDArray[np.intp], n: int, draws: int, generator: np.random.Generator
) -> NDArray[np.intp]:
    """Sequences of n different taps, group by group: disjoint parts of repeatedly shuffled groups.

    So taps are used about equally often, which scatters less than draws of their own. Shuffles take turns, and their
    number is even: every second sequence is of every second one. Of large groups no shuffle is used up.

    Args:
        group: The taps, n of them at least, or groups of as many taps, in rows.
        n: Taps of a sequence.
        draws: How many sequences of a group there are at least.
        generator: Random generator of the shuffles.

    Returns:
        Shape (Q, n).
    """
    groups = np.atleast_2d(group)
    size = groups.shape[1]
    parts = min(size // n, max(1, draws // 2))
    shuffles = 2 * -(-draws // (2 * parts))
    shuffled = generator.permuted(groups.repeat(shuffles, axis=0), axis=1)[:, : parts * n]
    return shuffled.reshape(-1, shuffles, parts, n).swapaxes(1, 2).reshape(-1, n)


def sum_taps(log_likelihood: Floats, chosen: NDArray[np.integer]) -> Floats:
    """Sum of the rows of taps (N, C) over each sequence of them (Q, n), shape (Q, C)."""
    sums = np.empty((len(chosen), log_likelihood.shape[1]))
    _sum_taps(np.ascontiguousarray(log_likelihood), np.asarray(chosen, dtype=np.int64), sums)
    return sums


@compiled
def _sum_taps(log_likelihood: Floats, chosen: NDArray[np.int64], sums: Floats) -> None:
    sums[:] = 0.0
    for q in range(len(chosen)):
        for tap in chosen[q]:
            for c in range(sums.shape[1]):
                sums[q, c] += log_likelihood[tap, c]


@compiled
def _log_beliefs(
    log_likelihood: Floats,
    group: NDArray[np.intp],
    true: NDArray[np.intp],
    _: Floats,
    share: Floats,
    log_prior: Floats,
    exponent: float,
    out: Floats,
) -> None:
    """Compiled `log_beliefs`, from the arrays of `Sequences` without their weights."""
    joint, own, found, asked = np.empty(len(group)), np.empty(len(group), np.intp), 0, -1
    for q in range(len(true)):
        if true[q] != asked:  # sequences of a class follow each other
            asked, found = true[q], 0
            for c in range(len(group)):
                if group[c] == asked:
                    own[found] = c
                    found += 1
        top = mine = -np.inf
        for c in range(len(joint)):
            joint[c] = share[q] * (log_prior[c] + exponent * log_likelihood[q, c])
            top = max(top, joint[c])
        for i in range(found):
            mine = max(mine, joint[own[i]])
        total = part = 0.0
        if mine > -np.inf:
            for c in range(len(joint)):
                total += exponential(max(joint[c] - top, LEAST))
            for i in range(found):
                part += exponential(max(joint[own[i]] - mine, LEAST))
        out[q] = mine - top + math.log(part / total) if mine > -np.inf else mine - top
