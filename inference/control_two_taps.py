"""Moves to where the next two taps are expected to tell most together: the first drawn, the second enumerated.

Enumerating both would take a second for each decision. Draws leave noise that can be larger than what looking further
gains, so it is made small in two ways. Only the moves that are best one tap ahead are looked at further. And the more
is unknown after the first tap, the more the second one can tell: what is left unknown is known exactly in the mean, so
where the drawn taps leave more or less than that the value is corrected (a control variate).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.errors import InputError
from . import draws, kernel
from .control import MovePolicy, best_move, where_beliefs
from .control_information import checked_targets, in_parts
from .information import About, TapOutcomes, believable, information_of_moves, shifted
from .reference import Border

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]

DRAWS = 8
"""First taps that are drawn."""
FURTHER = 3
"""Moves that are looked at further."""
_NUMBERS = 1 << 20  # of the beliefs that second taps follow, 8 MiB
_DIGITS = 12  # behind which differences of information are rounding
_TINY = np.finfo(np.float64).tiny


def two_taps(
    outcomes: TapOutcomes,
    about: About = "joint",
    border: Border = "uniform",
    Q: int = DRAWS,
    *,
    further: int = FURTHER,
    second: Sequence[int] | None = None,
) -> MovePolicy:
    """Aims for the place from where the next two taps are expected to tell most; see `two_tap_values`.

    Args:
        outcomes: The taps that may come.
        about: Both classes, or one of them.
        border: Reading of Eq. 9.
        Q: First taps that are drawn; the pool's size or more enumerates all.
        further: Moves whose second tap is looked at: so many of those that are best one tap ahead.
        second: Where classes that the second move may aim for; default all.

    Raises:
        InputError: An argument makes no sense.
    """
    L = len(outcomes.given)
    targets, every = checked_targets(about, border, second, L), np.arange(L)
    _check_number("first tap", Q)
    _check_number("move", further)

    def move(beliefs: Floats, chance: Floats) -> Integers:
        deltas = every - where_beliefs(beliefs).argmax(axis=-1)[..., np.newaxis]
        if further < L:
            first = information_of_moves(outcomes, beliefs, deltas, border, about)
            best = np.lexsort((np.abs(deltas), -first.round(_DIGITS)), axis=-1)[..., :further]
            deltas = np.take_along_axis(deltas, np.sort(best, axis=-1), axis=-1)
        values, _ = two_tap_values(outcomes, beliefs, deltas, targets, chance, about, border, Q)
        return best_move(values, deltas)

    return in_parts(move)


def two_tap_values(
    outcomes: TapOutcomes,
    beliefs: ArrayLike,
    deltas: ArrayLike,
    candidates: ArrayLike,
    chance: ArrayLike,
    about: About = "joint",
    border: Border = "uniform",
    Q: int = DRAWS,
) -> tuple[Floats, Floats]:
    """What a tap after each of several moves and a best second one are expected to tell together, and how surely.

    The value is the information of the first tap, enumerated, plus that of the second tap after the best move, in the
    mean over first taps. Of these one is drawn from each of as many equal parts of the probability. The mean is
    corrected by what they leave unknown beyond its expectation, in the proportion that the draws of the other moves
    suggest, which are independent, so it is unbiased. Its standard error is given as if taps came from anywhere, which
    is no less than it is.

    Args:
        outcomes: The taps that may come.
        beliefs: Before the move, shape (..., L, M).
        deltas: Where classes moved first, shape (D,) or (..., D).
        candidates: Where classes that the second move may aim for, shape (C,).
        chance: A number in [0, 1) for each belief, from which those for the draws are made, shape (...).
        about: As in `information`.
        border: As in `reference.shift`.
        Q: First taps drawn of each belief and move; with N or more the N taps are enumerated, without error.

    Returns:
        Values in nats and their standard errors, shapes (..., D); a single draw has an infinite one.

    Raises:
        InputError: As `information_of_moves`, or there is no draw.
    """
    _check_number("first tap", Q)
    beliefs = np.asarray(beliefs, dtype=np.float64)
    first = information_of_moves(outcomes, beliefs, deltas, border, about)
    L, M, N = outcomes.given.shape
    moved = believable(shifted(beliefs, deltas, border, outcomes.trained).reshape(-1, L, M), outcomes.possible)
    D, drawn = first.shape[-1], min(Q, N)
    places = (np.arange(drawn) + _more_chances(chance, D * drawn).reshape(-1, drawn)) / drawn
    told, left, weight = (np.empty((len(moved), drawn)) for _ in range(3))
    size = max(1, _NUMBERS // (drawn * np.size(candidates) * L * M))
    for start in range(0, len(moved), size):
        part = slice(start, start + size)
        predicted = moved[part].reshape(-1, L * M) @ outcomes.given.reshape(L * M, N)
        taps, weight[part] = _first_taps(predicted, places[part])
        after = _after(outcomes, moved[part], taps)
        moves = np.asarray(candidates) - where_beliefs(after).argmax(axis=-1)[..., np.newaxis]
        told[part] = information_of_moves(outcomes, after, moves, border, about).max(axis=-1)
        left[part] = _unknown(after, about)
    if drawn == N:
        return first + (weight * told).sum(axis=1).reshape(first.shape), np.zeros(first.shape)
    expected = _unknown(moved, about).reshape(-1, D) - first.reshape(-1, D)
    second, error = _corrected(told.reshape(-1, D, Q), left.reshape(-1, D, Q), expected)
    return first + second.reshape(first.shape), error.reshape(first.shape)


def _corrected(told: Floats, left: Floats, expected: Floats) -> tuple[Floats, Floats]:
    """Means over draws and their standard errors, shapes (S, D).

    Args:
        told: What the best second tap tells after each first one, shape (S, D, Q).
        left: What is unknown after it, likewise.
        expected: Of that, shape (S, D).
    """
    around = left - left.mean(axis=2, keepdims=True)
    both, square = ((around * values).sum(axis=2) for values in (told, around))
    both, square = (values.sum(axis=1, keepdims=True) - values for values in (both, square))
    slope = np.where(square > _TINY, both / np.where(square > _TINY, square, 1.0), 0.0)
    mean = told.mean(axis=2) - slope * (left.mean(axis=2) - expected)
    Q = told.shape[2]
    if Q == 1:
        return mean, np.full(mean.shape, np.inf)
    return mean, (told - slope[..., np.newaxis] * left).std(axis=2, ddof=1) / np.sqrt(Q)


def _more_chances(chance: ArrayLike, count: int) -> Floats:
    """Independent numbers in [0, 1) made of one, shape (..., count)."""
    word = (np.asarray(chance, dtype=np.float64) * 2.0**32).astype(np.uint64)
    return draws.uniform(draws.words(0, word.ravel(), kernel.CHANCE, 0, count)).reshape(*word.shape, count)


def _first_taps(predicted: Floats, places: Floats) -> tuple[Integers, Floats]:
    """Taps and their weights from probabilities (R, N) and places in [0, 1) along them, shape (R, Q).

    As many places as taps enumerate these. Where nothing can be predicted the weights are zero.
    """
    (R, N), Q = predicted.shape, places.shape[1]
    total = predicted.sum(axis=1, keepdims=True)
    if Q >= N:
        return np.broadcast_to(np.arange(N), (R, N)), predicted / np.where(total > 0, total, 1.0)
    passed = predicted.cumsum(axis=1)[:, np.newaxis] <= (places * total)[..., np.newaxis]
    return passed.sum(axis=-1).clip(max=N - 1), np.broadcast_to(np.where(total > 0, 1.0 / Q, 0.0), (R, Q))


def _after(outcomes: TapOutcomes, beliefs: Floats, taps: Integers) -> Floats:
    """Posteriors of beliefs (R, L, M) after each of some taps (R, Q), shape (R, Q, L, M)."""
    before = beliefs[:, np.newaxis]
    joint = before * np.moveaxis(outcomes.given[:, :, taps], (0, 1), (2, 3))
    total = joint.sum(axis=(2, 3), keepdims=True)
    return np.where(total > 0, joint / np.where(total > 0, total, 1.0), before)


def _unknown(beliefs: Floats, about: About) -> Floats:
    """Entropy of both classes or one of them under beliefs (..., L, M), in nats."""
    p = beliefs if about == "joint" else beliefs.sum(axis=-1 if about == "where" else -2)[..., np.newaxis]
    return -(p * np.log(np.maximum(p, _TINY))).sum(axis=(-2, -1))


def _check_number(name: str, number: int) -> None:
    if number < 1:
        raise InputError(f"Two taps ahead need at least one {name} to look at, got {number}.")
