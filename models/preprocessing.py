"""Record of how a stream of sensor frames becomes taps.

A histogram of high-pass filtered counts does not apply to raw counts, so the preprocessing is part of the data: it is
stored in every `TapSet` and every fitted model, and a model refuses taps with another preprocessing.
"""

import json
import math
from dataclasses import asdict, dataclass, fields, replace
from fractions import Fraction
from itertools import pairwise
from typing import Any, Literal, Self

import numpy as np

from .cutting.sampling_ratio import frames_behind, sampling_ratio
from .errors import InputError, check_count, check_numbers

_NEWER = (
    "sensor_hz",
    "taxels",
)  # fields that files lack unless they are given, so that those of before stay as they are

_CLOSE = 0.02
"""Rates that differ by less in proportion may be of one sensor."""


@dataclass(frozen=True)
class Preprocessing:
    """Record of the preprocessing of a tap: taxels are chosen, frames resampled, then all else in the order of fields.

    >>> Preprocessing(samples=50, rate_hz=50.0).differences(Preprocessing(samples=40, rate_hz=50.0))
    ['samples is 50 here and 40 there']

    Attributes:
        samples: Number of samples in a tap, `J`.
        rate_hz: Sampling rate in hertz of the samples, `None` if unknown.
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
        sensor_hz: Rate of the sensor's frames, which are resampled to `rate_hz`; `None` if they are not. All other
            fields are about the resampled frames.
        taxels: The sensor's taxels that are used, in increasing order; `None` for all. The trigger sees no others.
    """

    samples: int
    rate_hz: float | None = None
    tare: Literal["none", "stream", "tap"] = "none"
    tare_samples: int = 0
    highpass_hz: float = 0.0
    trigger: Literal["none", "clock", "contact", "press"] = "none"
    trigger_level: float = 0.0
    pre_samples: int = 0
    sensor_hz: float | None = None
    taxels: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        """Checks the record.

        Raises:
            InputError: A field contradicts another or lies outside its range.
        """
        for name in ("rate_hz", "highpass_hz", "trigger_level", "sensor_hz"):
            if not np.isfinite(check_numbers(getattr(self, name) or 0.0, name)):
                raise InputError(f"{name} must be finite, got {getattr(self, name)}.")
        for name, least in (("samples", 1), ("tare_samples", 0), ("pre_samples", 0)):
            object.__setattr__(self, name, check_count(getattr(self, name), name, least))
        if self.rate_hz is not None and not self.rate_hz > 0:
            raise InputError(f"rate_hz must be positive, got {self.rate_hz}.")
        self._check_sensor()
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

    def _check_sensor(self) -> None:
        if self.sensor_hz is not None:
            if not self.sensor_hz > 0:
                raise InputError(f"sensor_hz must be positive, got {self.sensor_hz}.")
            if self.rate_hz is None:
                raise InputError("sensor_hz needs rate_hz, the rate to resample to.")
            if sampling_ratio(self.sensor_hz, self.rate_hz) == 1:
                object.__setattr__(self, "sensor_hz", None)
        if self.taxels is not None:
            if not isinstance(self.taxels, tuple | list | np.ndarray):
                raise InputError(f"taxels must be a list of numbers of taxels, got {self.taxels!r:.40}.")
            taxels = tuple(check_count(taxel, "taxels", 0) for taxel in self.taxels)
            if not taxels or any(a >= b for a, b in pairwise(taxels)):
                raise InputError(f"taxels must be at least one, in increasing order, got {taxels!r:.80}.")
            object.__setattr__(self, "taxels", taxels)

    @property
    def ratio(self) -> Fraction:
        """Samples per frame of the sensor; 1 without resampling."""
        if self.sensor_hz is None or self.rate_hz is None:
            return Fraction(1)
        return sampling_ratio(self.sensor_hz, self.rate_hz)

    @property
    def frames_behind(self) -> int:
        """Frames of the sensor behind the last one of a tap that must arrive before it is complete."""
        return 0 if self.sensor_hz is None else frames_behind(self.ratio)

    @property
    def frames(self) -> int:
        """Frames of the sensor from the first to the last one on which the samples of a tap may depend."""
        return math.ceil((self.samples - 1) / self.ratio) + 1 + 2 * self.frames_behind

    def of_length(self, samples: int) -> Self:
        """The record of taps of another length; where a press was in them is not known if they are shorter than that.

        >>> record = Preprocessing(samples=50, trigger="press", pre_samples=5, tare="tap", tare_samples=3)
        >>> (record.of_length(1).pre_samples, record.of_length(1).tare_samples, record.of_length(9).pre_samples)
        (0, 1, 5)
        """
        return replace(
            self,
            samples=samples,
            pre_samples=self.pre_samples if self.pre_samples < samples else 0,
            tare_samples=min(self.tare_samples, samples) if self.tare == "tap" else self.tare_samples,
        )

    def differences(self, other: Self, here: str = "here", there: str = "there") -> list[str]:
        """Differences of `other`, one phrase per field; empty if both are equal.

        The rate of the sensor does not count: samples of one rate may come from sensors of several.

        Args:
            other: Another record.
            here: Description of this one's owner.
            there: Description of the other one's owner.
        """
        return [
            f"{field.name} is {getattr(self, field.name)} {here} and {getattr(other, field.name)} {there}"
            for field in fields(self)
            if field.name != "sensor_hz" and getattr(self, field.name) != getattr(other, field.name)
        ]

    def advice(self, other: Self) -> str:
        """What to do where `other` differs by a rate of nearly the same value, else nothing; begins with a blank."""
        one, two = self.rate_hz, other.rate_hz
        close = one and two and one != two and abs(one / two - 1) < _CLOSE
        return f" If both are of one sensor, convert with its rate, such as --rate {one:.3g}." if close else ""

    def to_dict(self) -> dict[str, Any]:
        """Fields by name; `sensor_hz` and `taxels` only if they are not `None`, so earlier records keep their text."""
        return {name: value for name, value in asdict(self).items() if name not in _NEWER or value is not None}

    def to_json(self) -> str:
        """The record as JSON, for file attributes."""
        return json.dumps(self.to_dict())

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
