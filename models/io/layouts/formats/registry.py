"""Opens a file by the ending of its name or a format that was stated."""

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path, PurePosixPath

from ....errors import InputError
from ...recording import naming
from .contents import Contents, TextTable

ENDINGS: Mapping[str, str] = {
    ".csv": "text",
    ".tsv": "text",
    ".txt": "text",
    ".dat": "text",
    ".npy": "npy",
    ".npz": "npz",
    ".mat": "mat",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".nc": "netcdf",
    ".zarr": "zarr",
    ".parquet": "parquet",
    ".arrow": "arrow",
    ".feather": "arrow",
    ".jsonl": "jsonl",
    ".ndjson": "jsonl",
    ".json": "jsonl",
    ".mcap": "mcap",
}
"""Format of the files with an ending."""
_OPENERS = {
    "text": ("text", "open_text"),
    "npy": ("numpy_files", "open_npy"),
    "npz": ("numpy_files", "open_npz"),
    "mat": ("matlab", "open_mat"),
    "hdf5": ("hdf5", "open_hdf5"),
    "netcdf": ("hdf5", "open_netcdf"),
    "zarr": ("zarr_store", "open_zarr"),
    "parquet": ("columnar", "open_columnar"),
    "arrow": ("columnar", "open_columnar"),
    "jsonl": ("json_lines", "open_json"),
    "mcap": ("mcap", "open_mcap"),
}
_READ_AT_ONCE = {"jsonl", "mcap"}
"""Formats whose files are read, wholly or in part, when they are opened."""
ROS1 = "messages of ROS 1 are not read; rosbags-convert --src IN.bag --dst OUT --dst-storage mcap makes those of ROS 2"
WAYS_OUT = {
    ".bag": ROS1,
    ".db3": "rosbag2 in SQLite is not read; ros2 bag convert -i IN -o OUT.yaml, with storage_id: mcap, or mcap convert "
    "IN.db3 OUT.mcap makes an MCAP file of it",
}
WAYS_OUT |= dict.fromkeys((".xlsx", ".xls", ".ods"), "spreadsheets are not read; save the sheet as CSV")
WAYS_OUT |= dict.fromkeys(
    (".gz", ".zip", ".7z", ".rar", ".tar", ".tgz", ".bz2", ".xz"), "archives are not read; unpack it"
)
WAYS_OUT |= dict.fromkeys(
    (".pkl", ".pickle", ".pt", ".pth", ".joblib"),
    "pickled objects are never read, as they can run code; save its arrays with np.savez",
)
"""What to do with files that are not read, by their ending."""


def ending(name: str) -> str:
    """Ending of a file's name, in small letters."""
    return PurePosixPath(name).suffix.lower()


def unknown(path: Path, names: Iterable[str], otherwise: str) -> InputError:
    """Refusal of a file, or of a folder with these files, with what to do if files of their kind are never read."""
    ways_out = (text for name in names if (text := WAYS_OUT.get(ending(name.removesuffix(".zstd")))))
    return InputError(f"{path}: {next(ways_out, otherwise)}.")


def open_contents(path: Path, how: TextTable, kind: str | None = None, most: int | None = None) -> Contents:
    """What a file holds.

    Args:
        path: The file, or the folder of a Zarr store.
        how: How a table of text is written.
        kind: Its format, where the ending of its name does not tell.
        most: How many blocks, each of some MiB, are read of a table or of messages; `None` for all.

    Raises:
        InputError: The file is damaged or of an unknown format; the message names it.
    """
    kind = kind or ENDINGS.get(ending(path.name))
    if kind is None:
        raise unknown(path, [path.name], f"unknown format; say which with format (--format): {', '.join(_OPENERS)}")
    module, name = _OPENERS[kind]
    opener: Callable[..., Contents] = getattr(import_module(f"{__package__}.{module}"), name)
    with naming(path):
        if path.is_file() and not path.stat().st_size:
            raise InputError("the file is empty.")
        contents = opener(path, how, most) if kind in _READ_AT_ONCE else opener(path, how)
    contents.most, contents.without_cut = most, most is not None
    return contents
