"""Classic netCDF files, which are not HDF5 and never packed."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import InputError
from ...untrusted import check_size, read_first
from .contents import Contents, Variable
from .hdf5_nodes import attributes_of, unit_of
from .named_arrays import TEXT, NamedArrays, Stored, joined_letters, texts
from .scaled import Packing, packing_of

_CLASSIC = (b"CDF\x01", b"CDF\x02")


def is_netcdf3(path: Path) -> bool:
    """Whether a file begins like one of the classic format."""
    with path.open("rb") as file:
        return file.read(4) in _CLASSIC


def open_netcdf3(path: Path) -> Contents:
    """Variables of a classic netCDF file.

    Raises:
        InputError: The file is damaged, or does not fit into memory.
    """
    check_size(path, path.stat().st_size)
    if not read_first("netcdf3", path):
        raise InputError("damaged or truncated netCDF file.")
    found: dict[str, Stored] = {}
    try:
        with _opened(path) as file:
            attributes = attributes_of(file._attributes)
            for name, each in file.variables.items():
                told = each._attributes
                attributes |= attributes_of(told, f"{name}@")
                found[name] = _variable(name, each, told)
    except Exception as error:  # on damaged bytes SciPy raises almost any exception
        raise InputError(f"damaged netCDF file ({error}).") from error
    return NamedArrays(path, found, {}, attributes, partial(_opened, path))


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    from scipy.io import netcdf_file  # noqa: PLC0415

    with warnings.catch_warnings(action="ignore"), netcdf_file(path, mmap=False) as file:
        yield file


def _variable(name: str, each: Any, told: dict[str, Any]) -> Stored:
    shape, dtype = each.data.shape, each.data.dtype
    if dtype.kind == "S":
        return Stored(Variable(shape[:-1], TEXT, unit_of(told)), each.data.nbytes, partial(_texts, name), mapped=False)
    packing = packing_of(told, dtype)
    kind = dtype.newbyteorder("=") if packing is None else packing.dtype
    return Stored(
        Variable(shape, kind, unit_of(told)), each.data.nbytes, partial(_numbers, name, packing), mapped=False
    )


def _numbers(name: str, packing: Packing | None, file: Any) -> NDArray[Any]:
    values = file.variables[name].data
    return np.array(values, values.dtype.newbyteorder("=")) if packing is None else packing(np.array(values))


def _texts(name: str, file: Any) -> NDArray[np.str_]:
    values = np.array(file.variables[name].data)
    return texts(joined_letters(values) if values.ndim else values)
