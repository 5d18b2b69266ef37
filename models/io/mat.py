"""MATLAB `.mat` files, v5 to v7 and v7.3, to named arrays in the layout of `io.arrays`.

MATLAB has no vectors, no trailing axes of length one and no text except character matrices and cells; v7.3 files are
HDF5 with axes in reverse order. This module undoes all that: vectors get one axis, `taps` three.
"""

import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from .. import storage
from ..blocks import BLOCK
from ..errors import InputError
from .arrays import KNOWN, ROW_VECTORS, TABLE_VECTORS, TEXTS, check_present
from .untrusted import check_size, read_first

type _Content = NDArray[Any] | str  # or the name of a type that is not supported


def read_mat(path: Path) -> dict[str, NDArray[Any]]:
    """Arrays of a MATLAB file.

    Raises:
        InputError: The file is not a MATLAB file of version 5 to 7.3, is damaged, or an array has an unsupported type.
    """
    import h5py  # noqa: PLC0415

    content = _read_v73(path) if h5py.is_hdf5(path) else _read_v5(path)
    arrays = {}
    for name, value in content.items():
        if isinstance(value, str) and name in KNOWN:
            raise InputError(f"array {name} is a {value}; use plain arrays, cellstr(...) or char(...).")
        arrays[name] = np.array(value, dtype=object) if isinstance(value, str) else value
    return _arranged(arrays)


def _arranged(arrays: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays with the axes of `io.arrays`."""
    for name in (*ROW_VECTORS, *TABLE_VECTORS, *TEXTS):
        if name in arrays and arrays[name].size == max(arrays[name].shape, default=1):
            arrays[name] = arrays[name].reshape(-1)
    if "taps" in arrays and arrays["taps"].ndim == 2:
        arrays["taps"] = arrays["taps"][:, :, np.newaxis]
    rows = len(arrays["taps"]) if "taps" in arrays else len(arrays.get("stream", ()))
    for name, values in arrays.items():
        if name not in KNOWN and values.shape in ((rows, 1), (1, rows)):
            arrays[name] = values.reshape(-1)
    return arrays


def _read_v5(path: Path) -> dict[str, _Content]:
    """Arrays as SciPy reads them in another process."""
    with TemporaryDirectory() as folder:
        target = Path(folder, "arrays.zip")
        if not read_first("mat_v5", path, target):
            raise InputError("not a MATLAB file of version 5 to 7.3, or damaged or truncated.")
        with zipfile.ZipFile(target) as archive:
            return {name: _stored(archive, name) for name in archive.namelist()}


def _stored(archive: zipfile.ZipFile, name: str) -> _Content:
    with archive.open(name) as file:
        array = npy.read_array(file, allow_pickle=False)
    return array if array.ndim else str(array)


def _read_v73(path: Path) -> dict[str, _Content]:
    import h5py  # noqa: PLC0415

    if not read_first("hdf5", path):
        raise InputError("damaged MATLAB 7.3 file.")
    try:
        with h5py.File(path, "r") as file:
            nodes = {name: file[name] for name in map(str, file) if not name.startswith("#")}
            check_present(nodes)
            sizes = [node.nbytes for node in nodes.values() if isinstance(node, h5py.Dataset)]
            check_size(path, sum(sizes), sum(size for size in sizes if size <= storage.ON_DISK))
            return {name: _read_node(file, node) for name, node in nodes.items()}
    except InputError:
        raise
    except (OSError, KeyError, RuntimeError, ValueError, TypeError) as error:
        raise InputError(f"damaged MATLAB 7.3 file ({error}).") from error


def _read_node(file: Any, node: Any) -> _Content:
    """The array, or the name of its type if unsupported."""
    import h5py  # noqa: PLC0415

    kind = _class_of(node)
    if not isinstance(node, h5py.Dataset):
        return "struct, object or sparse matrix"
    if "MATLAB_object_decode" in node.attrs or kind in ("string", "table"):
        return "string or object"
    if node.attrs.get("MATLAB_empty", 0):
        return np.array([], dtype=np.str_ if kind in ("char", "cell") else np.float64)
    if kind == "cell":
        cells = [file[reference] for reference in node[()].T.reshape(-1)]
        if not all(_class_of(cell) == "char" for cell in cells):
            return "cell array with other content than one text per cell"
        return np.array(["".join(_texts(cell)) for cell in cells], dtype=np.str_)
    return np.array(_texts(node), dtype=np.str_) if kind == "char" else _numbers(node)


def _numbers(node: Any) -> NDArray[Any]:
    """The array of a numeric variable; a large one in a temporary file, written in blocks of whole chunks."""
    found = None
    if node.ndim and node.nbytes > storage.ON_DISK and node.dtype.names is None:
        n, chunk = node.shape[-1], node.chunks[-1] if node.chunks else 1
        step = -(-max(1, BLOCK * n // node.nbytes) // chunk) * chunk
        parts = (np.ascontiguousarray(node[..., start : start + step].T).data for start in range(0, n, step))
        found = storage.spooled(parts, node.shape[::-1], node.dtype)
    return node[()].T if found is None else found


def _class_of(node: Any) -> str:
    kind = node.attrs.get("MATLAB_class", b"")
    return kind.decode() if isinstance(kind, bytes) else str(kind)


def _texts(node: Any) -> list[str]:
    """Rows of a character matrix, stored as UTF-16 codes of shape (columns, rows), without padding."""
    if node.attrs.get("MATLAB_empty", 0):
        return []
    return [row.astype("<u2").tobytes().decode("utf-16-le", "replace").rstrip() for row in node[()].T]
