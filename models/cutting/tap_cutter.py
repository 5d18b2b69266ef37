"""Preprocesses a stream of sensor frames and cuts it into taps; the same code offline and at the rig."""

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..preprocessing import Preprocessing

if TYPE_CHECKING:
    from ..first_order import FirstOrder
    from .resampling import Resampler

REARMED = 0.5
"""Part of the trigger level below which all taxels are when a contact has ended."""


class CutTap(NamedTuple):
    """One tap cut from a stream.

    Attributes:
        start: Index of its first sample in the stream, counted in samples after resampling.
        samples: Preprocessed samples, shape (J, K).
        frame: Index of the sensor's frame that triggered it: the first one, that of the contact, or the first after the
            press.
    """

    start: int
    samples: NDArray[np.float64]
    frame: int


class _Begin(NamedTuple):
    """Where a tap begins: index of its first sample, and the frame that triggered it."""

    start: int
    frame: int


class TapCutter:
    """Preprocesses frames and cuts taps as they arrive, independently of how a stream is split into pieces.

    It holds at most one tap and the frames before it, and with a change of the rate what the filter needs. Taps cut
    short by the start or end of the stream are not returned; `incomplete` counts them. With a change of the rate a tap
    is complete only some frames after its last one, see `Resampler.delay`.

    Args:
        preprocessing: Preprocessing; its trigger must not be `"none"`.
        baseline: What a tare over the stream subtracts from the used taxels, shape (K,), where the stream begins in
            contact, so that its first frames do not tell; the next tap begins after this contact.

    Attributes:
        incomplete: Number of taps that were not completed.
        overlapping: How many of these were given up for the next press.

    Raises:
        InputError: The record has no trigger.
    """

    def __init__(self, preprocessing: Preprocessing, baseline: NDArray[np.float64] | None = None) -> None:
        if preprocessing.trigger == "none":
            raise InputError("Cutting a stream into taps needs a clock, contact or press trigger.")
        self.preprocessing = preprocessing
        self.incomplete = self.overlapping = 0
        self._ratio = preprocessing.ratio
        self._resampler = _resampler(preprocessing)
        self._filter = _highpass(preprocessing.highpass_hz, preprocessing.rate_hz)
        self._filter_state: NDArray[np.float64] | None = None
        self._tare = baseline
        self._untared: list[NDArray[np.float64]] = []
        self._taxels: int | None = None
        self._arrived = 0
        self._kept = np.empty((0, 0))
        self._kept_from = 0
        self._begun: deque[_Begin] = deque()
        self._armed = baseline is None
        self._scanned = 0

    @property
    def baseline(self) -> NDArray[np.float64] | None:
        """What a tare over the stream subtracts, shape (K,); `None` before it is known or without one."""
        return self._tare

    def push(self, frames: ArrayLike) -> list[CutTap]:
        """Taps completed by these frames.

        Args:
            frames: Sensor frames in the order of time, shape (n, K), any n including 0.

        Raises:
            InputError: The frames are not finite, differ in the number of taxels from earlier ones, or lack a taxel.
        """
        frames = self._checked(np.asarray(frames, dtype=np.float64))
        self._arrived += len(frames)
        if self._resampler is not None:
            frames = self._resampler(frames)
        prepared = self._highpass(self._tared(frames))
        self._kept = np.concatenate([self._kept.reshape(-1, frames.shape[1]), prepared])
        return self._cut()

    def press(self) -> None:
        """Starts a tap: the next frame is the first after the press; the tap includes `pre_samples` samples before it.

        With a change of the rate the press is at the first sample that is not before that frame. An unfinished tap is
        dropped and counts as incomplete and overlapping. One that begins before the stream or, with a tare over the
        stream, before the end of the tare, counts as incomplete.

        Raises:
            InputError: The record has another trigger.
        """
        record = self.preprocessing
        if record.trigger != "press":
            raise InputError(f"press() needs trigger='press', not {record.trigger!r}.")
        first = math.ceil(self._arrived * self._ratio)
        while self._begun and self._begun[-1].start + record.samples > first:
            self._begun.pop()
            self.incomplete += 1
            self.overlapping += 1
        if first < record.pre_samples or (record.tare == "stream" and first < record.tare_samples):
            self.incomplete += 1
        else:
            self._begun.append(_Begin(first - record.pre_samples, self._arrived))

    def finish(self) -> None:
        """Ends the stream; a tap in progress counts as incomplete."""
        self.incomplete += len(self._begun)
        self._begun.clear()

    def _checked(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """The frames of the used taxels."""
        if frames.ndim != 2 or not frames.shape[1]:
            raise InputError(f"Frames must have shape (n, K) with at least one taxel, got {frames.shape}.")
        if self._taxels not in (None, frames.shape[1]):
            raise InputError(f"Frames have {frames.shape[1]} taxels, earlier ones {self._taxels}.")
        used = self.preprocessing.taxels
        if used is not None:
            if used[-1] >= frames.shape[1]:
                raise InputError(f"Frames have {frames.shape[1]} taxels, but taxel {used[-1]} is used, counted from 0.")
            chosen = frames[:, used]
        else:
            chosen = frames
        if not np.isfinite(chosen).all():
            raise InputError(f"Frame {int(np.argmin(np.isfinite(chosen).all(axis=1)))} has a NaN or infinite value.")
        self._taxels = frames.shape[1]
        return chosen

    def _tared(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Subtracts the mean of the first frames; holds frames back until there are enough."""
        if self.preprocessing.tare != "stream":
            return frames
        if self._tare is None:
            self._untared.append(frames)
            frames = np.concatenate(self._untared)
            if len(frames) < self.preprocessing.tare_samples:
                self._untared = [frames]
                return frames[:0]
            self._tare = frames[: self.preprocessing.tare_samples].mean(axis=0)
            self._untared = []
        return frames - self._tare

    def _highpass(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._filter is None or len(frames) == 0:
            return frames
        state = self._filter_state
        if state is None:
            state = self._filter_state = np.asarray(self._filter.before * frames[0])  # as after the same frame for ever
        return self._filter(frames, state)

    def _cut(self) -> list[CutTap]:
        record, end = self.preprocessing, self._kept_from + len(self._kept)
        taps: list[CutTap] = []
        while self._begun or self._find_begin():
            start, frame = self._begun[0]
            if start + record.samples > end:
                break
            self._begun.popleft()
            first = start - self._kept_from
            window = self._kept[first : first + record.samples].copy()
            if record.trigger == "contact":
                self._armed = bool(self._load(window[-1:])[0] < REARMED)
            if record.tare == "tap":
                window -= window[: record.tare_samples].mean(axis=0)
            taps.append(CutTap(start, window, frame))
            self._scanned = start + record.samples
        oldest = (end if record.trigger == "press" else self._scanned) - record.pre_samples
        if self._begun:
            oldest = min(self._begun[0].start, oldest) if record.trigger == "press" else self._begun[0].start
        drop = max(0, min(oldest - self._kept_from, len(self._kept)))
        self._kept = self._kept[drop:]
        self._kept_from += drop
        return taps

    def _load(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Largest load of a taxel in each frame, as a fraction of the trigger level."""
        return (frames / self.preprocessing.trigger_level).max(axis=1)

    def _find_begin(self) -> bool:
        """Whether there is another tap, which is then begun; skips frames that start none."""
        record = self.preprocessing
        end = self._kept_from + len(self._kept)
        if record.trigger == "press":
            return False
        if record.trigger == "clock":
            if self._scanned < end:
                self._begin(self._scanned, self._scanned)
            return self._scanned < end
        for load in self._load(self._kept[self._scanned - self._kept_from :]):
            frame = self._scanned
            self._scanned += 1
            if self._armed and load >= 1.0:
                self._armed = False
                if frame >= record.pre_samples and frame - record.pre_samples >= self._kept_from:
                    self._begin(frame - record.pre_samples, frame)
                    return True
                self.incomplete += 1
            elif load < REARMED:
                self._armed = True
        return False

    def _begin(self, start: int, trigger: int) -> None:
        """Notes the beginning of a tap that a sample triggered."""
        self._begun.append(_Begin(start, math.floor(trigger / self._ratio)))


def _resampler(record: Preprocessing) -> "Resampler | None":
    if record.sensor_hz is None or record.rate_hz is None:
        return None
    from .resampling import Resampler  # noqa: PLC0415 - numba takes a quarter of a second to import

    return Resampler(record.sensor_hz, record.rate_hz)


def _highpass(cutoff_hz: float, rate_hz: float | None) -> "FirstOrder | None":
    if not cutoff_hz or rate_hz is None:
        return None
    from ..first_order import FirstOrder  # noqa: PLC0415 - numba takes a quarter of a second to import

    return FirstOrder.highpass(cutoff_hz, rate_hz)
