"""Taps of different lengths to taps of one length."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, check_count, check_numbers, counted
from ..settings import Missing

_WITHOUT = {
    "none": "without any sample",
    "contact": "without a sample at the level {:g}",
    "peak": "without a sample that differs from the first one",
}


@dataclass(frozen=True, eq=False)
class EvenTaps:
    """Taps of one length, and what was done to them.

    Attributes:
        samples: The taps, shape (n, J, K); NaN where a tap is too short.
        kept: Which of the taps given they are, shape (n,).
        left_out: What was left out, cut off or filled, one sentence for each reason.
    """

    samples: NDArray[np.floating]
    kept: NDArray[np.intp]
    left_out: tuple[str, ...]

    @property
    def missing(self) -> Missing:
        """What the samples need, for `TapSet.from_arrays`: `"drop"` if some are NaN."""
        return "drop" if np.isnan(self.samples).any() else "refuse"


def even_taps(
    taps: Sequence[ArrayLike],
    length: int | Literal["shortest", "longest"] = "shortest",
    *,
    align: Literal["none", "contact", "peak"] = "none",
    level: float = 0.0,
    pre: int = 0,
    short: Literal["fill", "leave out"] = "fill",
) -> EvenTaps:
    """Taps of one length from taps of any lengths, which are first aligned and then cut at their end.

    With `align="contact"` a tap begins `pre` samples before the first one in which a taxel reaches `level`, as for the
    contact trigger. With `align="peak"` it begins `pre` samples before the one that differs most from the tap's first
    sample, by the sum over taxels of absolute differences; the first such if there are several. Taps that have no such
    sample, or too few before it, are left out. No other alignment moves a tap: it begins with its first sample.

    Args:
        taps: Each of shape (J_i, K); samples may be NaN, which neither touches nor counts towards a peak.
        length: `"shortest"`: that of the shortest tap, once aligned; `"longest"`: that of the longest one, with NaN at
            the end of others; or a number of samples.
        align: What falls on the same sample of each tap.
        level: Value that counts as contact; negative if values fall under load.
        pre: Number of samples before contact or peak.
        short: What to do with taps that are shorter than a given number of samples: `"fill"` them with NaN, or leave
            them out.

    Raises:
        InputError: Taps differ in taxels, an argument is not known or does not fit another, or no tap is left.
    """
    parts = [check_numbers(tap, f"tap {number}") for number, tap in enumerate(taps)]
    _check(parts, length, align, level, pre, short)
    at, left_out = _begins(parts, align, level, pre)
    kept = np.array([number for number, begin in enumerate(at) if begin is not None], dtype=np.intp)
    aligned = [part[begin:] for part, begin in zip(parts, at, strict=True) if begin is not None]
    if not aligned:
        raise InputError(f"no tap is left of {len(parts)}. {' '.join(left_out)}".strip())
    lengths = np.array([len(tap) for tap in aligned])
    J = int(lengths.min() if length == "shortest" else lengths.max() if length == "longest" else length)
    if short == "leave out" and (lengths < J).any():
        left_out.append(_sentence(int((lengths < J).sum()), f"shorter than {J} samples"))
        if (lengths < J).all():
            raise InputError(f"no tap is left of {len(parts)}. {' '.join(left_out)}")
        aligned = [tap for tap in aligned if len(tap) >= J]
        kept, lengths = kept[lengths >= J], lengths[lengths >= J]
    samples = np.full((len(aligned), J, aligned[0].shape[1]), np.nan, np.result_type(np.float32, *aligned))
    for row, tap in zip(samples, aligned, strict=True):
        row[: len(tap)] = tap[:J]
    for changed, how, more in (
        (lengths > J, "cut to", ""),
        (lengths < J, "filled with NaN to", "; commands read them with --missing drop"),
    ):
        if changed.any():
            left_out.append(f"{counted(int(changed.sum()), 'tap')} {how} {counted(J, 'sample')}{more}.")
    return EvenTaps(samples, kept, tuple(left_out))


def _check(parts: list[NDArray[np.floating]], length: object, align: str, level: float, pre: int, short: str) -> None:
    if not parts:
        raise InputError("there are no taps.")
    for number, part in enumerate(parts):
        if part.ndim != 2 or not part.shape[1]:
            raise InputError(f"tap {number} must have shape (samples, taxels), got {part.shape}.")
        if part.shape[1] != parts[0].shape[1]:
            raise InputError(f"tap {number} has {part.shape[1]} taxels, tap 0 {parts[0].shape[1]}.")
    if length not in ("shortest", "longest"):
        check_count(length, "length", 1)
    if short not in ("fill", "leave out"):
        raise InputError(f"short must be fill or leave out, got {short!r}.")
    if align not in ("none", "contact", "peak"):
        raise InputError(f"align must be none, contact or peak, got {align!r}.")
    if (align == "contact") != (level != 0) or not np.isfinite(level):
        raise InputError(f"align={align!r} does not match level={level}.")
    if check_count(pre, "pre", 0) and align == "none":
        raise InputError(f"pre={pre} needs an alignment at contact or peak.")


def _begins(
    parts: list[NDArray[np.floating]], align: str, level: float, pre: int
) -> tuple[list[int | None], list[str]]:
    """Where each tap begins, `None` if it cannot be aligned, and how many there are of each reason."""
    events = [_event(part, align, level) for part in parts]
    without = sum(event is None for event in events)
    early = sum(event is not None and event < pre for event in events)
    what = "contact" if align == "contact" else "peak"
    reasons = (
        (without, _WITHOUT[align].format(level)),
        (early, f"with fewer than {counted(pre, 'sample')} before {what}"),
    )
    at = [None if event is None or event < pre else event - pre for event in events]
    return at, [_sentence(number, why) for number, why in reasons if number]


def _event(tap: NDArray[np.floating], align: str, level: float) -> int | None:
    """Index of the sample to be aligned."""
    if not len(tap):
        return None
    if align == "contact":
        reached = (tap / level >= 1).any(axis=1)
        return int(reached.argmax()) if reached.any() else None
    if align == "peak":
        differs = np.nansum(abs(tap.astype(np.float64) - tap[0]), axis=1)
        return int(differs.argmax()) if (differs > 0).any() else None
    return 0


def _sentence(number: int, why: str) -> str:
    return f"{counted(number, 'tap')} left out: {why}."
