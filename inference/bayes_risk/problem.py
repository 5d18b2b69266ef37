"""Small sequential decision problems: taps as symbols, costs, and enumerable beliefs.

The model is the one that the filter assumes: object and position from the prior, symbols from a channel given the
class, moves that stop at the ends of the range (border `clamp`). The cost is the sum over taps, positions actually
moved, and the loss of the decision. The first tap is always made; each is followed by a decision or by a move and
another tap.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.errors import InputError
from ..information import TapOutcomes, tap_outcomes
from ..moves.expected_gain import checked_loss, decision_loss

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]

_SUM = 1e-9  # tolerance of sums of given probabilities
_GRID = 2.0**43  # beliefs that differ by less than about 1e-13 count as equal


class RiskProblem(NamedTuple):
    """A sequential decision problem; see `bayes_risk.problem`.

    Attributes:
        channel: P(symbol | class), shape (L, M, S).
        loss: Loss of each decision for each object, shape (A, M): the M objects first; a further row is for giving up.
        tap_cost: Cost of a tap, in the unit of the loss.
        class_cost: Cost of each position actually moved.
        most_taps: Maximum number of taps, after which a decision is made.
        prior: Belief before the first tap, shape (L, M).
    """

    channel: Floats
    loss: Floats
    tap_cost: float
    class_cost: float
    most_taps: int
    prior: Floats

    @property
    def deltas(self) -> Integers:
        """All moves within the range, the shorter first."""
        L = len(self.channel)
        return np.array([0, *(sign * length for length in range(1, L) for sign in (-1, 1))], dtype=np.int64)

    @property
    def outcomes(self) -> TapOutcomes:
        """The symbols as outcomes of the next tap."""
        with np.errstate(divide="ignore"):
            return tap_outcomes(np.moveaxis(np.log(self.channel), -1, 0))


def risk_problem(
    channel: ArrayLike,
    loss: ArrayLike,
    *,
    tap_cost: float,
    class_cost: float,
    most_taps: int,
    prior: ArrayLike | None = None,
) -> RiskProblem:
    """Problem from its parts; the default prior is uniform.

    Raises:
        InputError: Shapes or sums do not match, a cost is negative, or no tap is allowed.
    """
    channel = np.asarray(channel, dtype=np.float64)
    if channel.ndim != 3 or not _sums_to_one(channel, (-1,)):
        raise InputError(
            f"channel must have axes (where, what, symbol) and sum to 1 over the last, got shape {channel.shape}."
        )
    L, M, _ = channel.shape
    loss = checked_loss(loss, M)
    if len(loss) not in (M, M + 1):
        raise InputError(f"loss must have {M} rows, or {M + 1} with giving up, got {len(loss)}.")
    prior = np.full((L, M), 1.0 / (L * M)) if prior is None else np.asarray(prior, dtype=np.float64)
    if prior.shape != (L, M) or not _sums_to_one(prior, (0, 1)):
        raise InputError(f"prior must have shape ({L}, {M}) and sum to 1, got shape {prior.shape}.")
    if not (0 <= tap_cost < np.inf and 0 <= class_cost < np.inf) or most_taps < 1:
        raise InputError(
            f"Costs must be at least 0 and most_taps at least 1, got {tap_cost}, {class_cost} and {most_taps}."
        )
    return RiskProblem(channel, loss, float(tap_cost), float(class_cost), int(most_taps), prior)


def _sums_to_one(p: Floats, axes: tuple[int, ...]) -> bool:
    return bool((p >= 0).all() and (np.abs(p.sum(axis=axes) - 1) <= _SUM).all())


def stop_loss(problem: RiskProblem, beliefs: Floats) -> Floats:
    """Expected loss of stopping now (deciding, or giving up if allowed) at beliefs (..., L, M); shape (...)."""
    return decision_loss(beliefs, problem.loss)


def joint_after_taps(channel: Floats, beliefs: Floats) -> Floats:
    """P(symbol, class) of beliefs (n, L, M), shape (n, S, L, M); the sum over classes is P(symbol)."""
    return beliefs[:, np.newaxis] * np.moveaxis(channel, -1, 0)


def after_taps(channel: Floats, beliefs: Floats) -> tuple[Floats, Floats]:
    """Probabilities of the symbols, shape (n, S), and the beliefs after each, shape (n, S, L, M), of beliefs (n, L, M).

    After an impossible symbol the belief is zero.
    """
    joint = joint_after_taps(channel, beliefs)
    probability = joint.sum(axis=(2, 3))
    return probability, joint / np.where(probability > 0, probability, 1.0)[..., np.newaxis, np.newaxis]


def merged(beliefs: Floats) -> tuple[Floats, Integers]:
    """Distinct beliefs of (n, L, M), shape (k, L, M), and the index of each in them, shape (n,).

    Nearly equal beliefs on two sides of a rounding step stay distinct, which only costs memory.
    """
    whole = np.round(beliefs.reshape(len(beliefs), -1) * _GRID).astype(np.int64)
    factors = np.random.default_rng(0).integers(1 << 62, size=whole.shape[1]) * 2 + 1
    _, first, index = np.unique((whole * factors).sum(axis=1), return_index=True, return_inverse=True)
    if not np.array_equal(whole[first][index], whole):  # two beliefs share a hash
        _, first, index = np.unique(whole, axis=0, return_index=True, return_inverse=True)
    return beliefs[first], index.reshape(-1)
