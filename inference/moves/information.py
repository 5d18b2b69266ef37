"""Strategy of maximum expected information, by exact enumeration over classes and training taps.

The possible taps are those of the training data, with their probabilities under the fitted model, see `information`;
test taps are never used.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

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

_AT_ONCE = 256  # beliefs per batch


def training_outcomes(model: TapModel, taps: TapSet) -> TapOutcomes:
    """Training taps as possible outcomes of the next tap; for a model with states, as before the first tap.

    Args:
        model: The fitted model.
        taps: Taps, of which only those that trained the model are used.

    Raises:
        InputError: None of them trained the model, or their preprocessing differs.
    """
    model.check_taps(taps.preprocessing)
    trained = np.isin(taps.digests, model.training)
    if not trained.any():
        raise InputError(
            f"The strategy needs the training taps of the model, but none of these {len(taps)} taps trained it."
        )
    return tap_outcomes(state_mean(model, model.log_likelihood(taps.select(trained).taps)), model.trained)


def state_mean(model: TapModel, log_likelihood: Floats) -> Floats:
    """Log-likelihoods (N, L, M): the mean of those of hypotheses (N, L, S M) over the prior of the states."""
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
    """Strategy that moves to the position of maximum expected information from the next tap.

    The information is relative to the belief after the shift by the move. Among equally good positions it takes the
    current one, then the nearest, then the first.

    Args:
        outcomes: Possible taps, see `training_outcomes`.
        about: Whether the information is about the object, the position or both.
        border: Interpretation of Eq. 9 at the ends of the range.
        candidates: Positions to consider; default: all.
        per: Cost of a move between each two positions with the tap after it, shape (L, L), see
            `strategies.way_costs`; if given, the information per cost is maximised.

    Raises:
        InputError: An argument is invalid.
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
    """The same strategy, in batches to limit memory."""

    def move(beliefs: Floats, chance: Floats) -> Integers:
        beliefs, chance = np.asarray(beliefs, dtype=np.float64), np.asarray(chance, dtype=np.float64)
        flat, numbers = beliefs.reshape(-1, *beliefs.shape[-2:]), chance.ravel()
        starts = range(0, len(flat), _AT_ONCE)
        parts = [policy(flat[i : i + _AT_ONCE], numbers[i : i + _AT_ONCE]) for i in starts]
        return np.concatenate([np.empty(0, np.int64), *parts]).reshape(beliefs.shape[:-2])

    return move


def _checked_targets(about: About, border: Border, candidates: Sequence[int] | None, L: int) -> NDArray[np.int64]:
    """Indices of the positions to consider.

    Raises:
        InputError: They are not among the L positions, or another argument is invalid.
    """
    if about not in ABOUT:
        raise InputError(f"about must be one of {', '.join(ABOUT)}, got {about!r}.")
    if border not in BORDERS:
        raise InputError(f"border must be one of {', '.join(BORDERS)}, got {border!r}.")
    if candidates is None:
        return np.arange(L)
    targets = np.unique(np.asarray(candidates, dtype=np.int64))
    if not len(targets) or targets[0] < 0 or targets[-1] >= L:
        raise InputError(f"candidates must be positions from 0 to {L - 1}, got {list(candidates)}.")
    return targets


def _checked_costs(per: ArrayLike | None, L: int) -> Floats | None:
    if per is None:
        return None
    costs = np.asarray(per, dtype=np.float64)
    if costs.shape != (L, L) or not ((costs > 0) & (costs < np.inf)).all():
        raise InputError(f"Costs of moves must be above 0, shape ({L}, {L}), got shape {costs.shape}.")
    return costs
