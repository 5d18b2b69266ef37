"""Latency of an engine per tap, excluding compilation at the first tap."""

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.measurement.likelihood.bins import TableForm
from ...models.measurement.likelihood.forms import GaussianForm
from ...models.measurement.model import TapModel
from ...models.seeds import Purpose, generator
from .engine import Engine


class Latency(NamedTuple):
    """Host time of the belief updates in milliseconds.

    Attributes:
        median_ms: Median.
        high_ms: 99th percentile.
        taps: Number of taps.
    """

    median_ms: float
    high_ms: float
    taps: int


class TimedEngine:
    """An engine that records the time of each tap: its update and the shift after it.

    Args:
        engine: Engine to be timed.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._seconds: list[float] = []

    @property
    def name(self) -> str:
        """Name of the timed engine."""
        return self._engine.name

    @property
    def model(self) -> TapModel:
        """Model of the timed engine."""
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
        """Latency over all taps so far, at least one."""
        median, high = 1e3 * np.quantile(self._seconds, [0.5, 0.99])
        return Latency(float(median), float(high), len(self._seconds))


def warm_up(engine: Engine) -> float:
    """Compiles the engine, with a tap that is likely under its model.

    Returns:
        Host time in seconds.
    """
    began = time.perf_counter()
    log_belief = engine.model.log_prior
    for delta in (1, -1):
        log_belief, _ = engine.update(log_belief, _likely_tap(engine.model))
        log_belief = engine.shift(log_belief, delta)
    return time.perf_counter() - began


def _likely_tap(model: TapModel) -> NDArray[np.float64]:
    """Likely tap of the most probable class: its mean, or the mode of each taxel throughout; shape (J, K)."""
    l, h = np.unravel_index(model.log_prior.argmax(), model.log_prior.shape)
    form = model.form
    if isinstance(form, GaussianForm):
        return form.mean[0, l, h]
    if not isinstance(form, TableForm):
        drawn = generator(0, Purpose.MODEL)
        return form.sample(np.array([l]), np.array([h]), model.edges, model.preprocessing.samples, drawn)[0]
    edges = np.broadcast_to(model.edges, (model.K, model.edges.shape[-1]))
    taxel, b = np.arange(model.K), form.log_prob[l, h].argmax(axis=-1)
    frame = (edges[taxel, b] + edges[taxel, b + 1]) / 2
    return np.tile(frame, (model.preprocessing.samples, 1))
