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
from .expectation import entropies, entropy, restrict
from .moves.holes import Mask
from .moves.shifts import shift_all
from .reference import BORDERS, Border

type About = Literal["joint", "where", "what"]

ABOUT = ("joint", "where", "what")
_NEGLIGIBLE = 1e-100  # products of what is larger are no subnormal numbers, which are slow


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
    return TapOutcomes(given, np.array([[entropy(taps) for taps in row] for row in given]), possible, trained)


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
    rows = believable(beliefs, outcomes.possible)
    found = np.empty((len(rows), 2))
    entropies(rows, outcomes.given.reshape(L * M, N), _groups(about, L, M), found)
    if about == "joint":
        found[:, 1] = -(rows @ outcomes.entropy.ravel())
    return np.maximum(found.sum(axis=1), 0.0).reshape(beliefs.shape[:-2])


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
    """Beliefs (..., L, M) restricted to possible classes, with sum one, or zero if nothing is left; shape (S, L M)."""
    flat = np.ascontiguousarray(beliefs).reshape(-1, possible.size)
    kept = np.empty_like(flat)
    restrict(flat, possible.ravel(), kept)
    return kept


def _groups(about: About, L: int, M: int) -> NDArray[np.int64]:
    """Classes of every position or object, or all in one group."""
    classes = np.arange(L * M).reshape(L, M)
    return {"joint": classes.reshape(1, -1), "where": classes, "what": np.ascontiguousarray(classes.T)}[about]
