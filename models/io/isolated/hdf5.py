"""Reads all of an HDF5 file, but for large arrays, to find out whether that crashes or hangs."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import h5py

_MOST_BYTES = 1 << 28


@contextmanager
def _tolerant() -> Iterator[None]:
    """What Python raises is for the reader to say, but for a lack of memory, which HDF5 reports as an OSError."""
    try:
        yield
    except Exception as error:  # on damaged bytes HDF5 raises almost any exception
        if isinstance(error, MemoryError) or "alloc" in str(error):
            raise MemoryError from error


def try_node(node: Any) -> None:
    """Reads attributes, dimensions and data of a group or array."""
    for name in list(node.attrs):
        with _tolerant():
            node.attrs[name]
    if isinstance(node, h5py.Dataset):
        with _tolerant():
            [len(dimension) for dimension in node.dims]
        with _tolerant():
            _ = node.fillvalue, node.chunks
            if node.nbytes <= _MOST_BYTES:
                node[()]


def read(path: str) -> None:
    """Reads the file."""
    with h5py.File(path, "r") as file:
        try_node(file)
        file.visititems(lambda _, node: try_node(node))
