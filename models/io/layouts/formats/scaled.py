"""Numbers as netCDF stores them: packed by a factor and an offset, with values that say that there is none."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Packing(NamedTuple):
    """What turns stored numbers into those that are meant.

    Attributes:
        dtype: Of the result.
        stored: Of what is stored, where the file says that it is unsigned though its type is not.
        factor: Of the numbers.
        offset: Added to them.
        fill: Stored values that become NaN.
    """

    dtype: np.dtype[Any]
    stored: np.dtype[Any]
    factor: float
    offset: float
    fill: tuple[float, ...]

    def __call__(self, values: NDArray[Any]) -> NDArray[Any]:
        """The numbers that are meant."""
        values = values.view(self.stored)
        found = values.astype(self.dtype)
        if self.factor != 1:
            found *= self.factor
        if self.offset:
            found += self.offset
        for each in self.fill:
            found[values == each] = np.nan
        return found


def packing_of(attributes: Mapping[str, Any], dtype: np.dtype[Any]) -> Packing | None:
    """Packing of an array by its attributes; `None` if the numbers are as they are stored."""
    if dtype.kind not in "fiu":
        return None
    factor, offset = _number(attributes, "scale_factor"), _number(attributes, "add_offset")
    fill = [*_numbers(attributes, "_FillValue"), *_numbers(attributes, "missing_value")]
    unsigned = dtype.kind == "i" and _text(attributes, "_Unsigned").lower() == "true"
    stored = np.dtype(f"{dtype.str[0]}u{dtype.itemsize}") if unsigned else dtype
    if unsigned:
        fill = [each % 2 ** (8 * dtype.itemsize) for each in fill]
    fill = [each for each in fill if each == each]  # noqa: PLR0124 - NaN is missing already
    scaled = factor is not None or offset is not None
    if not (scaled or fill or unsigned):
        return None
    result = np.dtype(np.float64) if scaled or (fill and dtype.kind != "f") else stored
    return Packing(result, stored, 1.0 if factor is None else factor, offset or 0.0, tuple(fill))


def _numbers(attributes: Mapping[str, Any], name: str) -> list[float]:
    values = np.asarray(attributes[name]) if name in attributes else np.empty(0)
    return [each for each in values.reshape(-1).tolist() if isinstance(each, int | float)]


def _number(attributes: Mapping[str, Any], name: str) -> float | None:
    found = _numbers(attributes, name)
    return found[0] if len(found) == 1 else None


def _text(attributes: Mapping[str, Any], name: str) -> str:
    value = attributes.get(name, "")
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
