"""Preprocessing of a stream of sensor frames into taps; the same code offline and at the rig.

A histogram of high-pass filtered counts does not apply to raw counts, so the preprocessing is part of the data: it is
stored in every `TapSet` and every fitted model, and a model refuses taps with another preprocessing.
"""

import json
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError, check_count, check_numbers

if TYPE_CHECKING:
    from .first_order import FirstOrder


@dataclass(frozen=True)
class Preprocessing:
    """Record of the preprocessing of a tap, in the order of the fields.

    >>> Preprocessing(samples=50, rate_hz=50.0).differences(Preprocessing(samples=40, rate_hz=50.0))
    ['samples is 50 here and 40 there']

    Attributes:
        samples: Number of samples in a tap, `J`.
        rate_hz: Sampling rate in hertz, `None` if unknown.
        tare: Value subtracted from each taxel: none, the mean of the first `tare_samples` frames of the stream, or
            the mean of the first `tare_samples` samples of each tap.
        tare_samples: Number of samples averaged for the tare.
        highpass_hz: Cut-off frequency of a causal first-order Butterworth high-pass filter over the whole stream,
            started in its steady state; 0 for none.
        trigger: Start of a tap: `"none"` (taps are already cut), `"clock"` (every `samples` frames), `"contact"` (a
            taxel reaches `trigger_level`; rearmed when all are below half of it) or `"press"` (signalled by the rig).
        trigger_level: Preprocessed value that counts as contact, in the unit of the samples; negative for sensors whose
            values fall under load.
        pre_samples: Number of samples before the contact or the press.
    """

    samples: int
    rate_hz: float | None = None
    tare: Literal["none", "stream", "tap"] = "none"
    tare_samples: int = 0
    highpass_hz: float = 0.0
    trigger: Literal["none", "clock", "contact", "press"] = "none"
    trigger_level: float = 0.0
    pre_samples: int = 0

    def __post_init__(self) -> None:
        """Checks the record.

        Raises:
            InputError: A field contradicts another or lies outside its range.
        """
        for name in ("rate_hz", "highpass_hz", "trigger_level"):
            if not np.isfinite(check_numbers(getattr(self, name) or 0.0, name)):
                raise InputError(f"{name} must be finite, got {getattr(self, name)}.")
        for name, least in (("samples", 1), ("tare_samples", 0), ("pre_samples", 0)):
            object.__setattr__(self, name, check_count(getattr(self, name), name, least))
        if self.rate_hz is not None and not self.rate_hz > 0:
            raise InputError(f"rate_hz must be positive, got {self.rate_hz}.")
        if self.tare not in ("none", "stream", "tap"):
            raise InputError(f"tare must be none, stream or tap, got {self.tare!r}.")
        if (self.tare == "none") != (self.tare_samples == 0) or self.tare_samples < 0:
            raise InputError(f"tare={self.tare!r} does not match tare_samples={self.tare_samples}.")
        if self.tare == "tap" and self.tare_samples > self.samples:
            raise InputError(f"tare_samples={self.tare_samples} exceeds samples={self.samples}.")
        if self.highpass_hz < 0:
            raise InputError(f"highpass_hz must not be negative, got {self.highpass_hz}.")
        if self.highpass_hz > 0 and (self.rate_hz is None or self.highpass_hz >= self.rate_hz / 2):
            raise InputError(
                f"A high-pass filter at {self.highpass_hz} Hz needs a sampling rate above {2 * self.highpass_hz} Hz, "
                f"got rate_hz={self.rate_hz}."
            )
        if self.trigger not in ("none", "clock", "contact", "press"):
            raise InputError(f"trigger must be none, clock, contact or press, got {self.trigger!r}.")
        if (self.trigger == "contact") != (self.trigger_level != 0):
            raise InputError(f"trigger={self.trigger!r} does not match trigger_level={self.trigger_level}.")
        if self.pre_samples and (self.trigger not in ("contact", "press") or not 0 < self.pre_samples < self.samples):
            raise InputError(
                f"pre_samples={self.pre_samples} needs a contact or press trigger and must be smaller than "
                f"samples={self.samples}."
            )

    def differences(self, other: Self, here: str = "here", there: str = "there") -> list[str]:
        """Differences of `other`, one phrase per field; empty if both are equal.

        Args:
            other: Another record.
            here: Description of this one's owner.
            there: Description of the other one's owner.
        """
        return [
            f"{field.name} is {getattr(self, field.name)} {here} and {getattr(other, field.name)} {there}"
            for field in fields(self)
            if getattr(self, field.name) != getattr(other, field.name)
        ]

    def to_json(self) -> str:
        """The record as JSON, for file attributes."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Record from the result of `to_json`.

        Raises:
            InputError: The text is not such a record.
        """
        try:
            return cls(**json.loads(text))
        except InputError:
            raise
        except (TypeError, ValueError, ArithmeticError, RecursionError) as error:
            raise InputError(f"Not a preprocessing record: {text!r:.80}.") from error


class CutTap(NamedTuple):
    """One tap cut from a stream.

    Attributes:
        start: Index of its first frame in the stream.
        samples: Preprocessed samples, shape (J, K).
    """

    start: int
    samples: NDArray[np.float64]


class TapCutter:
    """Preprocesses frames and cuts taps as they arrive, independently of how a stream is split into pieces.

    It holds at most one tap and the frames before it. Taps cut short by the start or end of the stream are not
    returned; `incomplete` counts them.

    Args:
        preprocessing: Preprocessing; its trigger must not be `"none"`.

    Raises:
        InputError: The record has no trigger.
    """

    def __init__(self, preprocessing: Preprocessing) -> None:
        if preprocessing.trigger == "none":
            raise InputError("Cutting a stream into taps needs a clock, contact or press trigger.")
        self.preprocessing = preprocessing
        self.incomplete = 0
        self._filter = _highpass(preprocessing.highpass_hz, preprocessing.rate_hz)
        self._filter_state: NDArray[np.float64] | None = None
        self._tare: NDArray[np.float64] | None = None
        self._untared: list[NDArray[np.float64]] = []
        self._kept = np.empty((0, 0))
        self._kept_from = 0
        self._begin: int | None = None
        self._armed = True
        self._scanned = 0

    def push(self, frames: ArrayLike) -> list[CutTap]:
        """Taps completed by these frames.

        Args:
            frames: Sensor frames in the order of time, shape (n, K), any n including 0.

        Raises:
            InputError: The frames are not finite or differ in the number of taxels from earlier ones.
        """
        frames = np.asarray(frames, dtype=np.float64)
        if frames.ndim != 2 or not frames.shape[1]:
            raise InputError(f"Frames must have shape (n, K) with at least one taxel, got {frames.shape}.")
        if not np.isfinite(frames).all():
            raise InputError(f"Frame {int(np.argmin(np.isfinite(frames).all(axis=1)))} has a NaN or infinite value.")
        if self._kept.shape[1] and frames.shape[1] != self._kept.shape[1]:
            raise InputError(f"Frames have {frames.shape[1]} taxels, earlier ones {self._kept.shape[1]}.")
        prepared = self._highpass(self._tared(frames))
        self._kept = np.concatenate([self._kept.reshape(-1, frames.shape[1]), prepared])
        return self._cut()

    def press(self) -> None:
        """Starts a tap: the next frame is the first after the press; the tap includes `pre_samples` frames before it.

        An unfinished tap is dropped and counts as incomplete, as does one that begins before the stream or, with a tare
        over the stream, before the end of the tare.

        Raises:
            InputError: The record has another trigger.
        """
        if self.preprocessing.trigger != "press":
            raise InputError(f"press() needs trigger='press', not {self.preprocessing.trigger!r}.")
        self.finish()
        begin = self._kept_from + len(self._kept) - self.preprocessing.pre_samples
        if begin < self._kept_from or self._untared:
            self.incomplete += 1
        else:
            self._begin = begin

    def finish(self) -> None:
        """Ends the stream; a tap in progress counts as incomplete."""
        if self._begin is not None:
            self.incomplete += 1
            self._begin = None

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
        taps: list[CutTap] = []
        while True:
            if self._begin is None:
                self._begin = self._next_begin()
            if self._begin is None or self._begin + self.preprocessing.samples > self._kept_from + len(self._kept):
                break
            first = self._begin - self._kept_from
            window = self._kept[first : first + self.preprocessing.samples].copy()
            if self.preprocessing.trigger == "contact":
                self._armed = bool(self._load(window[-1:])[0] < 0.5)
            if self.preprocessing.tare == "tap":
                window -= window[: self.preprocessing.tare_samples].mean(axis=0)
            taps.append(CutTap(self._begin, window))
            self._scanned = self._begin + self.preprocessing.samples
            self._begin = None
        oldest = self._begin if self._begin is not None else self._scanned - self.preprocessing.pre_samples
        drop = max(0, min(oldest - self._kept_from, len(self._kept)))
        self._kept = self._kept[drop:]
        self._kept_from += drop
        return taps

    def _load(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Largest load of a taxel in each frame, as a fraction of the trigger level."""
        return (frames / self.preprocessing.trigger_level).max(axis=1)

    def _next_begin(self) -> int | None:
        """Index of the first frame of the next tap; skips frames that start none."""
        record = self.preprocessing
        end = self._kept_from + len(self._kept)
        if record.trigger == "clock":
            return self._scanned if self._scanned < end else None
        if record.trigger == "press":
            self._scanned = end
            return None
        for load in self._load(self._kept[self._scanned - self._kept_from :]):
            frame = self._scanned
            self._scanned += 1
            if self._armed and load >= 1.0:
                self._armed = False
                if frame >= record.pre_samples and frame - record.pre_samples >= self._kept_from:
                    return frame - record.pre_samples
                self.incomplete += 1
            elif load < 0.5:
                self._armed = True
        return None


def _highpass(cutoff_hz: float, rate_hz: float | None) -> "FirstOrder | None":
    if not cutoff_hz or rate_hz is None:
        return None
    from .first_order import FirstOrder  # noqa: PLC0415 - numba takes a quarter of a second to import

    return FirstOrder.highpass(cutoff_hz, rate_hz)
