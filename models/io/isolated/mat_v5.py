"""Unpacks a MATLAB file of version 5 to 7 into an archive of NumPy, as SciPy may crash."""

import zipfile
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import matfile_version


def _plain(value: Any) -> NDArray[Any] | str:
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


def read(path: str, target: str) -> None:
    """Unpacks the first file into the second.

    Raises:
        ValueError: It is of another version.
        Exception: What SciPy raises on damaged bytes.
    """
    if matfile_version(path)[0] != 1:
        raise ValueError
    content = loadmat(path)
    with zipfile.ZipFile(target, "w") as archive:
        for name in [name for name in content if not name.startswith("__")]:
            with archive.open(name, "w", force_zip64=True) as file:
                npy.write_array(file, np.asarray(_plain(content.pop(name))), allow_pickle=False)
