"""Unpacks a MATLAB file of version 5 to 7 into an archive of NumPy; a process of its own, as SciPy may crash."""

import sys
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ..errors import InputError
from .untrusted import out_of_memory, read_first, set_limits

type Content = NDArray[Any] | str


def read_v5(path: Path) -> dict[str, Content]:
    """Arrays of a MATLAB file as SciPy reads them in another process, or the name of a type that is not supported.

    Raises:
        InputError: The file is not a MATLAB file of version 5 to 7, or damaged.
    """
    with TemporaryDirectory() as folder:
        target = Path(folder, "arrays.zip")
        if not read_first("mat_v5", path, target):
            raise InputError("not a MATLAB file of version 5 to 7.3, or damaged or truncated.")
        with zipfile.ZipFile(target) as archive:
            return {name: _stored(archive, name) for name in archive.namelist()}


def _stored(archive: zipfile.ZipFile, name: str) -> Content:
    with archive.open(name) as file:
        array = npy.read_array(file, allow_pickle=False)
    return array if array.ndim else str(array)


def _plain(value: Any) -> Content:
    """Array of a variable as read by SciPy, or the name of its type if unsupported."""
    if type(value) is not np.ndarray or value.dtype.names is not None:
        return "struct, sparse matrix, function, string or object"
    if value.dtype.kind == "U":
        return np.array([row.rstrip() for row in value.reshape(-1).tolist()], dtype=np.str_)
    if value.dtype != object:
        return value
    cells = [np.asarray(cell) for cell in value.reshape(-1, order="F")]
    if not all(cell.dtype.kind == "U" and cell.size <= 1 for cell in cells):
        return "cell array with other content than one text per cell"
    return np.array(["".join(cell.reshape(-1).tolist()) for cell in cells], dtype=np.str_)


def main() -> None:
    """Unpacks the file of the first argument after its limits into that of the second."""
    path, target = set_limits()
    from scipy.io import loadmat  # noqa: PLC0415
    from scipy.io.matlab import matfile_version  # noqa: PLC0415

    try:
        if matfile_version(path)[0] != 1:
            sys.exit(1)
        content = loadmat(path)
        with zipfile.ZipFile(target, "w") as archive:
            for name in [name for name in content if not name.startswith("__")]:
                with archive.open(name, "w", force_zip64=True) as file:
                    npy.write_array(file, np.asarray(_plain(content.pop(name))), allow_pickle=False)
    except MemoryError:
        out_of_memory()


if __name__ == "__main__":
    main()
