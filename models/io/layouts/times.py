"""Times of rows, taps and events in seconds, and the rate that they tell."""

import re
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cutting.sampling_rate import Pace, pace
from ...cutting.sessions import SINCE_1970, median_step
from ...errors import InputError
from .formats.contents import unit_at_end
from .formats.text_header import MISSING
from .label_values import as_known
from .mapping import option
from .patterns import filled
from .reading import FileRead
from .signal import Signal

UNITS = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "µs": 1e-6, "usec": 1e-6}
UNITS |= {"ns": 1e-9, "nsec": 1e-9}
_LONGER = {"second": 1.0, "min": 60.0, "minute": 60.0, "minutes": 60.0, "h": 3600.0, "hr": 3600.0, "hours": 3600.0}
"""Units in texts alone, as names such as `t_min` may end in another word."""
_WITH_UNIT = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d]+)")
_USUAL_HZ = 1.0, 1e6
"""Rates of tactile sensors; another one more often means times of another unit."""
_DATE = r"(?P<d>\d{1,2})\.(?P<m>\d{1,2})\.(?P<y>\d{4})|(?P<Y>\d{4})(?P<sign>[-/])(?P<M>\d{1,2})(?P=sign)(?P<D>\d{1,2})"
_TIME = r"(?P<h>\d{1,2}):(?P<min>\d\d)(?::(?P<s>\d\d)(?:[.,](?P<f>\d{1,9})\d*)?)?"
_ZONE = r"(?P<zone>[+-])(?P<hours>\d\d):?(?P<minutes>\d\d)"
_CLOCK = re.compile(rf"(?:{_DATE})?[ T_]*(?:{_TIME})?(?:Z|{_ZONE})?")
_DAY_S = 86400.0
_SINCE = re.compile(r"(\w+) since (.+)")
_CF = {"day": 86400.0, "hour": 3600.0, "minute": 60.0, "second": 1.0}
_CF |= {"millisecond": 1e-3, "microsecond": 1e-6, "nanosecond": 1e-9}
_NONE = {"NaT", *MISSING}


def times_of(read: FileRead) -> tuple[NDArray[np.float64] | None, str]:
    """Times of the rows or taps of a file in seconds, if the map says where, and the unit in which they are written.

    Raises:
        InputError: They have another shape than rows or taps, or are neither numbers nor dates, or in a unit unknown.
    """
    how = read.how
    if how.time is None:
        return None, ""
    found = read.of(how.time)
    if isinstance(found, list):
        raise InputError(f"time (--time): {how.time} has elements of different lengths; give the rate with --rate.")
    named = read.contents.named(filled(how.time, read.file.fields))
    stated = how.time_unit or time_unit(named, read.contents.variables[named].unit)
    unit = stated or unit_since_1970(as_known(found)) or "s"
    times = in_seconds("time", named, found, unit)
    rows = len(read.signal.samples)
    samples = {len(tap) for tap in read.signal.samples} if read.signal.cut else ()
    if times.shape not in {(rows,), *((J,) for J in samples), *((rows, J) for J in samples)}:
        raise InputError(f"time (--time): {named} has shape {times.shape}, expected one value for each row or tap.")
    return times, unit


def time_unit(name: str, stated: str) -> str:
    """Unit of a column of times, by its header or its name; empty if neither tells."""
    return stated or unit_at_end(name, UNITS)


def unit_since_1970(values: NDArray[Any]) -> str:
    """Unit of numbers that can only be times since 1970, of the years 1986 to 2096; empty for others.

    A clock that began with its computer may show the same in a finer unit, and then rises by more than a second from
    row to row if it is taken for one since 1970 in ms or us; in ns it would be years.
    """
    if values.dtype.kind not in "iuf" or not (known := values[~np.isnan(values)]).size:
        return ""
    step = median_step(known.reshape(-1))
    for unit in ("s", "ms", "us", "ns"):
        least, most = (limit / UNITS[unit] for limit in SINCE_1970)
        if least <= known.min() and known.max() <= most:
            return unit if unit in ("s", "ns") or step * UNITS[unit] <= 1.0 else ""
    return ""


def told_of_times(time_s: NDArray[np.float64], unit: str, rate_hz: float | None) -> list[str]:
    """What to check of times whose unit the map does not say, one sentence each.

    Args:
        time_s: Times in seconds.
        unit: In which they were taken to be written.
        rate_hz: Rate by them.
    """
    told = []
    if unit != "s" and time_s.size and time_s.flat[0] > SINCE_1970[0]:
        told.append(f"{option('time')} is read as {unit} since 1970.")
    if rate_hz is not None and (doubt := told_of_rate(rate_hz, unit)):
        told.append(f"{option('time')}: {doubt}.")
    return told


def told_of_rate(rate_hz: float, unit: str) -> str:
    """What to check of times in a unit that give this rate, empty if nothing."""
    least, most = _USUAL_HZ
    if least <= rate_hz <= most:
        return ""
    rates = {other: rate_hz * UNITS[unit] / UNITS[other] for other in ("s", "ms", "us", "ns")}
    usual = [f"{rate:g} Hz in {of}" for of, rate in rates.items() if least <= rate <= most]
    instead = f", but {' or '.join(usual)}; check {option('time_unit')}" if usual else ""
    return f"in {unit} it gives {rate_hz:g} Hz{instead}"


def in_seconds(key: str, name: str, values: NDArray[Any], unit: str) -> NDArray[np.float64]:
    """Times in seconds; of dates with times those since 1970.

    Args:
        key: The key of the map.
        name: Of the column.
        values: Numbers, dates, or their texts.
        unit: Of numbers.

    Raises:
        InputError: They are neither, or the unit is unknown.
    """
    try:
        numbers = values.astype(np.float64)
    except ValueError:
        return _of_texts(key, name, values)
    if (since := since_date(numbers, unit)) is not None:
        return since
    if unit not in UNITS:
        raise InputError(f"{option(key)}: {name} is in {unit!r}; say its unit with --time-unit s, ms, us or ns.")
    return numbers * UNITS[unit]


def since_date(numbers: NDArray[np.float64], unit: str) -> NDArray[np.float64] | None:
    """Seconds since 1970 of numbers in a unit of the CF conventions, such as `days since 2026-11-26`, else `None`."""
    found = _SINCE.fullmatch(unit)
    if found is None or (step := _CF.get(found[1].casefold().removesuffix("s"))) is None:
        return None
    try:
        return numbers * step + _time(found[2].strip()).astype(np.int64) / 1e9
    except ValueError:
        return None


def _of_texts(key: str, name: str, values: NDArray[Any]) -> NDArray[np.float64]:
    """Seconds from numbers with units, from dates since 1970, or from times of day alone since the first midnight."""
    if (numbers := _with_units(values)) is not None:
        return numbers
    try:
        with warnings.catch_warnings():  # that numpy does not keep time zones
            warnings.simplefilter("error")
            times = values.astype("datetime64[ns]")
    except (ValueError, UserWarning):
        try:
            times = np.array([_time(text.strip(" \t[]()")) for text in values.reshape(-1).tolist()]).reshape(
                values.shape
            )
        except ValueError as error:
            wanted = "numbers or times such as 0.25 s, 2026-11-26 10:00:00.25, 26.11.2026 10:00 or 10:00:00.25"
            raise InputError(f"{option(key)}: {name} holds {error}, not {wanted}.") from None
    seconds = np.where(np.isnat(times), np.nan, times.astype(np.int64) / 1e9)
    if (
        seconds.ndim == 1 and np.nanmax(seconds, initial=0) < _DAY_S
    ):  # without dates: what falls by hours is another day
        seconds[1:] += _DAY_S * np.cumsum(np.diff(seconds) < -_DAY_S / 2)
    return seconds


def _with_units(values: NDArray[Any]) -> NDArray[np.float64] | None:
    """Seconds of texts such as `0.005 sec`, where all are such texts or missing."""
    found = np.empty(values.size)
    known = UNITS | _LONGER
    for n, text in enumerate(values.reshape(-1).tolist()):
        if text.strip() in _NONE:
            found[n] = np.nan
        elif (match := _WITH_UNIT.fullmatch(text.strip())) and match[2] in known:
            found[n] = float(match[1]) * known[match[2]]
        else:
            return None
    return found.reshape(values.shape)


def _time(text: str) -> np.datetime64:
    if text in _NONE:
        return np.datetime64("NaT", "ns")
    found = _CLOCK.fullmatch(text)
    if found is None:
        raise ValueError(f"texts such as {text:.40}")
    year, month, day = found["y"] or found["Y"] or 1970, found["m"] or found["M"] or 1, found["d"] or found["D"] or 1
    clock = f"{int(found['h'] or 0):02}:{found['min'] or '00'}:{found['s'] or '00'}.{found['f'] or 0}"
    time = np.datetime64(f"{year}-{int(month):02}-{int(day):02}T{clock}", "ns")
    if not found["zone"]:
        return time
    east = np.timedelta64(60 * int(found["hours"]) + int(found["minutes"]), "m")
    return time - east if found["zone"] == "+" else time + east


def pace_of(
    time_s: NDArray[np.float64],
    signal: Signal,
    starts: NDArray[np.intp] | None,
    place: Callable[[int], str] | None = None,
) -> Pace | None:
    """Pace of samples; `None` where times are those of taps, or of one sample each.

    Args:
        time_s: Times of rows or taps, or of the samples of each tap, in seconds.
        signal: The samples.
        starts: First row of each tap among rows.
        place: Where a row stands, for messages.

    Raises:
        InputError: Times do not increase, or fall within a tap.
    """
    if signal.cut and time_s.shape[-1:] != (np.asarray(signal.samples[0]).shape[0],):
        return None
    begins = np.zeros(time_s.shape, dtype=bool)
    begins[..., :1] = True
    if starts is not None:
        begins[starts] = True
    begins, time_s = begins.reshape(-1), time_s.reshape(-1)
    falls = np.flatnonzero((np.diff(time_s) < 0) & ~begins[1:])
    if len(falls) and starts is not None and place is not None:
        row = int(falls[0]) + 1
        raise InputError(
            f"{place(row)}: time (--time) falls within a tap, from {time_s[row - 1]:.6g} to {time_s[row]:.6g} s; if "
            "another tap or taxel begins there, tap (--tap) or taxel (--taxel) must name the column that tells as well."
        )
    found = pace(time_s, begins)
    if found is None and (~np.isnan(np.diff(time_s)) & ~begins[1:]).any():
        raise InputError("time (--time) does not increase.")
    return found
