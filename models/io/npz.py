"""NumPy `.npz` archives to named arrays; pickled objects are refused, as they could run code."""

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

_DAMAGE = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError, MemoryError)


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """Arrays of an archive.

    Raises:
        InputError: The file is not an archive, is damaged, or contains pickled objects.
    """
    if not zipfile.is_zipfile(path):
        raise InputError("not an npz archive, or truncated.")
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: _member(archive, name) for name in archive.files}
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(f"damaged npz archive ({error}).") from error


def _member(archive: Any, name: str) -> NDArray[Any]:
    try:
        values = archive[name]
    except ValueError as error:
        if "allow_pickle" in str(error):
            raise InputError(f"array {name} contains pickled objects, which are refused.") from error
        raise InputError(f"array {name} is damaged ({error}).") from error
    except _DAMAGE as error:
        raise InputError(f"array {name} is damaged ({error}).") from error
    if not isinstance(values, np.ndarray):
        raise InputError(f"member {name} of the archive is not an array.")
    return values
