"""Result of a sweep on disk: a Zarr store that is consistent at any moment.

Every cell has a chunk of `result` and one of `status`, and a failed one of `traceback`. Chunks are not compressed, so
a chunk is the array's bytes, and this file writes it without Zarr: under a temporary name first, then moved into
place, the status last. Whatever ends the program, a cell whose status is there is there as a whole. Chunks of pending
cells do not exist, so that listing a folder tells the state of all cells.

Only one program may write at a time, which a lock on `zarr.json` sees to.
"""

import json
import os
import shutil
import struct
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError, check_format
from ...models.extras import posix
from ..stats import tallied
from ..tasks.task import Outcome
from .cells import AXES, CellGrid

with posix("A sweep"):
    import fcntl

QUANTITIES = tallied.QUANTITIES | {
    "trials": "number of trials, the same at every threshold",
    "seconds": "time that the cell took, the same at every threshold",
}
"""Names and what they mean, in the order in which they are stored."""


FORMAT = 1
PENDING, DONE, FAILED = 0, 1, 2
_SEPARATED: Any = {"name": "default", "separator": "."}
_STATUS = {"flag_values": [PENDING, DONE, FAILED], "flag_meanings": "pending done failed"}


class SweepStore:
    """The store of a sweep, open for writing.

    Args:
        path: The folder.
        grid: The cells.
    """

    def __init__(self, path: Path, grid: CellGrid) -> None:
        self.path = path
        self._grid = grid

    def status(self) -> NDArray[np.int8]:
        """`PENDING`, `DONE` or `FAILED` of every cell, by number; reads chunks of failed cells only.

        Raises:
            InputError: A part is missing, or files are there that belong to no cell.
        """
        status = np.zeros(len(self._grid), dtype=np.int8)
        try:
            status[self._listed("status")] = DONE
            for number in self._listed("traceback"):
                if status[number]:  # a cell that failed before it was done keeps its traceback for a moment
                    status[number] = (self.path / "status" / self._chunk(number)).read_bytes()[0]
        except (OSError, ValueError, IndexError) as error:
            raise InputError(f"{self.path}: damaged sweep ({error}).") from error
        return status

    def write(self, outcome: Outcome) -> None:
        """Writes a cell at all of its places.

        Raises:
            InputError: The operating system refuses.
        """
        places = self._grid.places(outcome.number)
        try:
            for number in places:
                self._put_content(number, outcome)
            for number in places:
                self._put("status", self._chunk(number), bytes([FAILED if outcome.traceback else DONE]))
            for number in places if not outcome.traceback else ():
                (self.path / "traceback" / self._chunk(number)).unlink(missing_ok=True)
        except OSError as error:
            raise InputError(f"{self.path} cannot be written: {error.strerror or error}.") from error

    def _put_content(self, number: int, outcome: Outcome) -> None:
        if outcome.traceback:
            text = outcome.traceback.encode("utf-8", "backslashreplace")
            # One string, its length, the string: Zarr's vlen-utf8.
            self._put("traceback", self._chunk(number), struct.pack("<II", 1, len(text)) + text)
        else:
            values = outcome.values | {"seconds": np.full_like(outcome.values["trials"], outcome.seconds)}
            rows = np.array([values[name] for name in QUANTITIES], dtype="<f8")
            self._put("result", f"{self._chunk(number)}.0.0", rows.tobytes())

    def _chunk(self, number: int) -> str:
        return f"c.{'.'.join(map(str, self._grid.index(number)))}"

    def _put(self, array: str, chunk: str, content: bytes) -> None:
        temporary = self.path / array / ".writing"
        temporary.write_bytes(content)
        temporary.replace(self.path / array / chunk)

    def _listed(self, array: str) -> NDArray[np.intp]:
        """Numbers of the cells with a chunk in an array of the shape of the grid."""
        names = (entry.name for entry in os.scandir(self.path / array))
        places = np.array([name.split(".")[1:] for name in names if name.startswith("c.")], dtype=np.intp)
        places = places.reshape(-1, len(AXES))
        return np.asarray(np.ravel_multi_index(tuple(places.T), self._grid.shape))


def create_store(
    path: Path,
    grid: CellGrid,
    thresholds: Sequence[float],
    units: dict[str, tuple[str, str]],
    about: dict[str, Any],
) -> SweepStore:
    """An empty store, there as a whole or not at all.

    Args:
        path: Where; nothing may be there.
        grid: The cells.
        thresholds: theta_W.
        units: Units of the what and the where error of each data set.
        about: What identifies the study, kept as attributes.

    Raises:
        InputError: It cannot be written.
    """
    try:
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}.") from error
    try:
        _build(temporary, grid, thresholds, units, about)
        temporary.chmod(0o755)
        temporary.rename(path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return SweepStore(path, grid)


def read_about(path: Path) -> dict[str, Any]:
    """What identifies the study of a store, as it was when the store was created.

    Raises:
        InputError: There is no such store, or it is damaged.
    """
    try:
        about = json.loads((path / "zarr.json").read_text(encoding="utf-8"))["attributes"]
        check_format(about["sweep_format"], f"{path}: a sweep", FORMAT)
        if about["sweep_format"] != FORMAT or not isinstance(about["study"], str):
            raise KeyError
        about |= {name: msgspec.json.decode(about[name], type=dict[str, str]) for name in ("data_keys", "code")}
        about["settings"] = msgspec.json.decode(about["settings"], type=dict[str, Any])
        about["settings"]["grid"] = dict(about["settings"]["grid"])
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, RecursionError, msgspec.MsgspecError) as error:
        raise InputError(f"{path} exists and is no sweep of format {FORMAT}, or is damaged.") from error
    return about


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Keeps other programs from writing to a store.

    Raises:
        InputError: Another program writes to it, or it may not be written.
    """
    try:
        lock = (path / "zarr.json").open("r+b")
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}.") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise InputError(f"{path} is being written by another sweep.") from error
        yield


def _build(
    path: Path,
    grid: CellGrid,
    thresholds: Sequence[float],
    units: dict[str, tuple[str, str]],
    about: dict[str, Any],
) -> None:
    import xarray as xr  # noqa: PLC0415
    import zarr  # noqa: PLC0415

    coordinates = {name: (name, _labels(values)) for name, values in zip(AXES, grid.axes, strict=True)}
    what_unit, where_unit = (np.array(column, dtype=object) for column in zip(*units.values(), strict=True))
    coordinates |= {
        "theta": ("theta", np.asarray(thresholds, dtype=np.float64)),
        "quantity": ("quantity", np.array(list(QUANTITIES), dtype=object)),
        "meaning": ("quantity", np.array(list(QUANTITIES.values()), dtype=object)),
        "what_unit": ("data", what_unit),
        "where_unit": ("data", where_unit),
    }
    described = xr.Dataset(coords=coordinates, attrs={"sweep_format": FORMAT, **about})
    described.to_zarr(path, zarr_format=3, consolidated=False)
    group = zarr.open_group(path)
    ones = (1,) * len(AXES)
    arrays = (
        ("result", (len(QUANTITIES), len(thresholds)), "float64", np.nan, ("quantity", "theta"), {}),
        ("status", (), "int8", PENDING, (), _STATUS),
        ("traceback", (), str, "", (), {}),
    )
    for name, extra, kind, fill, dims, attributes in arrays:
        group.create_array(
            name,
            shape=grid.shape + extra,
            chunks=ones + extra,
            dtype=kind,
            fill_value=fill,
            dimension_names=(*AXES, *dims),
            compressors=None,
            chunk_key_encoding=_SEPARATED,
            attributes=attributes | {"coordinates": "what_unit where_unit"},
        )


def _labels(values: Sequence[Any]) -> NDArray[Any]:
    """Values along an axis as xarray can select them: numbers as they are, words and mixtures as text."""
    if all(isinstance(value, int | float) for value in values):
        return np.array(values)
    return np.array(["middle" if value is None else str(value) for value in values], dtype=object)
