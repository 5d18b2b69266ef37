"""Recursive filters of first order, the same to the last bit however a signal is cut into pieces."""

import math
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiled import compiled


class FirstOrder(NamedTuple):
    """Filter y[t] = now x[t] + before x[t-1] + decay y[t-1].

    Attributes:
        now: Weight of a sample.
        before: Weight of the one before.
        decay: Weight of the last result.
    """

    now: float
    before: float
    decay: float

    @classmethod
    def highpass(cls, cutoff_hz: float, rate_hz: float) -> "FirstOrder":
        """Butterworth filter by the bilinear transform, as `scipy.signal.butter(1, ..., "highpass")`.

        Importing `scipy.signal` takes half a second.
        """
        cutoff = 4 * math.tan(math.pi * (2 * cutoff_hz / rate_hz) / 2)
        scale = 1 / (4 + cutoff)
        return cls(4 * scale, -4 * scale, (4 - cutoff) * scale)

    def __call__(self, signal: NDArray[np.float64], state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Filtered signal.

        Args:
            signal: Shape (n, width).
            state: What the past adds to the next result, shape (width,); changed in place.
        """
        result = np.empty(signal.shape)
        # Other layouts would be compiled anew.
        _filter(np.require(signal, np.float64, ["C", "W"]), *self, state, result)
        return result


@partial(compiled, in_order=True)
def _filter(
    signal: NDArray[np.float64],
    now: float,
    before: float,
    decay: float,
    state: NDArray[np.float64],
    result: NDArray[np.float64],
) -> None:
    n, width = signal.shape
    for t in range(n):
        for k in range(width):
            value = state[k] + now * signal[t, k]
            state[k] = before * signal[t, k] + decay * value
            result[t, k] = value
