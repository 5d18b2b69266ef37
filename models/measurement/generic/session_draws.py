"""How many draws of a new session a generative model needs, and how exact it is with them."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...seeds import Purpose, generator
from ...settings import FitSettings
from ..states import States

if TYPE_CHECKING:
    from ..fits.priors import Taps
    from ..model import Fitted

FEWEST = 128
"""Draws of a new session where the model decides at one value, at least."""
_MOST = 2048
_AT_MOST = 1 << 24  # numbers that a table of taps or bins under all hypotheses holds, beyond the fewest draws
_LARGE_ERROR = 0.1  # nats
_TOO_LARGE = 3.0  # nats, which four times as many draws than `FEWEST` hardly halve
_EPISODES, _TAPS = 12, 10  # by which draws are judged
_PARTS = 16  # of draws
_MOST_KEPT = 0.9  # of the gain by four times as many draws, by the next four times as many


def some_episodes(session: NDArray[np.intp], generator: np.random.Generator) -> list[NDArray[np.intp]]:
    """Indices of taps of the same session, several times."""
    episodes = []
    for number in generator.choice(session, size=_EPISODES):
        rows = np.flatnonzero(session == number)
        episodes.append(generator.permutation(rows)[:_TAPS])
    return episodes


def error_of_mean(log_weight: NDArray[np.float64]) -> float:
    """Mean error of the logs of the means of weights, in nats; NaN for less than 16 draws.

    Half of the difference between two halves of the draws. Where a few draws have all the weight, both halves miss what
    is likely, and the log of the mean is higher the more draws there are: if what it gains from a sixteenth to a fourth
    of the draws, and from there to all, goes on as a geometric series, what is still to be gained is the error.

    Args:
        log_weight: Of D draws, at points of which every part is spread evenly, for each of E groups of taps, shape
            (D, E).
    """
    if len(log_weight) < _PARTS:
        return np.nan

    def means(parts: int) -> NDArray[np.float64]:
        each = np.array_split(log_weight, parts)
        return np.stack([np.logaddexp.reduce(part, axis=0) - np.log(len(part)) for part in each])

    halves = means(2)
    before, gain = np.diff([means(parts).mean() for parts in (_PARTS, _PARTS // 4, 1)])
    kept = min(gain / before, _MOST_KEPT) if min(before, gain) > 0 else 0.0
    return float(max(0.5 * np.abs(halves[0] - halves[1]).mean(), gain * kept / (1 - kept)))


def enough_sessions(
    fitted: "Fitted", settings: FitSettings, known: "Taps", session: NDArray[np.intp]
) -> tuple[Any, str]:
    """Model with as many draws of a new session as make it exact, as far as tables stay small.

    Args:
        fitted: The model with the fewest draws.
        settings: Those of the fit; no draws are added to those that they ask for.
        known: Training taps.
        session: Index of the session of each.

    Returns:
        The model, and a sentence where it is not exact.
    """
    model: Any = fitted.model
    episodes = some_episodes(session, generator(0, Purpose.SHARED_SESSION))
    N, J, K = known.samples.shape
    largest = model.grid.L * model.grid.M * max(N, K * max(J, model.edges.shape[-1] - 1))

    def error_of(model: Any) -> float:
        return model.integration_error(known.samples, (known.where, known.what), episodes)

    used = fitted.integrated(settings.integrate, settings.seed).model if settings.integrate else model
    error, draws = error_of(used), len(used.states.gain)
    while not settings.integrate and error > _LARGE_ERROR and 4 * draws <= min(_MOST, _AT_MOST // largest):
        draws *= 4
        model = replace(model, states=States.alike(draws))
        error = error_of(model)
    if not error > _LARGE_ERROR:  # or not known
        return model, ""
    told = f"{error:.2g}" if error < 100 else f"{error:.0f}"
    names = ", ".join(model.program.structure.by_session)
    hopeless = draws >= FEWEST and error > _TOO_LARGE
    more = "More draws, --integrate D, help little: give" if hopeless else "Use more, --integrate D, or give"
    return model, (
        f"What belongs to a new session ({names}) is one of {draws} draws, by which the log evidence of {_TAPS} taps "
        f"is off by about {told} nats. {more} a session fewer variables."
    )
