"""Resampling of frames to another rate, the same to the last bit however a stream is cut into pieces."""

import math
from collections.abc import Iterator
from fractions import Fraction
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..compiled import compiled
from ..errors import InputError, check_numbers
from .sampling_ratio import HALF_WIDTH, frames_behind, sampling_ratio

_ATTENUATION_DB = 65.0  # of the window; some is lost where the branches are scaled
_AT_ONCE = 2**22  # numbers of cut taps that are resampled together


class Resampler:
    """Windowed-sinc filter that turns a stream of one rate into one of another, without delay in time.

    Result m is the signal at the time of m periods of the new rate after the first frame. Let f be half of the slower
    rate: the new Nyquist frequency if the rate falls. Below 0.8 f amplitudes change by less than 0.1%; at f they are
    halved; what lies above 1.2 f, and would be folded to below 0.8 f, falls by at least 65 dB. A constant stays
    exactly as it is.

    A result waits for `delay` frames after its own. Before the first frame the stream is taken for constant. Memory is
    that of the frames which results to come depend on, 20 periods of the slower rate.

    Args:
        sensor_hz: Rate of the frames.
        rate_hz: Rate of the results.

    Attributes:
        ratio: Results per frame.
        delay: Frames after a result's own that it waits for.

    Raises:
        InputError: The rates have no ratio of small whole numbers.
    """

    def __init__(self, sensor_hz: float, rate_hz: float) -> None:
        self.ratio = sampling_ratio(sensor_hz, rate_hz)
        self._branches = _branches(self.ratio)
        self.delay = frames_behind(self.ratio)
        self._first = np.empty(0)
        self._kept = np.empty((0, 0))
        self._kept_from = -self.delay
        self._made = 0

    def __call__(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Results that these frames complete, shape (any number, K).

        Args:
            frames: The next frames, shape (n, K).
        """
        if not len(self._first):
            if not len(frames):
                return frames
            self._first = frames[0].copy()
            self._kept = np.zeros((self.delay, frames.shape[1]))  # what differs from the first frame
        self._kept = np.concatenate([self._kept, frames - self._first])
        known = self._kept_from + len(self._kept) - self.delay
        made = max(self._made, math.ceil(known * self.ratio))
        result = np.empty((made - self._made, frames.shape[1]))
        up, down = self.ratio.as_integer_ratio()
        _filter(self._kept, self._branches, self._made, self._kept_from + self.delay, up, down, result)
        self._made = made
        drop = min(max(0, made * down // up - self.delay - self._kept_from), len(self._kept))
        self._kept = self._kept[drop:]
        self._kept_from += drop
        return result + self._first


def resampled_taps(taps: ArrayLike, sensor_hz: float, rate_hz: float) -> NDArray[np.float64]:
    """Taps that are already cut at another rate, each by itself, shape (N, J', K).

    Sample m is at m periods of the new rate after the first one, up to the last one. The tap is taken to stay at
    its first sample before it and at its last one after it, so samples near its ends are not those of a resampled
    stream. Where a signal rises at an end by d per sample of the slower rate, the sample there is wrong by 0.1 d, the
    next one by 0.013 d and all others by less than 0.005 d; with a sine of amplitude a and half the slower Nyquist
    frequency these are 0.18 a, 0.03 a and 0.011 a. Where streams are at hand, resample them before they are cut.

    Args:
        taps: Taps of one length, shape (N, J, K).
        sensor_hz: Their rate.
        rate_hz: The new rate.

    Raises:
        InputError: The rates have no ratio of small whole numbers, or samples are missing or not finite.
    """
    taps = check_numbers(taps, "taps")
    if taps.ndim != 3 or 0 in taps.shape:
        raise InputError(f"taps must have shape (N, J, K) without empty axes, got {taps.shape}.")
    if not np.isfinite(taps).all():
        raise InputError("Taps with missing or infinite samples cannot be resampled.")
    if sampling_ratio(sensor_hz, rate_hz) == 1:
        return taps.astype(np.float64)
    return np.concatenate([_together(part, sensor_hz, rate_hz) for part in _parts(taps)])


def _parts(taps: NDArray[np.floating]) -> Iterator[NDArray[np.floating]]:
    at_once = max(1, _AT_ONCE // taps[0].size)
    return (taps[start : start + at_once] for start in range(0, len(taps), at_once))


def _together(taps: NDArray[np.floating], sensor_hz: float, rate_hz: float) -> NDArray[np.float64]:
    N, J, K = taps.shape
    resampler = Resampler(sensor_hz, rate_hz)
    side_by_side = taps.astype(np.float64).transpose(1, 0, 2).reshape(J, N * K)
    held = np.concatenate([side_by_side, np.repeat(side_by_side[-1:], resampler.delay, axis=0)])
    made = resampler(held)[: math.floor((J - 1) * resampler.ratio) + 1]
    return made.reshape(-1, N, K).transpose(1, 0, 2)


@cache
def _branches(ratio: Fraction) -> NDArray[np.float64]:
    """Weights of 2 W + 1 frames around each of `up` places of a result between two frames, shape (up, 2 W + 1)."""
    from scipy.signal import firwin, kaiser_beta  # noqa: PLC0415 - takes half a second to import

    up, down = ratio.as_integer_ratio()
    slower = max(up, down)
    delay, half = frames_behind(ratio), HALF_WIDTH * slower
    kernel = np.zeros(2 * delay * up + up)
    middle = delay * up
    window: Any = ("kaiser", kaiser_beta(_ATTENUATION_DB))
    kernel[middle - half : middle + half + 1] = firwin(2 * half + 1, 1 / slower, window=window)
    branches = kernel.reshape(2 * delay + 1, up).T[:, ::-1]
    return np.ascontiguousarray(branches / branches.sum(axis=1, keepdims=True))


@partial(compiled, in_order=True)
def _filter(
    frames: NDArray[np.float64],
    branches: NDArray[np.float64],
    first: int,
    offset: int,
    up: int,
    down: int,
    result: NDArray[np.float64],
) -> None:
    n, width = result.shape
    weights = branches.shape[1]
    for m in range(n):
        place = (first + m) * down
        begin, branch = place // up - offset, place % up
        for k in range(width):
            result[m, k] = 0.0
        for j in range(weights):
            weight = branches[branch, j]
            for k in range(width):
                result[m, k] += weight * frames[begin + j, k]
