"""Expected information from the next tap after each of several moves.

The tap to come is taken for one of a pool of known taps, with the probabilities that the measurement model gives them
in each class. The information expected of it is that between the tap and the classes under the belief after the move,
so about everything: I = H(tap) - sum over c of b_c H(tap | c), with P(tap) = sum over c of b_c P(tap | c). All of it is
products of beliefs with one matrix, for any number of beliefs and moves at once.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.errors import InputError
from .moves.holes import Mask
from .moves.shifts import shift_all
from .reference import BORDERS, Border

type About = Literal["joint", "where", "what"]

ABOUT = ("joint", "where", "what")
_CHUNK = 1 << 17  # probabilities of taps at a time, 1 MiB, which stays in cache
_NEGLIGIBLE = 1e-100  # products of what is larger are no subnormal numbers, which are slow
_TINY = np.finfo(np.float64).tiny


class TapOutcomes(NamedTuple):
    """Possible outcomes of the next tap, N taps with weights.

    Attributes:
        given: P(tap | class), sum over the taps one, shape (L, M, N); zero where no tap is possible.
        entropy: H(tap | class) in nats, shape (L, M).
        possible: Whether some tap is possible, shape (L, M).
        trained: Which classes belief may move into, shape (L, M); `None` for all.
    """

    given: NDArray[np.float64]
    entropy: NDArray[np.float64]
    possible: NDArray[np.bool_]
    trained: Mask | None = None


def tap_outcomes(log_likelihood: ArrayLike, trained: Mask | None = None) -> TapOutcomes:
    """Taps of a pool as possible outcomes of the next tap.

    Args:
        log_likelihood: log P(z | class) of each tap, shape (N, L, M), -inf where it is impossible.
        trained: Which classes belief may move into, shape (L, M); default all.

    Raises:
        InputError: There is no tap, or a value is NaN or +inf.
    """
    log_likelihood = np.asarray(log_likelihood, dtype=np.float64)
    if log_likelihood.ndim != 3 or not len(log_likelihood):
        raise InputError(
            f"log_likelihood must have axes (tap, where, what) and at least one tap, got shape {log_likelihood.shape}."
        )
    largest = log_likelihood.max(axis=0)
    if not (largest < np.inf).all():
        raise InputError("log_likelihood must not contain NaN or +inf.")
    possible = largest > -np.inf
    given = np.array(np.moveaxis(log_likelihood, 0, -1), order="C")
    given -= np.where(possible, largest, 0.0)[..., np.newaxis]
    np.exp(given, out=given)
    given /= np.where(possible, given.sum(axis=-1), 1.0)[..., np.newaxis]
    given[given < _NEGLIGIBLE] = 0.0
    return TapOutcomes(given, np.array([_entropy(row) for row in given]), possible, trained)


def moves_to_all(beliefs: ArrayLike) -> NDArray[np.intp]:
    """Moves from the most probable position to every position, shape (..., L), for beliefs (..., L, M)."""
    where_belief = np.asarray(beliefs, dtype=np.float64).sum(axis=-1)
    return np.arange(where_belief.shape[-1]) - where_belief.argmax(axis=-1)[..., np.newaxis]


def shifted(
    beliefs: ArrayLike, deltas: ArrayLike, border: Border = "uniform", trained: Mask | None = None
) -> NDArray[np.float64]:
    """Beliefs after each of several moves; Eq. 9, as `reference.shift`.

    Args:
        beliefs: Shape (..., L, M).
        deltas: Where classes moved, D whole numbers of all or of each belief, shape (D,) or (..., D).
        border: As in `reference.shift`.
        trained: As in `reference.shift`.

    Returns:
        Shape (..., D, L, M).

    Raises:
        InputError: The border is unknown.
    """
    if border not in BORDERS:
        raise InputError(f"border must be one of {', '.join(BORDERS)}, got {border!r}.")
    beliefs, deltas = np.asarray(beliefs, dtype=np.float64), np.asarray(deltas, dtype=np.intp)
    L, M = beliefs.shape[-2:]
    shape = (*beliefs.shape[:-2], deltas.shape[-1])
    each = np.broadcast_to(deltas, shape).reshape(-1, shape[-1])
    after = shift_all(beliefs.reshape(-1, L, M), each, border, trained)
    return (after / after.sum(axis=(-2, -1), keepdims=True)).reshape(*shape, L, M)


def information(outcomes: TapOutcomes, beliefs: ArrayLike, about: About = "joint") -> NDArray[np.float64]:
    """Expected information from the next tap about position and object, or one of them, in nats.

    Belief in classes under which no tap is possible is left out and the rest normalised; with no belief left there is
    nothing to be told. Rounding leaves about 1e-14, and what it makes negative is returned as zero.

    Args:
        outcomes: The taps that may come.
        beliefs: Shape (..., L, M), each of sum one, after the move.
        about: Which classes.

    Returns:
        Shape (...).

    Raises:
        InputError: The beliefs are of other classes than the taps, or `about` is unknown.
    """
    if about not in ABOUT:
        raise InputError(f"about must be one of {', '.join(ABOUT)}, got {about!r}.")
    beliefs = np.asarray(beliefs, dtype=np.float64)
    L, M, N = outcomes.given.shape
    if beliefs.shape[-2:] != (L, M):
        raise InputError(f"The taps have {L} x {M} classes, but the beliefs have shape {beliefs.shape}.")
    rows = believable(beliefs.reshape(-1, L, M), outcomes.possible)
    expected = _joint if about == "joint" else _of_one
    step = max(1, _CHUNK // N)
    parts = [expected(outcomes, rows[start : start + step], about) for start in range(0, len(rows), step)]
    return np.maximum(np.concatenate([np.empty(0), *parts]), 0.0).reshape(beliefs.shape[:-2])


def information_of_moves(
    outcomes: TapOutcomes,
    beliefs: ArrayLike,
    deltas: ArrayLike,
    border: Border = "uniform",
    about: About = "joint",
) -> NDArray[np.float64]:
    """Expected information from a tap after each of several moves, in nats.

    Args:
        outcomes: The taps that may come.
        beliefs: Before the move, shape (..., L, M).
        deltas: Where classes moved, shape (D,) or (..., D), see `shifted` and `moves_to_all`.
        border: As in `reference.shift`.
        about: As in `information`.

    Returns:
        Shape (..., D).

    Raises:
        InputError: As `shifted` and `information`.
    """
    return information(outcomes, shifted(beliefs, deltas, border, outcomes.trained), about)


def believable(beliefs: NDArray[np.float64], possible: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Beliefs (S, L, M) restricted to possible classes, with sum one, or zero if nothing is left."""
    kept = np.where(possible & (beliefs >= _NEGLIGIBLE), beliefs, 0.0)
    total = kept.sum(axis=(1, 2), keepdims=True)
    return kept / np.where(total > 0, total, 1.0)


def _joint(outcomes: TapOutcomes, beliefs: NDArray[np.float64], _: About) -> NDArray[np.float64]:
    """I(tap; where, what) for beliefs (S, L, M)."""
    flat = beliefs.reshape(len(beliefs), -1)
    tap = flat @ outcomes.given.reshape(flat.shape[1], -1)
    return _entropy(tap) - flat @ outcomes.entropy.ravel()


def _of_one(outcomes: TapOutcomes, beliefs: NDArray[np.float64], about: About) -> NDArray[np.float64]:
    """I(tap; where) or I(tap; what) for beliefs (S, L, M), as H(tap) + H(class) - H(tap, class)."""
    axis = 0 if about == "where" else 1
    total = _entropy(beliefs.sum(axis=2 - axis))
    tap = np.zeros((len(beliefs), outcomes.given.shape[-1]))
    for belief, given in zip(np.moveaxis(beliefs, axis + 1, 0), np.moveaxis(outcomes.given, axis, 0), strict=True):
        both = belief @ given
        total -= _entropy(both)
        tap += both
    return total + _entropy(tap)


def _entropy(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """-sum p log p over the last of two axes, for numbers that need not sum to one."""
    return -np.einsum("ij,ij->i", p, np.log(np.maximum(p, _TINY)))
