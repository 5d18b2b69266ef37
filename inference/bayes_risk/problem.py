"""Sequential decisions small enough to be written down: taps that are symbols, costs, and beliefs that can be counted.

The world is the one in which the filter is right: object and place from the prior, symbols from a channel given the
class, moves that end at the ends of the range (border `clamp`). Costs add up: each tap, each where class really moved,
and the loss of the decision. The first tap is always made; after each one decides or moves and taps again.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.errors import InputError
from ..information import TapOutcomes, tap_outcomes
from ..moves.expected_gain import checked_loss, decision_loss

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]

_SUM = 1e-9  # by which sums of given probabilities may miss one
_GRID = 2.0**43  # beliefs that differ by less than about 1e-13 are the same but for rounding


class RiskProblem(NamedTuple):
    """What is to be decided, and what it costs; see `bayes_risk.problem`.

    Attributes:
        channel: P(symbol | class), shape (L, M, S).
        loss: What each decision costs with each object, shape (A, M): the M objects first; a further row is that of
            giving up.
        tap_cost: Of a tap, in the unit of the loss.
        class_cost: Of a where class really moved.
        most_taps: After so many taps one decides.
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
    """A problem from its parts; without a prior all classes are as likely.

    Raises:
        InputError: Shapes or sums contradict each other, a cost is negative, or no tap is allowed.
    """
    channel = np.asarray(channel, dtype=np.float64)
    if channel.ndim != 3 or not _sums_to_one(channel, (-1,)):
        raise InputError(
            f"A channel has axes (where, what, symbol) and sums to one over the last, got {channel.shape}."
        )
    L, M, _ = channel.shape
    loss = checked_loss(loss, M)
    if len(loss) not in (M, M + 1):
        raise InputError(f"A loss has a row for each of {M} objects and one more for giving up, got {len(loss)} rows.")
    prior = np.full((L, M), 1.0 / (L * M)) if prior is None else np.asarray(prior, dtype=np.float64)
    if prior.shape != (L, M) or not _sums_to_one(prior, (0, 1)):
        raise InputError(f"A prior over {L} x {M} classes (where, what) sums to one, got shape {prior.shape}.")
    if not (0 <= tap_cost < np.inf and 0 <= class_cost < np.inf) or most_taps < 1:
        raise InputError(
            f"Costs are numbers from 0 on and at least one tap is made, got {tap_cost}, {class_cost} and {most_taps}."
        )
    return RiskProblem(channel, loss, float(tap_cost), float(class_cost), int(most_taps), prior)


def _sums_to_one(p: Floats, axes: tuple[int, ...]) -> bool:
    return bool((p >= 0).all() and (np.abs(p.sum(axis=axes) - 1) <= _SUM).all())


def stop_loss(problem: RiskProblem, beliefs: Floats) -> Floats:
    """Expected loss of deciding now, or giving up where that is allowed, of beliefs (..., L, M); shape (...)."""
    return decision_loss(beliefs, problem.loss)


def joint_after_taps(channel: Floats, beliefs: Floats) -> Floats:
    """P(symbol, class) of beliefs (n, L, M), shape (n, S, L, M); each symbol's sum is its probability."""
    return beliefs[:, np.newaxis] * np.moveaxis(channel, -1, 0)


def after_taps(channel: Floats, beliefs: Floats) -> tuple[Floats, Floats]:
    """Probabilities of the symbols, shape (n, S), and the beliefs after each, shape (n, S, L, M), of beliefs (n, L, M).

    After an impossible symbol the belief is zero.
    """
    joint = joint_after_taps(channel, beliefs)
    probability = joint.sum(axis=(2, 3))
    return probability, joint / np.where(probability > 0, probability, 1.0)[..., np.newaxis, np.newaxis]


def merged(beliefs: Floats) -> tuple[Floats, Integers]:
    """The different ones among beliefs (n, L, M), shape (k, L, M), and which of them each is, shape (n,).

    Beliefs on two sides of a rounding step stay two, which costs room and nothing else.
    """
    whole = np.round(beliefs.reshape(len(beliefs), -1) * _GRID).astype(np.int64)
    factors = np.random.default_rng(0).integers(1 << 62, size=whole.shape[1]) * 2 + 1
    _, first, index = np.unique((whole * factors).sum(axis=1), return_index=True, return_inverse=True)
    if not np.array_equal(whole[first][index], whole):  # two beliefs share a hash
        _, first, index = np.unique(whole, axis=0, return_index=True, return_inverse=True)
    return beliefs[first], index.reshape(-1)
