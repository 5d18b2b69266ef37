"""Corrected attributes of a tap set."""

from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..taps import TapSet


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
        rate_hz: Sampling rate in hertz.

    Raises:
        InputError: A unit is given for objects without sizes, or the rate is not positive.
    """
    dataset = taps.dataset.copy()
    attributes = {"sensor": sensor, "source": source, "licence": licence}
    dataset.attrs.update({name: text for name, text in attributes.items() if text is not None})
    if what_unit is not None and "what_value" not in dataset.coords:
        raise InputError("what_unit (--what-unit) was given, but the objects have no sizes.")
    for unit, names in (
        (units, ("taps",)),
        (where_unit, ("where", "where_value", "where_edges")),
        (what_unit, ("what_value",)),
    ):
        for name in names if unit is not None else ():
            if name in dataset.variables:
                dataset[name].attrs["units"] = unit
    if rate_hz is not None:
        record = replace(taps.preprocessing, rate_hz=rate_hz)
        dataset.attrs["preprocessing"] = record.to_json()
        time = np.arange(record.samples) / rate_hz
        dataset = dataset.assign_coords(time=("sample", time, {"units": "s"}))
    return TapSet(dataset)
