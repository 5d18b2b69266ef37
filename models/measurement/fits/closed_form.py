"""Posteriors in closed form as datasets, so that files hold what draws are made from instead of draws.

Such a posterior is a named tuple of arrays, numbers and tuples like it. Nothing is rounded, so an opened posterior
gives the draws of the fitted one.
"""

from collections.abc import Iterator
from typing import Any, get_type_hints

import numpy as np
import xarray as xr
from numpy.typing import NDArray

GROUP = "closed_form"
"""Group of model files."""


def packed(posterior: Any) -> xr.Dataset:
    """Arrays of a posterior, those of its parts under names with dots; axes of equal values are kept once."""
    variables = {}
    for name, array in _arrays(posterior):
        variables[name] = tuple(f"{name}_{axis}" for axis in range(array.ndim)), once(array), {"shape": array.shape}
    return xr.Dataset(variables)


def once(array: NDArray[Any]) -> NDArray[Any]:
    """An array with axes along which it was broadcast cut to 1."""
    return array[tuple(slice(None if stride else 1) for stride in array.strides)]


def _arrays(posterior: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, value in zip(posterior._fields, posterior, strict=True):
        if hasattr(value, "_fields"):
            yield from ((f"{name}.{part}", array) for part, array in _arrays(value))
        else:
            yield name, np.asarray(value)


def unpacked(kind: type, arrays: xr.Dataset, prefix: str = "") -> Any:
    """Posterior of a kind from its arrays.

    Raises:
        KeyError: One is missing.
        ValueError: One has another shape.
    """
    values = []
    for name, hint in get_type_hints(kind).items():
        if hasattr(hint, "_fields"):
            values.append(unpacked(hint, arrays, f"{prefix}{name}."))
            continue
        array = arrays[prefix + name]
        shape = tuple(np.atleast_1d(array.attrs["shape"]).astype(int))
        values.append(np.broadcast_to(array.values, shape) if shape else array.item())
    return kind(*values)
