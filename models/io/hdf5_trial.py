"""Reads all of an HDF5 file, but for large arrays, to find out whether this crashes or hangs; a process of its own."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from .untrusted import out_of_memory, set_limits

_MOST_BYTES = 1 << 28


@contextmanager
def _tolerant() -> Iterator[None]:
    """What Python raises is for the reader to say."""
    try:
        yield
    except MemoryError:
        out_of_memory()
    except Exception:  # noqa: S110 - on damaged bytes HDF5 raises almost any exception
        pass


def try_node(node: Any) -> None:
    """Reads attributes, dimensions and data of a group or array."""
    import h5py  # noqa: PLC0415

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


def main() -> None:
    """Reads the file of the first argument after its limits."""
    (path,) = set_limits()
    import h5py  # noqa: PLC0415

    with h5py.File(path, "r") as file:
        try_node(file)
        file.visititems(lambda _, node: try_node(node))


if __name__ == "__main__":
    main()
