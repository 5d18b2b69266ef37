"""Moves to where the next taps are expected to tell most, by exact enumeration over classes and training taps.

The taps that may come are those of the training data, with the probabilities that the fitted model gives them, see
`information`; test taps are never looked at.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.digest import tap_digests
from ...models.errors import InputError
from ...models.measurement.model import TapModel
from ...models.taps import TapSet
from ..information import (
    ABOUT,
    About,
    TapOutcomes,
    information_of_moves,
    tap_outcomes,
)
from ..reference import BORDERS, Border
from .control import MovePolicy, best_move, where_beliefs
from .shifts import log_sum

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]

_AT_ONCE = 256  # beliefs


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
    return tap_outcomes(state_mean(model, model.log_likelihood(taps.select(trained).taps)), model.trained)


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
        per: Cost of a move from each where class to each with the tap after it, shape (L, L), see `moves.costs`; what
            counts then is the information over its cost.

    Raises:
        InputError: An argument makes no sense.
    """
    L = len(outcomes.given)
    targets = _checked_targets(about, border, candidates, L)
    costs = _checked_costs(per, L)

    def move(beliefs: Floats, chance: Floats) -> Integers:  # noqa: ARG001
        here = where_beliefs(beliefs).argmax(axis=-1)[..., np.newaxis]
        deltas = targets - here
        values = information_of_moves(outcomes, beliefs, deltas, border, about)
        return best_move(values if costs is None else values / costs[here, targets], deltas)

    return _in_parts(move)


def _in_parts(policy: MovePolicy) -> MovePolicy:
    """The same strategy, asked for so many beliefs at a time that memory is bounded."""

    def move(beliefs: Floats, chance: Floats) -> Integers:
        beliefs, chance = np.asarray(beliefs, dtype=np.float64), np.asarray(chance, dtype=np.float64)
        flat, numbers = beliefs.reshape(-1, *beliefs.shape[-2:]), chance.ravel()
        starts = range(0, len(flat), _AT_ONCE)
        parts = [policy(flat[i : i + _AT_ONCE], numbers[i : i + _AT_ONCE]) for i in starts]
        return np.concatenate([np.empty(0, np.int64), *parts]).reshape(beliefs.shape[:-2])

    return move


def _checked_targets(about: About, border: Border, candidates: Sequence[int] | None, L: int) -> NDArray[np.int64]:
    """The where classes to aim for.

    Raises:
        InputError: They are none of L, or what is asked about them makes no sense.
    """
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
