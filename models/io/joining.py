"""Joins tap sets of several files as separate sessions, and names classes anew."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..preprocessing import Preprocessing
from ..taps import TapSet, check_alike, concatenate, with_all_places

_TABLES = ("where_value", "where_edges", "where_place", "what_value", "taxel_position", "time")


def joined(taps: Sequence[TapSet], names: Sequence[str]) -> TapSet:
    """One tap set from several, with sessions renumbered in their order; a single one unchanged.

    Args:
        taps: Tap sets in the order of their files.
        names: Names of the files, for messages.

    Raises:
        InputError: They are incompatible, or two contain the same taps, which would then be in training and test data.
    """
    if len(taps) == 1:
        return taps[0]
    check_alike(taps, names)
    _check_apart(taps, names)
    taps = with_all_places(taps)
    return concatenate(numbered(taps, names)[0])


def _check_apart(taps: Sequence[TapSet], names: Sequence[str]) -> None:
    known: dict[int, str] = {}
    for part, name in zip(taps, names, strict=True):
        digests = part.digests.tolist()
        shared = [known[digest] for digest in digests if digest in known]
        if shared:
            raise InputError(f"{name}: {len(shared)} taps are also in {shared[0]}.")
        known |= dict.fromkeys(digests, name)


def numbered(taps: Sequence[TapSet], names: Sequence[str]) -> tuple[list[TapSet], tuple[str, ...]]:
    """The tap sets with unique session numbers, and the names of the sessions."""
    parts, called = [], []
    for part, name in zip(_with_one_table(taps), names, strict=True):
        sessions, index = np.unique(part.session, return_inverse=True)
        parts.append(TapSet(part.dataset.assign_coords(session=("tap", index + len(called))), part.scanned))
        called += [name] if len(sessions) == 1 and len(taps) > 1 else [f"{name} session {s}" for s in sessions]
    return parts, tuple(called)


def _with_one_table(taps: Sequence[TapSet]) -> list[TapSet]:
    """The tap sets with the tables of the first, which define the classes, and only the arrays that all have."""
    first = taps[0].dataset
    tables = {name: first[name].variable for name in _TABLES if name in first.variables}
    shared = set.intersection(*(set(part.dataset.data_vars) for part in taps))
    return [
        TapSet(
            part.dataset.drop_vars([*_TABLES, *(set(part.dataset.data_vars) - shared)], errors="ignore").assign_coords(
                tables
            ),
            part.scanned,
        )
        for part in taps
    ]


def relabel(
    taps: TapSet,
    *,
    sensor: str | None = None,
    source: str | None = None,
    licence: str | None = None,
    units: str | None = None,
    where_unit: str | None = None,
    what_unit: str | None = None,
    rate_hz: float | None = None,
    citation: str | None = None,
) -> TapSet:
    """The same taps with new attributes; `None` keeps the old one.

    Args:
        taps: The taps.
        sensor: Name of the sensor.
        source: Origin of the data.
        licence: Licence of the data.
        units: Unit of the samples.
        where_unit: Unit of the positions.
        what_unit: Unit of the object sizes.
        rate_hz: Sampling rate in hertz; of resampled taps that of the sensor, which keeps the ratio of both.
        citation: How to cite the data.

    Raises:
        InputError: A unit is given for objects without sizes, or the rate is not positive.
    """
    dataset = taps.dataset.copy()
    attributes = {"sensor": sensor, "source": source, "licence": licence, "citation": citation}
    dataset.attrs.update({name: text for name, text in attributes.items() if text is not None})
    if what_unit is not None and "what_value" not in dataset.coords:
        raise InputError("what_unit (--what-unit) was given, but the objects have no sizes.")
    for unit, names in (
        (units, ("taps",)),
        (where_unit, ("where", "where_value", "where_edges", "where_place")),
        (what_unit, ("what_value",)),
    ):
        for name in names if unit is not None else ():
            if name in dataset.variables:
                dataset[name].attrs["units"] = unit
    if rate_hz is not None:
        record = _at_rate(taps.preprocessing, rate_hz)
        dataset.attrs["preprocessing"] = record.to_json()
        time = np.arange(record.samples) / (record.rate_hz or 1.0)
        dataset = dataset.assign_coords(time=("sample", time, {"units": "s"}))
    return TapSet(dataset, taps.scanned)


def _at_rate(record: Preprocessing, rate_hz: float) -> Preprocessing:
    if record.sensor_hz is None or record.rate_hz is None:
        return replace(record, rate_hz=rate_hz)
    if rate_hz == record.sensor_hz:
        return record
    return replace(record, sensor_hz=rate_hz, rate_hz=record.rate_hz * (rate_hz / record.sensor_hz))
