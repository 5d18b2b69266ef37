"""Cuts continuous streams into taps, with the same `TapCutter` as at the rig."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..cutting.presses import Presses
from ..cutting.sessions import GAP_STEPS, breaks
from ..cutting.tap_cutter import CutTap, TapCutter
from ..errors import InputError
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
        incomplete: Number of taps cut short by the start or end of their stream.
        silent: Streams without a complete tap, each with session, object and length.
        row: Row of the recording that triggered each tap, shape (N,).
        event: Number of the event that each tap is, shape (N,); `None` without presses.
        overlapping: Number of taps given up because the next press came before their end.
        outside: Number of events outside the streams and of presses that began before their stream.
        gaps: Number of gaps in time at which streams were split.
    """

    taps: TapSet
    streams: int
    incomplete: int
    silent: tuple[str, ...]
    row: NDArray[np.intp]
    event: NDArray[np.intp] | None = None
    overlapping: int = 0
    outside: int = 0
    gaps: int = 0

    @property
    def lost(self) -> tuple[str, ...]:
        """What was lost, one sentence each."""
        told = (
            (self.incomplete, "cut short by the start or end of {} stream", "its", "their"),
            (self.overlapping, "given up, as the next press came before {} end", "its", "their"),
        )
        taps = [_counted(number, "tap", text.format(one if number == 1 else more)) for number, text, one, more in told]
        outside = _counted(self.outside, "press", "outside the streams")
        return (*filter(None, (*taps, outside)), *(f"No tap in the stream of {stream}." for stream in self.silent))


def stream_starts(recording: Recording, gap_steps: float = GAP_STEPS) -> NDArray[np.intp]:
    """First row of each stream.

    A stream is a maximal run of one object in one session of one file, without a gap in time if times are known.

    Args:
        recording: Frames with labels, shape (S, K).
        gap_steps: A step of more than so many median steps is a gap, as is a step back.

    Raises:
        InputError: The recording holds cut taps.
    """
    return np.flatnonzero(np.logical_or(*_broken(recording, gap_steps)))


def segment(
    recording: Recording,
    preprocessing: Preprocessing,
    presses: Presses | None = None,
    *,
    labels: Labels | None = None,
    gap_steps: float = GAP_STEPS,
) -> Segmented:
    """Cuts every stream of a recording, see `stream_starts`.

    A tap has the labels of the frame that triggered it: its position, which may change along the stream, is that at the
    first contact or after the press.

    Args:
        recording: Frames with labels, shape (S, K).
        preprocessing: Preprocessing with a trigger. Its rate is used unchanged.
        presses: Where presses begin, for the trigger `"press"`.
        labels: Labels of the events, if taps have those instead of the frames'.
        gap_steps: As for `stream_starts`.

    Raises:
        InputError: The recording holds cut taps, the record has no trigger or does not fit the presses, or no tap was
            found.
    """
    if (presses is not None) != (preprocessing.trigger == "press"):
        given = "no presses" if presses is None else "presses"
        raise InputError(f"trigger={preprocessing.trigger!r} was asked for, but {given} were given.")
    known, gap = _broken(recording, gap_steps)
    _check_finite(recording, preprocessing)
    frames, silent = recording.labels, []
    taps: list[CutTap] = []
    rows: list[int] = []
    incomplete = overlapping = streams = 0
    for first, last in _bounds(known | gap):
        cutter = TapCutter(preprocessing)
        found = list(_cut(cutter, recording.samples[first:last], _within(presses, first, last)))
        taps.extend(found)
        rows.extend(first + tap.frame for tap in found)
        incomplete += cutter.incomplete - cutter.overlapping
        overlapping += cutter.overlapping
        streams += 1
        if not found:
            name = frames.what_name[frames.what[first]]
            silent.append(f"session {frames.session[first]}, {name}, {last - first} frames")
    if not taps:
        raise InputError(
            f"no tap found in {streams} streams: {_why(recording, preprocessing, incomplete, presses, overlapping)}."
        )
    row = np.asarray(rows, dtype=np.intp)
    event = None if presses is None else presses.event[np.searchsorted(presses.row, row, side="right") - 1]
    taken = frames.take(row) if labels is None or event is None else labels.take(event)
    taken = replace(taken, trial=_count(taken.session))
    samples = np.stack([tap.samples for tap in taps]).astype(recording.samples.dtype)
    return Segmented(
        taken.tapset(samples, preprocessing),
        streams,
        incomplete,
        tuple(silent),
        row,
        event,
        overlapping,
        0 if presses is None else presses.outside,
        int(np.count_nonzero(gap)),
    )


def _counted(number: int, what: str, why: str) -> str:
    plural = f"{what}es" if what.endswith("s") else f"{what}s"
    return f"{number} {what if number == 1 else plural} left out: {why}." if number else ""


def _broken(recording: Recording, gap_steps: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether a stream begins at each row by its labels, and by a gap; two arrays of shape (S,)."""
    if recording.file is None:
        raise InputError("the taps are already cut; segmenting (--segment) is for continuous streams.")
    keys = np.stack([np.asarray(recording.file), recording.labels.session, recording.labels.what])
    known = np.concatenate([[True], (keys[:, 1:] != keys[:, :-1]).any(axis=0)])
    if recording.time is None:
        return known, np.zeros(len(known), dtype=bool)
    return known, breaks(recording.time, known, gap_steps)


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
        return f"all {presses.outside} presses are outside of them" if presses.outside else "there are no presses"
    if incomplete or overlapping:
        given_up = f", and {overlapping} given up for the next press" if overlapping else ""
        return f"{incomplete} were cut short by the start or end of their stream{given_up}"
    if preprocessing.trigger == "contact":
        low, high = recording.samples.min(), recording.samples.max()
        return f"the level is {preprocessing.trigger_level:g} and the values as stored span {low:g} to {high:g}"
    return f"a tap takes {preprocessing.samples} frames"
