"""Reads the arrays of a Zarr store, but for large ones, to find out whether that crashes or hangs."""

import zarr

_MOST_BYTES = 1 << 28


def read(path: str, *left_out: str) -> None:
    """Reads a store, but for the arrays of these names."""
    # Every thread would reserve memory, which is limited.
    zarr.config.set({"async.concurrency": 1, "threading.max_workers": 1})
    for name, array in zarr.open_group(path, mode="r").arrays():
        if name not in left_out and array.nbytes <= _MOST_BYTES:
            try:
                array[...]
            except MemoryError:
                raise
            except Exception:  # noqa: S112 - what Python raises is for the reader to say
                continue
