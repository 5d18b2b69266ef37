"""By how much one more tap is expected to lower the cost of a wrong decision: moves and stops by Bayes risk.

The analogue of `information` in the cost of errors instead of nats. The decision now costs the least, over decisions a,
of sum over m of loss[a, m] b_m; after the tap it costs the same of the posterior, in the mean over the taps of a pool
with the probabilities that the measurement model gives them. That looks one tap ahead: the difference is zero wherever
no single tap can change the decision, although two could, and there it tells neither where to move nor that stopping is
right.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.errors import InputError
from ..information import TapOutcomes, believable, moves_to_all, shifted, tap_outcomes
from ..reference import Border
from ..stopping.stopping import Watch
from .control import MovePolicy, best_move
from .holes import Mask
from .shifts import log_sum

_CHUNK = 1 << 17  # joint probabilities of taps and objects at a time, 1 MiB, which stays in cache
_ALIKE = 1e-12  # gains that differ by less, in losses, are equal but for rounding


def decision_loss(beliefs: ArrayLike, loss: ArrayLike) -> NDArray[np.float64]:
    """Expected loss of the best decision, shape (...).

    Args:
        beliefs: Shape (..., L, M); of sum s, the loss is s times that of the normalised ones.
        loss: What each decision costs with each object, shape (A, M).
    """
    what = np.asarray(beliefs, dtype=np.float64).sum(axis=-2)
    return (what @ np.asarray(loss, dtype=np.float64).T).min(axis=-1)


def checked_loss(loss: ArrayLike, M: int) -> NDArray[np.float64]:
    """The loss matrix, shape (A, M).

    Raises:
        InputError: It has another shape, or a loss is negative, infinite or NaN.
    """
    loss = np.asarray(loss, dtype=np.float64)
    if loss.ndim != 2 or loss.shape[1] != M or not len(loss):
        raise InputError(
            f"A loss needs a row for each decision and a column for each of {M} objects, got {loss.shape}."
        )
    if not (np.isfinite(loss) & (loss >= 0)).all():
        raise InputError("A loss is negative or not finite.")
    return loss


def expected_steps(beliefs: ArrayLike, deltas: ArrayLike) -> NDArray[np.float64]:
    """Where classes that a sensor really moves, in expectation, as it stops at the ends of its range.

    Args:
        beliefs: Before the move, shape (..., L, M).
        deltas: Commanded moves, shape (D,) or (..., D).

    Returns:
        Shape (..., D).
    """
    where = np.asarray(beliefs, dtype=np.float64).sum(axis=-1)
    L = where.shape[-1]
    classes = np.arange(L)
    made = np.abs(np.clip(classes + np.asarray(deltas)[..., np.newaxis], 0, L - 1) - classes)
    return (made * where[..., np.newaxis, :]).sum(axis=-1)


def representative_outcomes(log_likelihood: ArrayLike, trained: Mask | None = None) -> TapOutcomes:
    """Taps of a pool that has as many of each class, as outcomes that stand for all taps there could be.

    A tap that many classes give is more often in the pool, so each is weighed by one over how probable it was to get
    there, as in importance sampling. Without that a tap typical of its class counts twice, for being probable and for
    being there often, and what the next tap will tell comes out wrong, mostly too small. Right if the likelihood is
    that of a tap, so without the paper's root.

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
    """By how much the expected loss of the decision falls with a tap after each of several moves.

    Counted from the belief before the move. Borders other than `clamp`, `uniform_what` and `circular` forget about
    objects when they shift a belief, and that counts against the move; under these three the gain is never negative,
    as long as all classes are possible. Where belief is in classes under which no tap is possible, it is left out and
    the rest normalised. What is no more than rounding is returned as zero.

    Args:
        outcomes: The taps that may come.
        beliefs: Before the move, shape (..., L, M).
        deltas: Where classes moved, shape (D,) or (..., D).
        loss: What each decision costs with each object, shape (A, M).
        border: As in `reference.shift`.

    Returns:
        Shape (..., D), in the unit of the loss.

    Raises:
        InputError: The beliefs are of other classes than the taps, or the loss or the border makes no sense.
    """
    L, M, N = outcomes.given.shape
    loss = checked_loss(loss, M)
    beliefs = np.asarray(beliefs, dtype=np.float64)
    if beliefs.shape[-2:] != (L, M):
        raise InputError(f"The taps tell {L} x {M} classes apart, the beliefs have shape {beliefs.shape}.")
    moved = shifted(beliefs, deltas, border, outcomes.trained)
    rows = believable(moved.reshape(-1, L, M), outcomes.possible)
    step = max(1, _CHUNK // (N * M))
    parts = [_loss_after(outcomes, rows[i : i + step], loss) for i in range(0, len(rows), step)]
    after = np.concatenate([np.empty(0), *parts]).reshape(moved.shape[:-2])
    now = decision_loss(beliefs, loss)[..., np.newaxis]
    lost = ~rows.any(axis=(1, 2)).reshape(after.shape)
    gain = np.where(lost, 0.0, now - after)
    return np.where(np.abs(gain) > _ALIKE * loss.max(), gain, 0.0)


def _loss_after(outcomes: TapOutcomes, beliefs: NDArray[np.float64], loss: NDArray[np.float64]) -> NDArray[np.float64]:
    """Expected loss of the decision after a tap, of beliefs (S, L, M)."""
    S, _, M = beliefs.shape
    by_what = np.ascontiguousarray(np.moveaxis(beliefs, 2, 0))
    both = np.matmul(by_what, np.moveaxis(outcomes.given, 1, 0))
    return (loss @ both.reshape(M, -1)).min(axis=0).reshape(S, -1).sum(axis=1)


def gain_watch(
    outcomes: TapOutcomes,
    loss: ArrayLike,
    *,
    step_cost: float = 0.0,
    negligible: float = 0.0,
    border: Border = "uniform",
) -> Watch:
    """Records the expected gain of the move that follows, less the cost of that move, as "gain" for `lookahead`.

    Args:
        outcomes: The taps that may come.
        loss: As in `expected_gain`.
        step_cost: Cost of a where class really moved, in the unit of the loss.
        negligible: Where a decision is expected to cost no more than this, that stands for the gain, which cannot be
            larger; choose it below every cost of a tap that will be asked about.
        border: As in `reference.shift`.

    Raises:
        InputError: The loss or the cost makes no sense.
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
    """Moves to where the expected gain less the cost of the way is largest; of equal ones the shortest move.

    Candidates are the moves that bring the most probable place to each where class.

    Args:
        outcomes: The taps that may come.
        loss: As in `expected_gain`.
        step_cost: Cost of a where class really moved, in the unit of the loss.
        border: As in `reference.shift`.

    Raises:
        InputError: The loss or the cost makes no sense.
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
        raise InputError(f"The cost of a move must be a number from 0 on, got {step_cost}.")
