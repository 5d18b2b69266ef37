"""Moves to where the next taps are expected to tell most, by exact enumeration over classes and training taps.

The taps that may come are those of the training data, with the probabilities that the fitted model gives them, see
`information`; test taps are never looked at. What two taps tell is approximated: the first one is drawn, the best
second one enumerated.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.digest import tap_digests
from ..models.errors import InputError
from ..models.model import TapModel
from ..models.taps import TapSet
from . import draws, kernel
from .control import MovePolicy, best_move, where_beliefs
from .information import (
    ABOUT,
    About,
    TapOutcomes,
    believable,
    information_of_moves,
    shifted,
    tap_outcomes,
)
from .lockstep import log_sum
from .reference import BORDERS, Border

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]

DRAWS = 4
"""First taps that two taps ahead draw, which makes a tenth of a second for 16 moves over 1600 training taps."""
_AT_ONCE = 256  # beliefs
_NUMBERS = 1 << 20  # of the beliefs that second taps follow, 8 MiB


def training_outcomes(model: TapModel, taps: TapSet) -> TapOutcomes:
    """The training taps as outcomes of the next tap; of a model with states as they are before the first tap.

    Args:
        model: The fitted model.
        taps: Taps of which those that trained the model are taken and no others.

    Raises:
        InputError: None of them trained the model, or they were prepared otherwise.
    """
    model.check_taps(taps.preprocessing)
    trained = np.isin(tap_digests(taps.taps), model.training)
    if not trained.any():
        raise InputError(
            f"Where to move is judged by training taps, and none of these {len(taps)} taps trained the model."
        )
    return tap_outcomes(state_mean(model, model.log_likelihood(taps.select(trained).taps)))


def state_mean(model: TapModel, log_likelihood: Floats) -> Floats:
    """Log-likelihoods (N, L, M): those of hypotheses (N, L, S M) in the mean over the states before the first tap."""
    N, L, H = log_likelihood.shape
    M = model.grid.M
    if M == H:
        return log_likelihood
    return log_sum(log_likelihood.reshape(N, L, H // M, M) + model.states.log_prior[:, np.newaxis], (2,))[:, :, 0]


def informative(
    outcomes: TapOutcomes,
    about: About = "joint",
    border: Border = "uniform",
    candidates: Sequence[int] | None = None,
    per: ArrayLike | None = None,
) -> MovePolicy:
    """Aims for the place where the next tap is expected to tell most.

    The information is counted from the belief after the move's shift. Of places that are equally good it takes the one
    where it is, then the nearest, then the first.

    Args:
        outcomes: The taps that may come, see `training_outcomes`.
        about: Both classes, or one of them.
        border: Reading of Eq. 9.
        candidates: Where classes that may be aimed for; default all.
        per: Cost of a move from each where class to each with the tap after it, shape (L, L), see `move_costs`; what
            counts then is the information over its cost.

    Raises:
        InputError: An argument makes no sense.
    """
    L = len(outcomes.given)
    targets = _checked(about, border, candidates, L)
    costs = _checked_costs(per, L)

    def move(beliefs: Floats, chance: Floats) -> Integers:  # noqa: ARG001
        here = where_beliefs(beliefs).argmax(axis=-1)[..., np.newaxis]
        deltas = targets - here
        values = information_of_moves(outcomes, beliefs, deltas, border, about)
        return best_move(values if costs is None else values / costs[here, targets], deltas)

    return _in_parts(move)


def two_taps(
    outcomes: TapOutcomes,
    about: About = "joint",
    border: Border = "uniform",
    Q: int = DRAWS,
    candidates: Sequence[int] | None = None,
) -> MovePolicy:
    """Aims for the place from where the next two taps are expected to tell most; see `two_tap_values`.

    Args:
        outcomes: The taps that may come.
        about: Both classes, or one of them.
        border: Reading of Eq. 9.
        Q: First taps that are drawn; the pool's size or more enumerates all.
        candidates: Where classes that may be aimed for; default all.

    Raises:
        InputError: An argument makes no sense.
    """
    targets = _checked(about, border, candidates, len(outcomes.given))
    _check_draws(Q)

    def move(beliefs: Floats, chance: Floats) -> Integers:
        deltas = targets - where_beliefs(beliefs).argmax(axis=-1)[..., np.newaxis]
        values, _ = two_tap_values(outcomes, beliefs, deltas, targets, chance, about, border, Q)
        return best_move(values, deltas)

    return _in_parts(move)


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
    mean over first taps. Of these one is drawn from each of as many equal parts of the probability, so the mean is
    unbiased. Its standard error is given as if they came from anywhere, which is no less than it is.

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
    _check_draws(Q)
    beliefs = np.asarray(beliefs, dtype=np.float64)
    first = information_of_moves(outcomes, beliefs, deltas, border, about)
    L, M, N = outcomes.given.shape
    moved = believable(shifted(beliefs, deltas, border).reshape(-1, L, M), outcomes.possible)
    steps = (np.arange(Q) + _more_chances(chance, Q)) / Q
    steps = np.broadcast_to(steps[..., np.newaxis, :], (*first.shape, Q)).reshape(-1, Q)
    drawn = min(Q, N)
    best, weight = np.empty((len(moved), drawn)), np.empty((len(moved), drawn))
    size = max(1, _NUMBERS // (drawn * np.size(candidates) * L * M))
    for start in range(0, len(moved), size):
        part = slice(start, start + size)
        predicted = moved[part].reshape(-1, L * M) @ outcomes.given.reshape(L * M, N)
        taps, weight[part] = _first_taps(predicted, steps[part])
        best[part] = _best_second(outcomes, moved[part], taps, np.asarray(candidates), about, border)
    mean = (weight * best).sum(axis=1)
    if Q >= N:
        error = np.zeros(len(mean))
    elif Q == 1:
        error = np.full(len(mean), np.inf)
    else:
        error = best.std(axis=1, ddof=1) / np.sqrt(Q)
    return first + mean.reshape(first.shape), error.reshape(first.shape)


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


def _best_second(
    outcomes: TapOutcomes, beliefs: Floats, taps: Integers, targets: Integers, about: About, border: Border
) -> Floats:
    """What the best second tap tells after each of some first ones (R, Q) under beliefs (R, L, M), shape (R, Q)."""
    before = beliefs[:, np.newaxis]
    joint = before * np.moveaxis(outcomes.given[:, :, taps], (0, 1), (2, 3))
    total = joint.sum(axis=(2, 3), keepdims=True)
    after = np.where(total > 0, joint / np.where(total > 0, total, 1.0), before)
    deltas = targets - where_beliefs(after).argmax(axis=-1)[..., np.newaxis]
    return information_of_moves(outcomes, after, deltas, border, about).max(axis=-1)


def _in_parts(policy: MovePolicy) -> MovePolicy:
    """The same strategy, asked for so many beliefs at a time that memory is bounded."""

    def move(beliefs: Floats, chance: Floats) -> Integers:
        beliefs, chance = np.asarray(beliefs, dtype=np.float64), np.asarray(chance, dtype=np.float64)
        flat, numbers = beliefs.reshape(-1, *beliefs.shape[-2:]), chance.ravel()
        starts = range(0, len(flat), _AT_ONCE)
        parts = [policy(flat[i : i + _AT_ONCE], numbers[i : i + _AT_ONCE]) for i in starts]
        return np.concatenate([np.empty(0, np.int64), *parts]).reshape(beliefs.shape[:-2])

    return move


def _checked(about: About, border: Border, candidates: Sequence[int] | None, L: int) -> NDArray[np.int64]:
    """The where classes to aim for."""
    if about not in ABOUT:
        raise InputError(f"Information is about {', '.join(ABOUT)}, got {about!r}.")
    if border not in BORDERS:
        raise InputError(f"The border must be one of {', '.join(BORDERS)}, got {border!r}.")
    if candidates is None:
        return np.arange(L)
    targets = np.unique(np.asarray(candidates, dtype=np.int64))
    if not len(targets) or targets[0] < 0 or targets[-1] >= L:
        raise InputError(f"Candidates must be some of the where classes 0 to {L - 1}, got {list(candidates)}.")
    return targets


def _checked_costs(per: ArrayLike | None, L: int) -> Floats | None:
    if per is None:
        return None
    costs = np.asarray(per, dtype=np.float64)
    if costs.shape != (L, L) or not ((costs > 0) & (costs < np.inf)).all():
        raise InputError(f"Costs of moves must be {L} x {L} numbers above 0, got shape {costs.shape}.")
    return costs


def _check_draws(Q: int) -> None:
    if Q < 1:
        raise InputError(f"At least one first tap must be drawn, got {Q}.")
