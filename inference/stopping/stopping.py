"""Stopping rules as functions of the belief, for one moment or whole records.

`episode` evaluates a rule after each tap of a rig, `stopping.recorded` applies it to recorded trials.

After each tap a rule returns whether to go on, to decide for the most probable object, or to give up ("null decisions
on ambiguous data", Lepora et al., ICRA 2012). Rules use past taps only, so all guarantees for stopping times apply.

References: Baum and Veeravalli, "A sequential procedure for multihypothesis testing" (1994), for `msprt`; Ville's
inequality for `each_error`.
"""

from collections.abc import Callable, Mapping
from functools import reduce
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.errors import InputError, check_probability
from ...models.measurement.likelihood.bins import TableForm
from ...models.measurement.model import TapModel

GO_ON, DECIDE, GIVE_UP = 0, 1, 2

type Watch = Callable[[NDArray[np.float64], NDArray[np.int64]], Mapping[str, NDArray[np.float64]]]
"""Takes beliefs (n, L, M) after a tap and the moves (n,) that will follow; returns numbers (n,) by name."""


class Moment(NamedTuple):
    """Input of a rule after a tap; any leading axes.

    Attributes:
        what: P(w_m), shape (..., M).
        where_belief: Belief in the most probable position, shape (...).
        number: Number of taps so far, shape (...).
        gain: Expected reduction of the decision's cost by one more tap, in the cost of errors, shape (...); NaN if not
            computed, see `lookahead`.
    """

    what: NDArray[np.float64]
    where_belief: NDArray[np.float64]
    number: NDArray[np.int64]
    gain: NDArray[np.float64]


class StopRule(Protocol):
    """A stopping rule."""

    def __call__(self, moment: Moment) -> NDArray[np.int8]:
        """`GO_ON`, `DECIDE` or `GIVE_UP`, shape (...)."""
        ...


def what_above(threshold: float) -> StopRule:
    """Decides if the belief in an object exceeds theta_W; Eq. 7. With 1, never.

    Raises:
        InputError: The threshold is no number from 0 to 1.
    """
    check_threshold(threshold)
    return lambda moment: _decide_where((_largest(moment.what) > threshold) & (threshold < 1))


def where_above(threshold: float) -> StopRule:
    """Decides if the belief in a position exceeds a threshold; Eq. 8 as a stopping rule.

    Raises:
        InputError: The threshold is no number from 0 to 1.
    """
    check_threshold(threshold)
    return lambda moment: _decide_where((moment.where_belief > threshold) & (threshold < 1))


def both_above(what_threshold: float, where_threshold: float) -> StopRule:
    """Decides if the beliefs in an object and in a position both exceed their thresholds."""
    first, second = what_above(what_threshold), where_above(where_threshold)
    return lambda moment: np.minimum(first(moment), second(moment))


def after(taps: int) -> StopRule:
    """Decides after a fixed number of taps.

    Raises:
        InputError: It is not an integer of at least 1.
    """
    if not (taps >= 1 and float(taps).is_integer()):
        raise InputError(f"The number of taps must be an integer of at least 1, got {taps}.")
    return lambda moment: _decide_where(moment.number >= taps)


def msprt(divergence: ArrayLike, cost: float) -> StopRule:
    """Multihypothesis sequential test with its asymptotic thresholds: p_m > 1 / (1 + cost / divergence_m).

    Optimal as the cost goes to 0, for independent taps at one position.

    Args:
        divergence: Divergence of each object from the nearest other one, in nats per tap, shape (M,); see
            `divergences`.
        cost: Cost of a tap in units of the cost of an error, above 0.

    Raises:
        InputError: The cost or a divergence is not above 0, or infinite.
    """
    divergence = np.asarray(divergence, dtype=np.float64)
    if not 0 < cost < np.inf or not ((divergence > 0) & (divergence < np.inf)).all():
        raise InputError(f"msprt needs a finite cost and divergences above 0, got {cost} and {divergence.tolist()}.")
    thresholds = 1.0 / (1.0 + cost / divergence)

    def rule(moment: Moment) -> NDArray[np.int8]:
        return _decide_where((moment.what > thresholds).any(axis=-1))

    return rule


def divergences(model: TapModel, where: int) -> NDArray[np.float64]:
    """Divergence of each object from the most similar one at a position, in nats per tap, shape (M,).

    The mean of the log-likelihood ratio of Eq. 1, with its root, over taps drawn from the histograms: exponent times
    samples times the sum over taxels of the relative entropies.

    Args:
        model: Fitted histograms without states.
        where: Index of the position.

    Raises:
        InputError: The model is of another kind, the position does not exist, there is only one object, or an object
            was not trained there.
    """
    form, (L, M) = model.form, model.grid.shape
    if not isinstance(form, TableForm) or form.shape != (L, M):
        raise InputError(f"Divergences need a histogram model without states, not a {model.name} model.")
    if not 0 <= where < L or M < 2:
        raise InputError(
            f"Divergences need two objects and a position from 0 to {L - 1}, got {M} and position {where}."
        )
    if not model.trained[where].all():
        raise InputError(f"Not every object was trained at position {where}.")
    log_p = form.log_prob[where].reshape(M, -1)
    p = np.exp(log_p)
    finite = np.where(p > 0, log_p, 0.0)
    with np.errstate(invalid="ignore"):
        terms = np.where(p[:, np.newaxis] > 0, finite[:, np.newaxis] - log_p, 0.0)
    each = (p[:, np.newaxis] * terms).sum(axis=-1)
    np.fill_diagonal(each, np.inf)
    return model.exponent * model.preprocessing.samples * each.min(axis=1)


def mean_error(error: float) -> StopRule:
    """Limits the fraction of wrong decisions if the model is correct: theta_W = 1 - error.

    Raises:
        InputError: The error is not between 0 and 1.
    """
    return what_above(1.0 - _share(error))


def each_error(error: float, M: int) -> StopRule:
    """Limits the fraction of wrong decisions for each object if the model is correct and objects are equally probable.

    By Ville's inequality P_w(wrong) <= (M - 1) (1 - theta) / theta, so theta_W = (M - 1) / (M - 1 + error).

    Raises:
        InputError: The error is not between 0 and 1, or M is below 1.
    """
    if M < 1:
        raise InputError(f"The number of objects must be at least 1, got {M}.")
    return what_above((M - 1) / (M - 1 + _share(error)))


def lookahead(cost: float) -> StopRule:
    """Decides if the expected gain of one more tap does not exceed its cost, in units of the loss; see `expected_gain`.

    Raises:
        InputError: The cost is not above 0, or, on a call, the gain was not computed.
    """
    if not 0 < cost < np.inf:
        raise InputError(f"The cost of a tap must be above 0, got {cost}.")

    def rule(moment: Moment) -> NDArray[np.int8]:
        if np.isnan(moment.gain).any():
            raise InputError("lookahead needs the expected gain of the next tap; pass a gain_watch as watch.")
        return _decide_where(moment.gain <= cost)

    return rule


def or_give_up(rule: StopRule, taps: int, belief: float = 0.0) -> StopRule:
    """A rule that, after a number of taps, gives up unless the belief in an object exceeds `belief`.

    With `belief` 0 it always decides then; with 1 it always gives up.

    Raises:
        InputError: The number of taps is below 1, or the belief is not between 0 and 1.
    """
    if not (taps >= 1 and 0 <= belief <= 1):
        raise InputError(f"Giving up needs at least 1 tap and a belief from 0 to 1, got {taps} and {belief}.")

    def either(moment: Moment) -> NDArray[np.int8]:
        late = np.where(_largest(moment.what) > belief, DECIDE, GIVE_UP)
        answer = rule(moment)
        return np.where((answer == GO_ON) & (moment.number >= taps), late, answer).astype(np.int8)

    return either


def _largest(what: NDArray[np.float64]) -> NDArray[np.float64]:
    """Belief in the most probable object, shape (...); object by object, as NumPy is slow along a short last axis."""
    return reduce(np.maximum, np.moveaxis(what, -1, 0))


def _decide_where(stop: NDArray[np.bool_]) -> NDArray[np.int8]:
    return np.where(stop, DECIDE, GO_ON).astype(np.int8)


def check_threshold(threshold: float) -> None:
    """Refuses a threshold that is no number from 0 to 1.

    Raises:
        InputError: It is none.
    """
    check_probability(threshold, "The threshold on a belief")


def _share(error: float) -> float:
    if not 0 < error < 1:
        raise InputError(f"The error must be between 0 and 1, got {error}.")
    return error
