"""How long an engine takes for a tap, apart from the first time, in which it may have to be compiled."""

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.measurement.likelihood.forms import TableForm
from ...models.measurement.model import TapModel
from .engine import Engine


class Latency(NamedTuple):
    """Host time of the belief updates in milliseconds.

    Attributes:
        median_ms: Half of them took less.
        high_ms: 99 % of them took less.
        taps: How many there were.
    """

    median_ms: float
    high_ms: float
    taps: int


class TimedEngine:
    """An engine that keeps how long each tap took: its update, and the shift after it.

    Args:
        engine: The one that computes.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._seconds: list[float] = []

    @property
    def name(self) -> str:
        """That of the engine."""
        return self._engine.name

    @property
    def model(self) -> TapModel:
        """That of the engine."""
        return self._engine.model

    def update(self, log_belief: NDArray[np.float64], tap: ArrayLike) -> tuple[NDArray[np.float64], float]:
        """Eq. 3 and 4."""
        began = time.perf_counter()
        try:
            return self._engine.update(log_belief, tap)
        finally:
            self._seconds.append(time.perf_counter() - began)

    def shift(self, log_belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Eq. 9."""
        began = time.perf_counter()
        answer = self._engine.shift(log_belief, delta)
        self._seconds[-1] += time.perf_counter() - began
        return answer

    def latency(self) -> Latency:
        """Of all taps so far; there must be one."""
        median, high = 1e3 * np.quantile(self._seconds, [0.5, 0.99])
        return Latency(float(median), float(high), len(self._seconds))


def warm_up(engine: Engine) -> float:
    """Makes the engine compile what it compiles, with a tap that its model holds for likely.

    Returns:
        How many seconds of host time it took.
    """
    began = time.perf_counter()
    log_belief = engine.model.log_prior
    for delta in (1, -1):
        log_belief, _ = engine.update(log_belief, _likely_tap(engine.model))
        log_belief = engine.shift(log_belief, delta)
    return time.perf_counter() - began


def _likely_tap(model: TapModel) -> NDArray[np.float64]:
    """Under the most probable class: its mean, or the most frequent value of each taxel all the time; shape (J, K)."""
    l, h = np.unravel_index(model.log_prior.argmax(), model.log_prior.shape)
    form = model.form
    if not isinstance(form, TableForm):
        return form.mean[0, l, h]
    edges = np.broadcast_to(model.edges, (model.K, model.edges.shape[-1]))
    taxel, b = np.arange(model.K), form.log_prob[l, h].argmax(axis=-1)
    frame = (edges[taxel, b] + edges[taxel, b + 1]) / 2
    return np.tile(frame, (model.preprocessing.samples, 1))
