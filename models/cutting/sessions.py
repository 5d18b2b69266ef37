"""Sessions and streams, by pauses and dates."""

import re
from datetime import date

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, check_numbers

GAP_STEPS = 5.0
"""Median steps of the clock above which a step is a gap that ends a stream."""
_DAY_S = 86400
SINCE_1970 = 5e8, 4e9
"""Seconds since 1970 between which a number counts as a time: no date written as a number is between them."""
_DATES = tuple(
    re.compile(rf"(?<!\d){pattern}")
    for pattern in (
        r"(?P<y>\d{4})([-/])(?P<m>\d{1,2})\2(?P<d>\d{1,2})(?!\d)",
        r"(?P<y>\d{4})(?P<m>\d{2})(?P<d>\d{2})(?=\D|$|\d{4}(?:\d\d)?(?!\d))",
        r"(?P<d>\d{1,2})\.(?P<m>\d{1,2})\.(?P<y>\d{4})(?!\d)",
        r"(?P<y>\d{4})_(?P<m>\d{2})_(?P<d>\d{2})(?!\d)",
    )
)


def median_step(time: ArrayLike, broken: ArrayLike | None = None) -> float:
    """Median time from frame to frame in seconds; infinite for fewer than two frames.

    Where most frames have the time of the one before, as the clock is coarse, steps of 0 do not count.

    Args:
        time: Time of each frame in seconds, shape (S,).
        broken: Whether a frame does not follow the one before it, shape (S,); steps to it do not count.
    """
    steps = np.diff(np.asarray(time, dtype=np.float64))
    if broken is not None:
        steps = steps[~np.asarray(broken, dtype=bool)[1:]]
    middle = float(np.median(steps)) if len(steps) else np.inf
    return middle if middle or not (steps > 0).any() else float(np.median(steps[steps > 0]))


def breaks(time: ArrayLike, broken: ArrayLike) -> NDArray[np.bool_]:
    """Whether a gap is before each frame: time rises by more than `GAP_STEPS` median steps, or falls; shape (S,).

    Args:
        time: Time of each frame in seconds, shape (S,).
        broken: Whether a frame is known not to follow the one before it, shape (S,); there is no gap then.
    """
    time, known = check_numbers(time, "time"), np.asarray(broken, dtype=bool)
    found = np.zeros(len(time), dtype=bool)
    change = np.diff(time)
    found[1:] = (change > GAP_STEPS * median_step(time, known)) | (change < 0)
    return found & ~known


def number_by_gap(time: ArrayLike, seconds: float, file: ArrayLike | None = None) -> NDArray[np.int64]:
    """Numbers from 0 that rise by 1 after each pause, in the order of the rows; shape (n,).

    Args:
        time: Time of each row (frame or tap) in seconds, shape (n,).
        seconds: Longest time between neighbours of a session; if time falls, a session ends as well.
        file: Number of the file of each row, shape (n,): a new file is then a new session, too.

    Raises:
        InputError: A time is not a finite number, or `seconds` is not positive.
    """
    time = check_numbers(time, "time")
    if time.ndim != 1 or not np.isfinite(time).all():
        raise InputError("time must be a list of finite numbers to find pauses.")
    if not (np.isfinite(seconds) and seconds > 0):
        raise InputError(f"gap: must be a positive number of seconds, got {seconds}.")
    change = np.diff(time)
    after = (change > seconds) | (change < 0)
    if file is not None:
        after |= np.asarray(file)[1:] != np.asarray(file)[:-1]
    return np.concatenate([[0], np.cumsum(after)]).astype(np.int64)[: len(time)]


def number_by_date(values: ArrayLike) -> NDArray[np.int64]:
    """Number of each row's date, from 0 for the earliest; shape (n,).

    Args:
        values: Dates or times as `datetime64`, or texts that contain one date: 2026-11-26, 2026/11/26, 20261126,
            26.11.2026 or 2026_11_26, whatever follows, or numbers of s, ms, us or ns since 1970, of the years 1986 to
            2096, of which the dates of Greenwich count; shape (n,). The order of day and month in 11/12/2026 is not
            known.

    Raises:
        InputError: A value is none of these.
    """
    values = np.asarray(values)
    if values.dtype.kind == "M":
        if np.isnat(values).any():
            raise InputError("date: a date is missing.")
        return np.unique(values.astype("datetime64[D]"), return_inverse=True)[1].astype(np.int64)
    if values.dtype.kind in "iuf":
        for unit in (1.0, 1e3, 1e6, 1e9):
            if ((SINCE_1970[0] * unit <= values) & (values <= SINCE_1970[1] * unit)).all():
                return np.unique(values // (_DAY_S * unit), return_inverse=True)[1].astype(np.int64)
    texts, which = np.unique(values.astype(np.str_), return_inverse=True)
    days = np.array([_date(str(text)).toordinal() for text in texts], dtype=np.int64)
    return np.unique(days[which], return_inverse=True)[1].astype(np.int64)


def _date(text: str) -> date:
    for pattern in _DATES:
        if (found := pattern.search(text)) is not None:
            try:
                return date(int(found["y"]), int(found["m"]), int(found["d"]))
            except ValueError:
                break
    raise InputError(
        f"date: no date in {text!r:.60}; expected one such as 2026-11-26, 20261126, 26.11.2026 or 2026_11_26."
    )
