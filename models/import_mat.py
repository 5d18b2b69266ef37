"""MATLAB `.mat` files, v5 to v7 and v7.3, to named arrays in the layout of `import_arrays`.

MATLAB knows no vectors, no arrays with a trailing axis of length one and no text but character matrices and cells;
v7.3 files are HDF5 with the axes in reverse order. All of that is undone here: vectors get one axis, `taps` three.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .import_arrays import ROW_VECTORS, TABLE_VECTORS, TEXTS

_STRING_HINT = "is a MATLAB string or object; save text as cellstr(...) or char(...)."


def read_mat(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of a MATLAB file.

    Raises:
        InputError: The file is no MATLAB file of version 5 to 7.3, is damaged, or an array has a kind that cannot
            be read.
    """
    import h5py  # noqa: PLC0415

    if h5py.is_hdf5(path):
        return _arranged(_read_v73(path))
    with path.open("rb") as file:
        head = file.read(128)
    if len(head) < 128 or not head.startswith(b"MATLAB"):
        raise InputError("this is no MATLAB file of version 5 to 7.3, or it is truncated.")
    return _arranged(_read_v5(path))


def _arranged(arrays: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays with the axes of `import_arrays`."""
    for name in (*ROW_VECTORS, *TABLE_VECTORS, *TEXTS):
        if name in arrays and arrays[name].size == max(arrays[name].shape, default=1):
            arrays[name] = arrays[name].reshape(-1)
    if "taps" in arrays and arrays["taps"].ndim == 2:
        arrays["taps"] = arrays["taps"][:, :, np.newaxis]
    rows = len(arrays["taps"]) if "taps" in arrays else len(arrays.get("stream", ()))
    known = {"taps", "stream", "taxel_position", *ROW_VECTORS, *TABLE_VECTORS, *TEXTS}
    for name, values in arrays.items():
        if name not in known and values.shape in ((rows, 1), (1, rows)):
            arrays[name] = values.reshape(-1)
    return arrays


def _read_v5(path: Path) -> dict[str, NDArray[Any]]:
    from scipy.io import loadmat  # noqa: PLC0415

    try:
        content = loadmat(path)
    except Exception as error:  # on foreign bytes this parser raises almost any exception
        raise InputError(f"this MATLAB file is damaged ({type(error).__name__}: {error}).") from error
    return {name: _plain(name, value) for name, value in content.items() if not name.startswith("__")}


def _plain(name: str, value: Any) -> NDArray[Any]:
    """A v5 array as it is, and a cell of texts as an array of texts without the padding of character matrices."""
    if not isinstance(value, np.ndarray):
        raise InputError(f"the array {name} is of a kind that is not read ({type(value).__name__}).")
    if value.dtype.names:
        raise InputError(f"the array {name} is a struct or object; plain arrays are needed.")
    if value.dtype.kind == "U":
        return np.char.rstrip(value)
    if value.dtype.kind != "O":
        return value
    cells = [np.asarray(cell) for cell in value.reshape(-1)]
    if not all(cell.dtype.kind == "U" and cell.size <= 1 for cell in cells):
        raise InputError(f"the array {name} is a cell with something else than one text in each place.")
    return np.array(["".join(cell.reshape(-1)) for cell in cells], dtype=np.str_)


def _read_v73(path: Path) -> dict[str, NDArray[Any]]:
    import h5py  # noqa: PLC0415

    try:
        with h5py.File(path, "r") as file:
            return {name: _read_node(file, name, node) for name, node in file.items() if not name.startswith("#")}
    except InputError:
        raise
    except (OSError, KeyError, RuntimeError, ValueError, TypeError) as error:
        raise InputError(f"this MATLAB 7.3 file is damaged ({error}).") from error


def _read_node(file: Any, name: str, node: Any) -> NDArray[Any]:
    import h5py  # noqa: PLC0415

    if not isinstance(node, h5py.Dataset):
        raise InputError(f"the array {name} is a struct, object or sparse matrix; plain arrays are needed.")
    kind = _class_of(node)
    if "MATLAB_object_decode" in node.attrs or kind in ("string", "table", "FileWrapper__"):
        raise InputError(f"the array {name} {_STRING_HINT}")
    if node.attrs.get("MATLAB_empty", 0):
        return np.array([], dtype=np.str_ if kind in ("char", "cell") else np.float64)
    if kind == "cell":
        return np.array([_read_cell(file, name, reference) for reference in node[()].T.reshape(-1)], dtype=np.str_)
    if kind == "char":
        return np.array(_texts(node[()]), dtype=np.str_)
    return node[()].T


def _class_of(node: Any) -> str:
    kind = node.attrs.get("MATLAB_class", b"")
    return kind.decode() if isinstance(kind, bytes) else str(kind)


def _read_cell(file: Any, name: str, reference: Any) -> str:
    node = file[reference]
    if _class_of(node) != "char":
        raise InputError(f"the array {name} is a cell with something else than one text in each place.")
    texts = [] if node.attrs.get("MATLAB_empty", 0) else _texts(node[()])
    return "".join(texts)


def _texts(codes: NDArray[np.uint16]) -> list[str]:
    """The rows of a character matrix, stored as UTF-16 codes of shape (columns, rows), without their padding."""
    return [row.astype("<u2").tobytes().decode("utf-16-le", "replace").rstrip() for row in codes.T]
