"""Cuts continuous streams into taps, with the same `TapCutter` as at the rig."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..cutting.tap_cutter import CutTap, TapCutter
from ..errors import InputError
from ..preprocessing import Preprocessing
from ..taps import TapSet
from .recording import Recording


@dataclass(frozen=True, eq=False)
class Segmented:
    """Taps cut from streams, and what was lost.

    Attributes:
        taps: The taps; `trial` counts them within their session.
        streams: Number of streams.
        incomplete: Number of taps cut short by the start or end of their stream.
        silent: Streams without a complete tap, each with session, object and length.
    """

    taps: TapSet
    streams: int
    incomplete: int
    silent: tuple[str, ...]


def segment(recording: Recording, preprocessing: Preprocessing) -> Segmented:
    """Cuts every stream of a recording; a stream is a maximal run of one object in one session of one file.

    A tap has the labels of the frame that triggered it: its position, which may change along the stream, is that at the
    first contact.

    Args:
        recording: Frames with labels, shape (S, K).
        preprocessing: Preprocessing; its trigger must be `"clock"` or `"contact"`. Its rate is used unchanged.

    Raises:
        InputError: The recording holds cut taps, the record has no trigger, or no tap was found.
    """
    if recording.file is None:
        raise InputError("the taps are already cut; segmenting (--segment) is for continuous streams.")
    labels = recording.labels
    windows: list[NDArray[np.float64]] = []
    rows: list[int] = []
    silent: list[str] = []
    incomplete = streams = 0
    for first, last in _streams(recording):
        taps, cut_short = _cut(recording.samples[first:last], preprocessing)
        windows.extend(tap.samples for tap in taps)
        rows.extend(first + tap.start + preprocessing.pre_samples for tap in taps)
        incomplete += cut_short
        streams += 1
        if not taps:
            name = labels.what_name[labels.what[first]]
            silent.append(f"session {labels.session[first]}, {name}, {last - first} frames")
    if not windows:
        raise InputError(f"no tap found in {streams} streams: {_why(recording, preprocessing, incomplete)}.")
    taken = labels.take(rows)
    taken = replace(taken, trial=_count(taken.session))
    samples = np.stack(windows).astype(recording.samples.dtype)
    return Segmented(taken.tapset(samples, preprocessing), streams, incomplete, tuple(silent))


def _streams(recording: Recording) -> Iterator[tuple[int, int]]:
    """First row and end of each stream."""
    keys = np.stack([np.asarray(recording.file), recording.labels.session, recording.labels.what])
    changes = np.flatnonzero((keys[:, 1:] != keys[:, :-1]).any(axis=0)) + 1
    bounds = [0, *changes.tolist(), keys.shape[1]]
    return pairwise(bounds)


def _cut(frames: NDArray[np.floating], preprocessing: Preprocessing) -> tuple[list[CutTap], int]:
    cutter = TapCutter(preprocessing)
    taps = cutter.push(frames)
    cutter.finish()
    return taps, cutter.incomplete


def _count(session: NDArray[np.int64]) -> NDArray[np.int64]:
    """0, 1, 2, ... within each session."""
    trial = np.zeros(len(session), dtype=np.int64)
    for number in np.unique(session):
        of_session = session == number
        trial[of_session] = np.arange(np.count_nonzero(of_session))
    return trial


def _why(recording: Recording, preprocessing: Preprocessing, incomplete: int) -> str:
    if incomplete:
        return f"{incomplete} were cut short by the start or end of their stream"
    if preprocessing.trigger == "contact":
        low, high = recording.samples.min(), recording.samples.max()
        return f"the level is {preprocessing.trigger_level:g} and the values as stored span {low:g} to {high:g}"
    return f"a tap takes {preprocessing.samples} frames"
