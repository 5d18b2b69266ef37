"""Single numbers of a posterior, by names such as `level.1.2.1`, and the scales on which they are compared.

Indices count from 1, and axes of length 1 are left out, so names are those of Stan's CSV files.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Scale = str
"""`identity`, `log`, or `is N` for a class: 1 where it is N and 0 elsewhere."""


def flattened(name: str, values: NDArray[Any]) -> dict[str, NDArray[np.float64]]:
    """Every number of a parameter by its name.

    Args:
        name: Of the parameter.
        values: Its draws, shape (chain, draw, ...).

    Returns:
        Arrays of shape (chain, draw).
    """
    shape = [size for size in values.shape[2:] if size > 1]
    each = np.asarray(values, dtype=np.float64).reshape(*values.shape[:2], *shape)
    return {".".join((name, *map(str, place))): each[:, :, *index] for place, index in _places(shape)}


def _places(shape: list[int]) -> Iterator[tuple[tuple[int, ...], tuple[int, ...]]]:
    for index in np.ndindex(*shape):
        yield tuple(i + 1 for i in index), index


def on_scale(values: NDArray[np.float64], scale: Scale) -> NDArray[np.float64]:
    """Draws on the scale on which they are compared; NaN where they have none there."""
    if scale.startswith("is "):
        return (values == float(scale[3:])).astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(values) if scale == "log" else values
