"""When to stop, given the belief: functions behind one type, of one moment or of whole records at once.

`episode` asks a rule after each tap of a rig, `stopping.recorded` reads where it ends trials that were played
beforehand.

A rule says after each tap whether to go on, to decide for the most probable object, or to give up: "null decisions on
ambiguous data" (Lepora et al., ICRA 2012) are answers of their own. None looks at what will be drawn later, so every
guarantee that holds for stopping times holds for them.

References: Baum and Veeravalli, "A sequential procedure for multihypothesis testing" (1994), for `msprt`; Ville's
inequality for `each_error`.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.errors import InputError
from ...models.measurement.likelihood.forms import TableForm
from ...models.measurement.model import TapModel

GO_ON, DECIDE, GIVE_UP = 0, 1, 2

type Watch = Callable[[NDArray[np.float64], NDArray[np.int64]], Mapping[str, NDArray[np.float64]]]
"""Looks at beliefs (n, L, M) after a tap and the moves (n,) that will follow; gives numbers (n,) by name."""


class Moment(NamedTuple):
    """What a rule sees after a tap; any leading axes.

    Attributes:
        what: P(w_m), shape (..., M).
        where_belief: Belief in the most probable place, shape (...).
        number: Taps so far, counted from 1, shape (...).
        gain: By how much less a decision is expected to cost after one more tap, in the cost of errors, shape (...);
            NaN where nobody has computed it, see `lookahead`.
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
    """The belief in an object exceeds theta_W; Eq. 7. A threshold of 1 or more never does.

    Raises:
        InputError: The threshold is no number.
    """
    check_threshold(threshold)
    return lambda moment: _decide_where((moment.what.max(axis=-1) > threshold) & (threshold < 1))


def where_above(threshold: float) -> StopRule:
    """The belief in a place exceeds a threshold; Eq. 8 as a stopping rule.

    Raises:
        InputError: The threshold is no number.
    """
    check_threshold(threshold)
    return lambda moment: _decide_where((moment.where_belief > threshold) & (threshold < 1))


def both_above(what_threshold: float, where_threshold: float) -> StopRule:
    """Both do at once."""
    first, second = what_above(what_threshold), where_above(where_threshold)
    return lambda moment: np.minimum(first(moment), second(moment))


def after(taps: int) -> StopRule:
    """A fixed number of taps.

    Raises:
        InputError: It is no whole number from one on.
    """
    if not (taps >= 1 and float(taps).is_integer()):
        raise InputError(f"At least one tap is needed to decide, and a whole number of them, got {taps}.")
    return lambda moment: _decide_where(moment.number >= taps)


def msprt(divergence: ArrayLike, cost: float) -> StopRule:
    """The multihypothesis sequential test with its asymptotic thresholds: p_m > 1 / (1 + cost / divergence_m).

    Optimal as the cost goes to 0, for independent taps at one place. `cost` is that of a tap in units of the cost of an
    error.

    Args:
        divergence: Of each object from the nearest other one per tap, in nats, shape (M,), see `divergences`.
        cost: Above 0.

    Raises:
        InputError: The cost or a divergence is not above 0, or infinite.
    """
    divergence = np.asarray(divergence, dtype=np.float64)
    if not 0 < cost < np.inf or not ((divergence > 0) & (divergence < np.inf)).all():
        raise InputError(f"msprt needs finite costs and divergences above 0, got {cost} and {divergence.tolist()}.")
    thresholds = 1.0 / (1.0 + cost / divergence)

    def rule(moment: Moment) -> NDArray[np.int8]:
        return _decide_where((moment.what > thresholds).any(axis=-1))

    return rule


def divergences(model: TapModel, where: int) -> NDArray[np.float64]:
    """How fast taps at a place tell each object from the one it is most like, in nats per tap, shape (M,).

    That is the mean of the log-likelihood ratio of Eq. 1, with its root, over the taps that the histograms themselves
    give: exponent times samples times the sum over taxels of the relative entropies.

    Args:
        model: Fitted histograms without states.
        where: Where class.

    Raises:
        InputError: The model is no such one, there is no such class or no rival, or an object was not trained there.
    """
    form, (L, M) = model.form, model.grid.shape
    if not isinstance(form, TableForm) or form.shape != (L, M):
        raise InputError(f"Divergences are computed from histograms without states, and this is a {model.name} model.")
    if not 0 <= where < L or M < 2:
        raise InputError(f"Divergences need two objects and a class from 0 to {L - 1}, got {M} and class {where}.")
    if not model.trained[where].all():
        raise InputError(f"Not every object was trained in class {where}.")
    log_p = form.log_prob[where].reshape(M, -1)
    p = np.exp(log_p)
    finite = np.where(p > 0, log_p, 0.0)
    with np.errstate(invalid="ignore"):
        terms = np.where(p[:, np.newaxis] > 0, finite[:, np.newaxis] - log_p, 0.0)
    each = (p[:, np.newaxis] * terms).sum(axis=-1)
    np.fill_diagonal(each, np.inf)
    return model.exponent * model.preprocessing.samples * each.min(axis=1)


def mean_error(error: float) -> StopRule:
    """At most this share of decisions is wrong where the model is right: theta_W = 1 - error.

    Raises:
        InputError: The error is no share.
    """
    return what_above(1.0 - _share(error))


def each_error(error: float, M: int) -> StopRule:
    """At most this share is wrong of each object, where the model is right and objects are equally probable.

    By Ville's inequality P_w(wrong) <= (M - 1) (1 - theta) / theta, so theta_W = (M - 1) / (M - 1 + error).

    Raises:
        InputError: The error is no share, or there is no object.
    """
    if M < 1:
        raise InputError(f"There must be an object to be wrong about, got {M}.")
    return what_above((M - 1) / (M - 1 + _share(error)))


def lookahead(cost: float) -> StopRule:
    """One more tap is expected to save no more than it costs; `cost` in the unit of losses, see `expected_gain`.

    Raises:
        InputError: The cost is not above 0, or when called where nobody has computed the gain.
    """
    if not 0 < cost < np.inf:
        raise InputError(f"A tap must cost something, got {cost}.")

    def rule(moment: Moment) -> NDArray[np.int8]:
        if np.isnan(moment.gain).any():
            raise InputError("Looking ahead needs the gain of the next tap, and nobody has watched it.")
        return _decide_where(moment.gain <= cost)

    return rule


def or_give_up(rule: StopRule, taps: int, belief: float = 0.0) -> StopRule:
    """As a rule says, but after so many taps an object is decided only if the belief in it exceeds `belief`.

    With `belief` 0 everything is decided then; with 1 nothing is.

    Raises:
        InputError: The number of taps is below one, or the belief is none.
    """
    if not (taps >= 1 and 0 <= belief <= 1):
        raise InputError(f"To give up takes a tap or more and a belief from 0 to 1, got {taps} and {belief}.")

    def either(moment: Moment) -> NDArray[np.int8]:
        late = np.where(moment.what.max(axis=-1) > belief, DECIDE, GIVE_UP)
        answer = rule(moment)
        return np.where((answer == GO_ON) & (moment.number >= taps), late, answer).astype(np.int8)

    return either


def _decide_where(stop: NDArray[np.bool_]) -> NDArray[np.int8]:
    return np.where(stop, DECIDE, GO_ON).astype(np.int8)


def check_threshold(threshold: float) -> None:
    """Refuses a threshold on a belief that is no number.

    Raises:
        InputError: It is NaN.
    """
    if np.isnan(threshold):
        raise InputError("A threshold on a belief must be a number, got NaN.")


def _share(error: float) -> float:
    if not 0 < error < 1:
        raise InputError(f"An error must be a share between 0 and 1, got {error}.")
    return error
