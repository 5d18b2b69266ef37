"""Where presses begin in recorded streams: by a recorded signal, or by the times or frame numbers of events."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, check_numbers
from .sessions import GAP_STEPS, median_step

_TRUE = {"true", "yes", "on", "t", "y"}
_FALSE = {"false", "no", "off", "f", "n", "", "nan", "none", "null"}
_REARMED = 0.5  # part of half the range, as of the level of a contact trigger
_ROUNDING = 1e-6  # of a step, by which the time of an event may come after that of its frame


class Presses(NamedTuple):
    """Presses in the frames of a recording.

    Attributes:
        row: First frame after each press as a row of the recording, shape (P,), not decreasing.
        outside: Number of events that lie outside the streams, and of presses that began before their stream.
        event: Number of each press among the events, shape (P,).
        events: Number of events; of presses by a signal all are counted.
        file: Number of the file of each event, shape (E,), if known.
    """

    row: NDArray[np.intp]
    outside: int
    event: NDArray[np.intp]
    events: int
    file: NDArray[np.intp] | None = None


def presses_of_column(signal: ArrayLike, starts: ArrayLike = (0,), name: str = "trigger") -> Presses:
    """Presses by a recorded signal.

    A press begins at the frame where the signal rises above half of its range in the whole recording, and the next one
    is looked for once it has fallen to a quarter or below. Truth values, as numbers or as text such as `true` and `no`,
    are 1 and 0. Where the signal is not known, or empty, it is low. A stream that begins above half has no press there.

    Args:
        signal: Numbers, truth values or text, shape (S,).
        starts: First row of each stream.
        name: Name of the signal for messages.

    Raises:
        InputError: The signal has another shape, is text that is neither, or never changes.
    """
    values = numbers_or_truths(signal, name)
    values = np.where(np.isfinite(values), values, np.nan)
    low, high = (np.nanmin(values), np.nanmax(values)) if not np.isnan(values).all() else (0.0, 0.0)
    if not low < high:
        raise InputError(f"{name}: always {low:g}, so no press begins.")
    values = np.where(np.isnan(values), low, values)
    half = (high - low) / 2
    above, below = values - low > half, values - low <= _REARMED * half
    first = np.zeros(len(values), dtype=bool)
    first[np.asarray(starts, dtype=np.intp)] = True
    decided = np.flatnonzero(above | below | first)
    up = above[decided]
    rises = up & ~np.concatenate([[True], up[:-1]]) & ~first[decided]
    rows = decided[rises]
    return Presses(rows, int((above & first).sum()), np.arange(len(rows)), len(rows))


def presses_of_events(
    events: ArrayLike, file: ArrayLike, *, time: ArrayLike | None = None, of: ArrayLike | None = None
) -> Presses:
    """Presses by a table of events; each is at the first frame that is not before it.

    An event is outside if its file has no such frame, or only one that comes after a gap (see `sessions.breaks`), or if
    it is earlier than one median step before the first frame.

    Args:
        events: Times in seconds on the clock of `time`, or without it numbers of frames, counted from 0 in each file;
            shape (E,).
        file: Number of the file of each frame, shape (S,).
        time: Time of each frame in seconds, shape (S,).
        of: Number of the file of each event, shape (E,); may be left out if there is one file, or if times of
            different files do not overlap.

    Raises:
        InputError: Events are not numbers of frames, or it is not clear to which file they belong.
    """
    at = check_numbers(events, "events")
    file = np.asarray(file)
    if at.ndim != 1 or not np.isfinite(at).all():
        raise InputError("events must be a list of finite numbers.")
    if time is None and (at != np.round(at)).any():
        raise InputError("events: numbers of frames must be whole; those in seconds need the time of each frame.")
    clock = None if time is None else check_numbers(time, "time")
    names = np.unique(file)
    if of is None:
        if len(names) > 1 and (clock is None or _overlap(clock, file)):
            raise InputError(
                f"events: the recording has {len(names)} files; each event needs the file that it belongs to."
            )
        parts = [(np.arange(len(file)), np.arange(len(at)))]
    else:
        parts = [(np.flatnonzero(file == name), np.flatnonzero(np.asarray(of) == name)) for name in names]
    rows = np.full(len(at), -1, dtype=np.intp)
    for frames, which in parts:
        find = _by_number(len(frames)) if clock is None else _by_time(clock[frames])
        found = find(at[which])
        rows[which] = np.where(found < 0, -1, frames[found])
    order = np.argsort(rows, kind="stable")
    inside = order[rows[order] >= 0]
    return Presses(
        rows[inside], len(at) - len(inside), inside, len(at), None if of is None else np.asarray(of, dtype=np.intp)
    )


def numbers_or_truths(signal: ArrayLike, name: str) -> NDArray[np.float64]:
    """Numbers, with 1 and 0 for truth values and texts such as `true` and `no`; an empty text is 0.

    Args:
        signal: Shape (S,).
        name: Its name for messages.

    Raises:
        InputError: It has another shape, or holds other texts.
    """
    values: NDArray[Any] = np.asarray(signal)
    if values.ndim != 1 or not len(values):
        raise InputError(f"{name}: must have one value for each frame, got shape {values.shape}.")
    if values.dtype.kind in "biuf":
        return values.astype(np.float64)
    texts, which = np.unique(values.astype(np.str_), return_inverse=True)
    return np.array([_truth(str(text).strip(), name) for text in texts])[which]


def _truth(text: str, name: str) -> float:
    if text.casefold() in _TRUE | _FALSE:
        return float(text.casefold() in _TRUE)
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name}: must hold numbers or true and false, got {text!r:.40}.") from None


def _overlap(clock: NDArray[np.floating], file: NDArray[Any]) -> bool:
    """Whether times do not increase from frame to frame through all files."""
    return not (np.diff(clock) > 0).all() or len(np.unique(file)) <= int(np.count_nonzero(file[1:] != file[:-1]))


def _by_number(frames: int) -> Callable[[NDArray[np.floating]], NDArray[np.intp]]:
    return lambda at: np.where((at < 0) | (at >= frames), -1, at).astype(np.intp)


def _by_time(clock: NDArray[np.floating]) -> Callable[[NDArray[np.floating]], NDArray[np.intp]]:
    """First frame that is not before each time, -1 if there is none near."""
    if (np.diff(clock) <= 0).any():
        raise InputError("events: times of frames must increase within a file to find events by time.")
    step = median_step(clock)

    def find(at: NDArray[np.floating]) -> NDArray[np.intp]:
        found = np.searchsorted(clock, at - _ROUNDING * step)
        near = np.append(clock, np.inf)[found] - at <= np.where(found == 0, 1, GAP_STEPS) * step
        return np.where(near & (found < len(clock)), found, -1)

    return find
