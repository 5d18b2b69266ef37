"""Cuts continuous streams into taps, with the same `TapCutter` as at the rig."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cutting.presses import Presses
from ..cutting.sessions import breaks
from ..cutting.tap_cutter import REARMED, CutTap, TapCutter
from ..errors import InputError, counted
from ..preprocessing import Preprocessing
from ..taps import TapSet
from .recording import Labels, Recording

_AT_ONCE = 2**20  # numbers that are preprocessed together


@dataclass(frozen=True, eq=False)
class Segmented:
    """Taps cut from streams, and what was lost.

    Attributes:
        taps: The taps; `trial` counts them within their session.
        streams: Number of streams.
        gaps: Number of gaps at which streams were split, in time or where frames are gone.
        incomplete: Number of taps cut short by the start or end of their stream.
        overlapping: Number of taps given up because the next press came before their end.
        outside: Number of events outside the streams and of presses that began before their stream.
        touching: Number of streams that are in contact from their first frame on.
        resumed: Number of streams that begin in contact and are tared as the one before.
        silent: Streams without a complete tap, each with session, object and length.
    """

    taps: TapSet
    streams: int
    gaps: int
    incomplete: int
    overlapping: int
    outside: int
    touching: int
    resumed: int
    silent: tuple[str, ...]

    @property
    def told(self) -> tuple[str, ...]:
        """What was cut and what was lost, one sentence each."""
        split = f", split at {counted(self.gaps, 'gap')}" if self.gaps else ""
        lost = (
            (self.incomplete, "tap", "cut short by the start or end of a stream"),
            (self.overlapping, "tap", "given up, as the next press came before the end"),
            (self.outside, "press", "outside the streams"),
        )
        return (
            f"{counted(len(self.taps), 'tap')} from {counted(self.streams, 'stream')}{split}.",
            *(f"{counted(number, what)} left out: {why}." for number, what, why in lost if number),
            *([f"{_at_once(self.touching, self.streams)}."] if self.touching else []),
            *([f"{_resumed(self.resumed, self.streams)}."] if self.resumed else []),
            *(f"No tap in the stream of {stream}." for stream in self.silent),
        )


def _in_contact(number: int, streams: int) -> str:
    return f"{number} of {counted(streams, 'stream')} begin{'s' * (number == 1)} in contact"


def _resumed(resumed: int, streams: int) -> str:
    each = "is tared as the one before it" if resumed == 1 else "are tared as those before them"
    return f"{_in_contact(resumed, streams)} and {each}"


def _at_once(touching: int, streams: int) -> str:
    what = _in_contact(touching, streams)
    return f"{what}, at or beyond level (--level); --tare stream subtracts what the sensor shows at first"


def stream_starts(recording: Recording) -> NDArray[np.intp]:
    """First row of each stream.

    A stream is a maximal run of one object in one session of one file, without a gap in time if times are known, and
    else without frames that are gone between others.

    Args:
        recording: Frames with labels, shape (S, K).

    Raises:
        InputError: The recording holds cut taps.
    """
    return np.flatnonzero(np.logical_or(*_broken(recording)))


def segment(
    recording: Recording,
    preprocessing: Preprocessing,
    presses: Presses | None = None,
    labels_of: Callable[[list[int]], Labels] | None = None,
) -> Segmented:
    """Cuts every stream of a recording, see `stream_starts`.

    A stream that begins in contact is tared as the one before it in its file and session: where a tare over the stream
    would be taken of frames at half of the trigger level or more against that tare, and later ones are below.

    A tap has the labels of the frame that triggered it: its position, which may change along the stream, is that at the
    first contact or after the press.

    Args:
        recording: Frames with labels, shape (S, K).
        preprocessing: Preprocessing with a trigger. Its rate is used unchanged.
        presses: Where presses begin, for the trigger `"press"`.
        labels_of: Labels of taps, by the rows of the frames that triggered them; default: of these frames.

    Raises:
        InputError: The recording holds cut taps, the record has no trigger or does not fit the presses, or no tap was
            found.
    """
    if (presses is not None) != (preprocessing.trigger == "press"):
        given = "no presses" if presses is None else "presses"
        raise InputError(f"trigger={preprocessing.trigger!r} was asked for, but {given} were given.")
    keys = _keys(recording)
    known, gap = _broken(recording)
    _check_finite(recording, preprocessing)
    frames, taps, rows, silent = recording.labels, list[NDArray[Any]](), list[int](), list[str]()
    incomplete = overlapping = streams = touching = resumed = 0
    rest: NDArray[np.float64] | None = None
    for first, last in _bounds(known | gap):
        if (keys[:2, first] != keys[:2, first - 1]).any():
            rest = None
        pressed = rest is not None and _resumes(recording.samples[first:last], preprocessing, rest)
        cutter = TapCutter(preprocessing, rest if pressed else None)
        found = list(_cut(cutter, recording.samples[first:last], _within(presses, first, last)))
        taps += (tap.samples.astype(recording.samples.dtype) for tap in found)
        rows += (first + tap.frame for tap in found)
        incomplete, overlapping = incomplete + cutter.incomplete, overlapping + cutter.overlapping
        rest = rest if cutter.baseline is None else cutter.baseline
        streams, resumed = streams + 1, resumed + pressed
        touching += _begins_in_contact(recording.samples[first], preprocessing)
        if not found:
            name = frames.what_name[frames.what[first]]
            silent.append(f"session {frames.session[first]}, {name}, {last - first} frames")
    incomplete -= overlapping
    if not taps:
        why = _why(recording, preprocessing, incomplete, presses, overlapping)
        why = f"{why}; {_at_once(touching, streams)}" if touching else why
        raise InputError(f"no tap found in {counted(streams, 'stream')}: {why}.")
    labels = (labels_of or frames.take)(rows)
    return Segmented(
        replace(labels, trial=_count(labels.session)).tapset(np.stack(taps), preprocessing),
        streams,
        int(np.count_nonzero(gap)),
        incomplete,
        overlapping,
        0 if presses is None else presses.outside,
        touching,
        resumed,
        tuple(silent),
    )


def _begins_in_contact(frame: NDArray[np.floating], preprocessing: Preprocessing) -> bool:
    """Whether a first frame counts as contact as it stands."""
    if preprocessing.trigger != "contact" or preprocessing.tare == "stream" or preprocessing.highpass_hz:
        return False
    return bool(_load(frame, preprocessing) >= 1)


def _resumes(frames: NDArray[np.floating], preprocessing: Preprocessing, rest: NDArray[np.float64]) -> bool:
    """Whether a stream begins in contact, against the tare of the one before, and ends it: a drift would last."""
    if preprocessing.trigger != "contact" or preprocessing.tare != "stream" or preprocessing.highpass_hz:
        return False
    first = math.ceil(preprocessing.tare_samples / preprocessing.ratio)
    if _load(frames[:first].astype(np.float64).mean(axis=0), preprocessing, rest) < REARMED:
        return False
    return bool((_load(frames[first:], preprocessing, rest) < REARMED).any())


def _load(frames: NDArray[np.floating], preprocessing: Preprocessing, rest: NDArray[np.float64] | float = 0.0) -> Any:
    """Largest load of a used taxel as a fraction of the trigger level, of each frame."""
    used = frames if preprocessing.taxels is None else frames[..., list(preprocessing.taxels)]
    return ((used - rest) / preprocessing.trigger_level).max(axis=-1)


def _keys(recording: Recording) -> NDArray[np.int64]:
    """File, session and object of each row, shape (3, S)."""
    if recording.file is None:
        raise InputError("the taps are already cut; only continuous streams can be.")
    return np.stack([np.asarray(recording.file), recording.labels.session, recording.labels.what])


def _broken(recording: Recording) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether a stream begins at each row by its labels, and by a gap; two arrays of shape (S,)."""
    keys = _keys(recording)
    known = np.concatenate([[True], (keys[:, 1:] != keys[:, :-1]).any(axis=0)])
    if recording.time is None:
        gap = np.zeros(len(known), dtype=bool)
        if recording.row is not None:
            gap[1:] = (np.diff(recording.row) != 1) & ~known[1:]
        return known, gap
    return known, breaks(recording.time, known)


def _bounds(broken: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """First row and end of each stream."""
    return pairwise([*np.flatnonzero(broken).tolist(), len(broken)])


def _within(presses: Presses | None, first: int, last: int) -> list[int]:
    """Frames of a stream at which presses begin."""
    if presses is None:
        return []
    return (presses.row[(presses.row >= first) & (presses.row < last)] - first).tolist()


def _cut(cutter: TapCutter, frames: NDArray[np.floating], presses: list[int]) -> Iterator[CutTap]:
    """Taps of one stream."""
    at_once, at = max(1, _AT_ONCE // frames.shape[1]), 0
    for stop in (*presses, len(frames)):
        for begin in range(at, stop, at_once):
            yield from cutter.push(frames[begin : min(begin + at_once, stop)])
        if stop < len(frames):
            cutter.press()
        at = stop
    cutter.finish()


def _check_finite(recording: Recording, preprocessing: Preprocessing) -> None:
    """Checks the taxels that are used, as all frames of a stream matter to a filter."""
    samples = recording.samples
    at_once = max(1, _AT_ONCE // samples.shape[1])
    for begin in range(0, len(samples), at_once):
        block = samples[begin : begin + at_once]
        if preprocessing.taxels is not None and preprocessing.taxels[-1] < samples.shape[1]:
            block = block[:, preprocessing.taxels]
        bad = ~np.isfinite(block).all(axis=1)
        if bad.any():
            raise InputError(
                f"row {begin + int(bad.argmax())} of the streams, counted from 0, has a sample that is missing or "
                "infinite; streams are cut only where all samples of the used taxels are known."
            )


def _count(session: NDArray[np.int64]) -> NDArray[np.int64]:
    """0, 1, 2, ... within each session."""
    trial = np.zeros(len(session), dtype=np.int64)
    for number in np.unique(session):
        of_session = session == number
        trial[of_session] = np.arange(np.count_nonzero(of_session))
    return trial


def _why(
    recording: Recording, preprocessing: Preprocessing, incomplete: int, presses: Presses | None, overlapping: int
) -> str:
    if presses is not None and not len(presses.row):
        return "all presses are outside the streams" if presses.outside else "there are no presses"
    if incomplete or overlapping:
        given_up = f", and {overlapping} given up for the next press" if overlapping else ""
        return f"{counted(incomplete, 'tap')} cut short by the start or end of a stream{given_up}"
    if preprocessing.trigger == "contact":
        low, high = recording.samples.min(), recording.samples.max()
        return (
            f"the level (--level) is {preprocessing.trigger_level:g} and the values as stored span {low:g} to {high:g}"
        )
    return f"a tap takes {preprocessing.samples} frames"
