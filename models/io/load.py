"""Loads a `TapSet` from any supported file or folder.

These are `.nc`, `.zarr`, `.mcap`, `.npz`, `.csv`, `.mat` and folders of `.csv` files.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from importlib.util import find_spec
from pathlib import Path

from ..errors import InputError, check_path
from ..extras import missing as missing_package
from ..settings import Missing, check_missing
from ..taps import TapSet, concatenate
from .arrays import read_arrays
from .csv import read_csv, read_csv_folder
from .layouts.formats.registry import ENDINGS
from .recording import Recording, naming

type TapSource = TapSet | str | Path
"""Taps, or the file or folder that holds them."""

CUT = (".nc", ".zarr")
"""Endings of tap sets."""


def load_taps(path: str | Path, missing: Missing = "refuse") -> TapSet:
    """Tap set from a file or a folder of CSV files.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import solidtouch as st
    >>> with TemporaryDirectory() as folder:
    ...     st.simulate("paper", seed=4)[0].save(Path(folder, "taps.nc"))
    ...     len(load_taps(Path(folder, "taps.nc")))
    1600

    Args:
        path: `.nc` as written by this software; `.zarr`, a store of the same dataset as `taps.dataset.to_zarr(path)`
            writes it; `.mcap` as recorded from the rig; `.npz` or `.mat` with the arrays of `io.arrays`; `.csv` with
            the columns of `csv_rows`; or a folder of such `.csv` files.
        missing: What to do with samples that are NaN: `"refuse"` the file, or `"drop"` these samples, so that they
            count neither in a fit nor in a likelihood.

    Raises:
        InputError: The file is missing, damaged, of another kind or inconsistent; the message names file, array and
            place.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"Taps are a TapSet or the path of a file or folder, got {type(path).__name__}.")
    check_missing(missing)
    path = Path(path)
    if path.suffix.lower() in CUT:
        return TapSet.load(path, missing)
    if path.suffix.lower() == ".mcap":
        from .rig import taps_from_recording  # noqa: PLC0415

        return taps_from_recording(path)
    recording = read_recording(path, missing)
    with naming(path):
        return recording.tapset(missing)


def taps_of(source: TapSource, missing: Missing | None = None) -> TapSet:
    """The taps themselves, loaded where they are named by their file.

    Args:
        source: The taps or their file.
        missing: As in `load_taps`; tap sets remember it. Without it no sample may be missing.

    Raises:
        InputError: As `load_taps`, or samples of a tap set are missing.
    """
    if not isinstance(source, TapSet):
        return load_taps(source, missing or "refuse")
    check_missing(missing or "refuse")
    if missing is None and source.lacking.any():
        lacking = int(source.lacking.any(axis=1).sum())
        raise InputError(
            f"{lacking} of {len(source)} taps have missing samples; only inspect, fit, compare, crosscheck, reproduce, "
            "trials and tune leave them out."
        )
    return source


def all_taps_of(sources: TapSource | Sequence[TapSource], missing: Missing | None = None) -> TapSet:
    """The taps of one set or file, or of several whose sessions differ in number; `missing` as in `taps_of`.

    Raises:
        InputError: As `load_taps`, or they do not go together.
    """
    if isinstance(sources, Sequence) and not isinstance(sources, str):
        check_there(sources)
        return concatenate([taps_of(part, missing) for part in sources], names_of(sources))
    return taps_of(sources, missing)


def check_there(sources: Sequence[object]) -> None:
    """Checks that all files exist before the first is read.

    Raises:
        InputError: One is missing.
    """
    for source in sources:
        if isinstance(source, str | os.PathLike) and not check_path(source).exists():
            raise InputError(f"{source}: no such file.")


def names_of(sources: Sequence[TapSource]) -> list[str]:
    """Names of tap sets for messages and pages: their paths, or numbers from 1 without files."""
    return [f"taps {n}" if isinstance(source, TapSet) else str(source) for n, source in enumerate(sources, 1)]


@contextmanager
def named(source: TapSource) -> Iterator[None]:
    """Puts the file's name in front of the message of any `InputError` raised inside the block, if there is a file."""
    with nullcontext() if isinstance(source, TapSet) else naming(source):
        yield


def read_recording(path: str | Path, missing: Missing = "refuse") -> Recording:
    """Taps or streams from a file or folder, before they become a tap set.

    Raises:
        InputError: As `load_taps`; also for `.nc`, `.zarr` and `.mcap`, whose taps are already cut.
    """
    path = check_path(path)
    if path.suffix.lower() == ".nc" and path.is_file():
        raise InputError(f"{path}: a .nc file holds taps that are already cut, not streams.")
    if path.suffix.lower() == ".zarr" and path.is_dir():
        raise InputError(f"{path}: a tap set holds taps that are already cut, not streams.")
    if path.suffix.lower() == ".mcap" and path.is_file():
        raise InputError(f"{path}: a recording of the rig holds taps cut at each press, not streams.")
    if not path.exists():
        raise InputError(f"{path}: no such file.")
    kind = path.suffix.lower()
    if path.is_dir():
        if kind in (".nc", ".mcap", ".npz", ".mat", ".csv"):
            raise InputError(f"{path}: is a folder, expected a {kind} file.")
        return read_csv_folder(path, missing)
    if kind == ".csv":
        return read_csv(path, missing)
    if kind in (".npz", ".mat"):
        return read_arrays(path, missing)
    if kind in ENDINGS:
        raise InputError(f"{path}: {_by_a_map(kind)}")
    raise InputError(
        f"{path}: unknown format; supported: .nc, .zarr, .mcap, .npz, .csv, .mat and folders of .csv files."
    )


def _by_a_map(kind: str) -> str:
    """How to import a file with this ending, whose columns or arrays may mean anything."""
    lacking = ENDINGS[kind] in ("parquet", "arrow") and find_spec("pyarrow") is None
    return (
        f"{kind} files are read by solidtouch convert with --map or its options; convert --look writes a map to begin "
        f"with.{f' {missing_package("pyarrow")}' if lacking else ''}"
    )
