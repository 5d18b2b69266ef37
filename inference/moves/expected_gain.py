"""Expected reduction of the decision's cost by one more tap, for moves and stopping by Bayes risk.

The analogue of `information` with the cost of errors instead of nats. The cost of deciding now is the minimum over
decisions a of the sum over m of loss[a, m] b_m; after the tap it is the same for the posterior, averaged over the taps
of a pool with their probabilities under the measurement model. This looks one tap ahead: if no single tap can change
the decision, the difference is zero although two taps could change it, and then it is no guide to moves or stopping.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.errors import InputError
from ..expectation import losses
from ..information import TapOutcomes, believable, moves_to_all, shifted, tap_outcomes
from ..reference import Border
from ..stopping.stopping import Watch
from .control import MovePolicy, best_move
from .holes import Mask
from .shifts import log_sum

_ALIKE = 1e-12  # gains within this, in units of the loss, count as equal


def decision_loss(beliefs: ArrayLike, loss: ArrayLike) -> NDArray[np.float64]:
    """Expected loss of the best decision, shape (...).

    Args:
        beliefs: Beliefs, shape (..., L, M); the loss scales with their sum.
        loss: Loss of each decision for each object, shape (A, M).
    """
    what = np.asarray(beliefs, dtype=np.float64).sum(axis=-2)
    return (what @ np.asarray(loss, dtype=np.float64).T).min(axis=-1)


def checked_loss(loss: ArrayLike, M: int) -> NDArray[np.float64]:
    """Checked loss matrix, shape (A, M).

    Raises:
        InputError: It has another shape, or a loss is negative, infinite or NaN.
    """
    loss = np.asarray(loss, dtype=np.float64)
    if loss.ndim != 2 or loss.shape[1] != M or not len(loss):
        raise InputError(f"loss must have a row per decision and {M} columns, one per object, got shape {loss.shape}.")
    if not (np.isfinite(loss) & (loss >= 0)).all():
        raise InputError("loss must be finite and not negative.")
    return loss


def expected_steps(beliefs: ArrayLike, deltas: ArrayLike) -> NDArray[np.float64]:
    """Expected number of positions actually moved, as the sensor stops at the ends of its range.

    Args:
        beliefs: Beliefs before the move, shape (..., L, M).
        deltas: Commanded moves, shape (D,) or (..., D).

    Returns:
        Expected steps, shape (..., D).
    """
    where = np.asarray(beliefs, dtype=np.float64).sum(axis=-1)
    L = where.shape[-1]
    classes = np.arange(L)
    made = np.abs(np.clip(classes + np.asarray(deltas)[..., np.newaxis], 0, L - 1) - classes)
    return (made * where[..., np.newaxis, :]).sum(axis=-1)


def representative_outcomes(log_likelihood: ArrayLike, trained: Mask | None = None) -> TapOutcomes:
    """Taps of a pool with equally many of each class, weighted to represent all possible taps.

    Each tap is weighted by the inverse of its probability of being in the pool, as in importance sampling. Otherwise a
    tap typical of its class counts twice, as probable and as frequent, which biases the expected gain, usually
    downwards. Correct if the likelihood is that of a tap, that is, without the paper's root.

    Args:
        log_likelihood: As in `tap_outcomes`, shape (N, L, M).
        trained: As in `tap_outcomes`.

    Raises:
        InputError: As `tap_outcomes`.
    """
    log_likelihood = np.asarray(log_likelihood, dtype=np.float64)
    if log_likelihood.ndim != 3:
        return tap_outcomes(log_likelihood, trained)
    pooled = log_sum(log_likelihood, (1, 2))
    return tap_outcomes(log_likelihood - np.where(np.isneginf(pooled), 0.0, pooled), trained)


def expected_gain(
    outcomes: TapOutcomes, beliefs: ArrayLike, deltas: ArrayLike, loss: ArrayLike, border: Border = "uniform"
) -> NDArray[np.float64]:
    """Expected reduction of the decision's loss by a tap after each of several moves.

    Relative to the belief before the move. Borders other than `clamp`, `uniform_what` and `circular` lose information
    about objects when they shift a belief, which counts against the move; with these three the gain is not negative if
    all classes are possible. Belief in classes under which no tap is possible is dropped and the rest normalised.
    Rounding errors are returned as zero.

    Args:
        outcomes: Possible taps.
        beliefs: Beliefs before the move, shape (..., L, M).
        deltas: Moves in positions, shape (D,) or (..., D).
        loss: Loss of each decision for each object, shape (A, M).
        border: As in `reference.shift`.

    Returns:
        Gain in the unit of the loss, shape (..., D).

    Raises:
        InputError: The beliefs do not match the classes of the taps, or the loss or the border is invalid.
    """
    L, M, N = outcomes.given.shape
    loss = checked_loss(loss, M)
    beliefs = np.asarray(beliefs, dtype=np.float64)
    if beliefs.shape[-2:] != (L, M):
        raise InputError(f"The taps have {L} x {M} classes, but the beliefs have shape {beliefs.shape}.")
    moved = shifted(beliefs, deltas, border, outcomes.trained)
    rows = believable(moved, outcomes.possible)
    after = np.empty(len(rows))
    objects = np.ascontiguousarray(np.arange(L * M).reshape(L, M).T)
    losses(rows, outcomes.given.reshape(L * M, N), objects, loss, after)
    after = after.reshape(moved.shape[:-2])
    now = decision_loss(beliefs, loss)[..., np.newaxis]
    lost = ~rows.any(axis=1).reshape(after.shape)
    gain = np.where(lost, 0.0, now - after)
    return np.where(np.abs(gain) > _ALIKE * loss.max(), gain, 0.0)


def gain_watch(
    outcomes: TapOutcomes,
    loss: ArrayLike,
    *,
    step_cost: float = 0.0,
    negligible: float = 0.0,
    border: Border = "uniform",
) -> Watch:
    """Watch that records the expected gain of the next move, minus its cost, as "gain" for `lookahead`.

    Args:
        outcomes: Possible taps.
        loss: As in `expected_gain`.
        step_cost: Cost of each position actually moved, in the unit of the loss.
        negligible: Expected loss of a decision up to which this loss is used as the gain, of which it is an upper
            bound; choose it below every cost of a tap in use.
        border: As in `reference.shift`.

    Raises:
        InputError: The loss or the cost is invalid.
    """
    loss = checked_loss(loss, outcomes.given.shape[1])
    _check_cost(step_cost)

    def watch(beliefs: NDArray[np.float64], moves: NDArray[np.int64]) -> Mapping[str, NDArray[np.float64]]:
        gain = decision_loss(beliefs, loss)
        open_ = gain > negligible
        deltas = moves[open_, np.newaxis]
        gain[open_] = expected_gain(outcomes, beliefs[open_], deltas, loss, border)[:, 0]
        gain[open_] -= step_cost * expected_steps(beliefs[open_], deltas)[:, 0]
        return {"gain": gain}

    return watch


def risk_mover(
    outcomes: TapOutcomes, loss: ArrayLike, *, step_cost: float = 0.0, border: Border = "uniform"
) -> MovePolicy:
    """Strategy that maximises the expected gain minus the cost of the move; prefers the shortest move.

    Candidates are the moves from the most probable position to each position.

    Args:
        outcomes: Possible taps.
        loss: As in `expected_gain`.
        step_cost: Cost of each position actually moved, in the unit of the loss.
        border: As in `reference.shift`.

    Raises:
        InputError: The loss or the cost is invalid.
    """
    loss = checked_loss(loss, outcomes.given.shape[1])
    _check_cost(step_cost)
    scale = float(loss.max()) or 1.0

    def move(beliefs: NDArray[np.float64], chance: NDArray[np.float64]) -> NDArray[np.int64]:  # noqa: ARG001
        deltas = moves_to_all(beliefs)
        net = expected_gain(outcomes, beliefs, deltas, loss, border) - step_cost * expected_steps(beliefs, deltas)
        return best_move(net / scale, deltas)

    return move


def _check_cost(step_cost: float) -> None:
    if not 0 <= step_cost < np.inf:
        raise InputError(f"The cost of a move must be at least 0, got {step_cost}.")
