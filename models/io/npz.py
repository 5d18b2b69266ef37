"""NumPy `.npz` archives to named arrays; pickled objects are refused, they could run code."""

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

_DAMAGE = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError, MemoryError)


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an archive.

    Raises:
        InputError: The file is no such archive, is damaged, or holds pickled objects.
    """
    if not zipfile.is_zipfile(path):
        raise InputError("this is no npz archive, or it is truncated.")
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: _member(archive, name) for name in archive.files}
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(f"this npz archive is damaged ({error}).") from error


def _member(archive: Any, name: str) -> NDArray[Any]:
    try:
        values = archive[name]
    except ValueError as error:
        if "allow_pickle" in str(error):
            raise InputError(f"the array {name} holds pickled objects, which are not read.") from error
        raise InputError(f"the array {name} is damaged ({error}).") from error
    except _DAMAGE as error:
        raise InputError(f"the array {name} is damaged ({error}).") from error
    if not isinstance(values, np.ndarray):
        raise InputError(f"the member {name} of this archive is no array.")
    return values
