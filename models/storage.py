"""Atomic writing of files, and reading of netCDF groups, Zarr stores and JSON objects.

Output is first written under a temporary name in the target folder and moved into place when complete, so an
interrupted command leaves no incomplete file.
"""

import ctypes
import errno
import json
import os
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from .errors import InputError, check_path
from .io.own_netcdf import read_own, size_of, write_own
from .io.untrusted import check_size, in_bytes, is_sealed, read_first, seal

if TYPE_CHECKING:
    import h5py
    import xarray as xr
    from numpy.typing import DTypeLike, NDArray

_NUMBER = re.compile(r"errno = (\d+)")
_TRIED = ".solidtouch-tried-"


def check_writable(path: str | Path, force: bool = False) -> Path:
    """Checks that a file can be written, and returns its path.

    Args:
        path: The file to be written.
        force: Whether to overwrite an existing file.

    Raises:
        InputError: The file exists and `force` is not set, it is a directory, or its folder cannot be written.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"A file is named by its path, got {type(path).__name__}.")
    path = check_path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder, expected a file name.")
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: not a regular file, so not overwritten.")
    if path.exists() and not force:
        raise InputError(f"{path}: already exists; use --force to overwrite it (in Python: force=True).")
    folder = path.parent
    if not folder.is_dir():
        file = next((parent for parent in path.parents if parent.exists() and not parent.is_dir()), None)
        lacking = f"no folder {folder}" if file is None else f"{file} is a file, expected a folder"
        raise InputError(f"{path}: cannot write: {lacking}.")
    if not os.access(folder, os.W_OK):
        raise InputError(f"{path}: cannot write: folder {folder} is not writable.")
    return path


@contextmanager
def complete_file(path: str | Path, force: bool = False, room: int = 0) -> Iterator[Path]:
    """Temporary file name that becomes `path` if the block ends without an exception.

    Args:
        path: The file.
        force: Whether to overwrite an existing file.
        room: Bytes that must be free on its disk; 0 if unknown.

    Raises:
        InputError: As `check_writable`, or the operating system refuses the write (for example a full disk).
    """
    path = check_writable(path, force)
    if room > (free := shutil.disk_usage(path.parent).free):
        raise InputError(f"{path}: cannot write: needs {in_bytes(room)}, but {in_bytes(free)} are free on the disk.")
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise InputError(f"{path}: cannot write: {error.strerror}.") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        _move(temporary, path, force)
    except OSError as error:
        raise InputError(f"{path}: cannot write: {reason(error)}.") from error
    finally:
        temporary.unlink(missing_ok=True)


def reason(error: OSError) -> str:
    """Why the system refused something, in its own words, also where HDF5 tells it at length."""
    said = error.strerror or str(error)
    number = _NUMBER.search(said)
    return os.strerror(int(number[1])) if number else said.split("\n", 1)[0].rstrip(".")


def room_for(dataset: "xr.Dataset") -> int:
    """Bytes that a dataset takes at least in a file; a disk that fills while HDF5 writes may crash Python later."""
    packed = ("zlib", "compression")
    variables = dataset.variables.values()
    return sum(each.nbytes for each in variables if not any(each.encoding.get(name) for name in packed))


def write_groups(groups: "Mapping[str, xr.Dataset]", path: str | Path, force: bool = False) -> None:
    """Writes datasets as the groups of a netCDF file, atomically.

    Raises:
        InputError: As `complete_file`.
    """
    import xarray as xr  # noqa: PLC0415

    with complete_file(path, force, sum(map(room_for, groups.values()))) as temporary:
        write_netcdf(xr.DataTree.from_dict(groups), temporary)
        seal(temporary)


ON_DISK = 1 << 28
"""Bytes above which samples stay on disk."""
_COPIES = 3
"""How often a file that is made in memory may be there while it grows."""


def write_netcdf(data: "xr.Dataset | xr.DataTree", path: Path) -> None:
    """Writes a netCDF file, up to 256 MiB by way of memory: a disk that fills while HDF5 writes may crash Python.

    Raises:
        OSError: The file cannot be written.
    """
    import h5py  # noqa: PLC0415
    import xarray as xr  # noqa: PLC0415

    if data.nbytes > ON_DISK or not _has_memory(_COPIES * data.nbytes):
        data.to_netcdf(path, engine="h5netcdf")
        return
    content = BytesIO()
    if isinstance(data, xr.Dataset):
        data.to_netcdf(content, engine="h5netcdf")
    else:
        with h5py.File(content, "w", track_order=True) as file:
            write_own(file, data)
    path.write_bytes(content.getvalue())


def _has_memory(size: int) -> bool:
    """Whether so many bytes can be allocated; HDF5 crashes Python some time after it could not write."""
    import numpy as np  # noqa: PLC0415

    try:
        np.empty(size, np.uint8)  # unlike `bytearray`, takes no memory until it is written to
    except MemoryError:
        return False
    return True


def spooled(
    parts: Iterable[Any], shape: tuple[int, ...] | None, dtype: "DTypeLike", order: Literal["C", "F"] = "C"
) -> "NDArray[Any] | None":
    """Array in a file of the folder for temporary files (TMPDIR), which goes with the array; `None` without room there.

    Args:
        parts: Its bytes, one part after the other.
        shape: Its shape; `None` for one axis, as long as the parts are.
        dtype: Its type.
        order: Whether the last axis runs fastest, or the first.
    """
    import numpy as np  # noqa: PLC0415

    with tempfile.TemporaryFile() as file:
        try:
            for part in parts:
                file.write(part)
            file.flush()
        except OSError as error:
            if error.errno != errno.ENOSPC:
                raise
            return None
        return np.memmap(file, dtype, "r", 0, shape, order)


def read_groups(path: str | Path, names: Iterable[str] | None, on_disk: str = "") -> "dict[str, xr.Dataset]":
    """Groups of a netCDF file by name, fully read; empty ones for those that the file lacks.

    Args:
        path: The file.
        names: Names of the groups; that of the root is "/". `None` for all.
        on_disk: Name of a variable that stays on disk if it is large; the file then stays open.

    Raises:
        InputError: The file is missing, a folder, truncated or not netCDF.
    """
    import h5py  # noqa: PLC0415
    import xarray as xr  # noqa: PLC0415

    path = check_path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder, expected a file.")
    if not path.exists():
        raise InputError(f"{path}: no such file.")
    try:
        own = is_sealed(path)
        if not own and not read_first("hdf5", path):
            raise OSError
        with h5py.File(path, "r") as file:
            if own and (size := size_of(file)) <= ON_DISK:
                check_size(path, size)
                wanted = _names(file) if names is None else names
                return {name: read_own(file, name) if name in file else xr.Dataset() for name in wanted}
            held = _names(file)  # of all: if a visit fails, xarray would leave the file open
            names = held if names is None else names
            there = {name for name in names if name in file}
        return {name: _group(path, name, on_disk) if name in there else xr.Dataset() for name in names}
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except Exception as error:  # on damaged bytes these libraries raise almost any exception
        raise InputError(f"{path}: not a netCDF file, or truncated.") from error


def _names(file: "h5py.Group") -> list[str]:
    """Names of all groups of a file."""
    import h5py  # noqa: PLC0415

    held = ["/"]
    file.visititems(lambda name, item: held.append(name) if isinstance(item, h5py.Group) else None)
    return held


def _group(path: Path, name: str, on_disk: str) -> "xr.Dataset":
    import xarray as xr  # noqa: PLC0415

    dataset = xr.open_dataset(path, group=name, engine="h5netcdf", decode_times=False, cache=False)
    if _load_small(path, dataset, on_disk):
        dataset.close()
    return dataset


def read_zarr(path: str | Path, on_disk: str = "") -> "xr.Dataset":
    """Dataset of a Zarr store, a folder; `on_disk` as in `read_groups`.

    Raises:
        InputError: The store is missing, a file, or damaged.
    """
    import xarray as xr  # noqa: PLC0415

    path = check_path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file.")
    if not path.is_dir():
        raise InputError(f"{path}: is a file, expected a Zarr store, which is a folder.")
    try:
        if not read_first("zarr_store", path):
            raise OSError
        dataset = xr.open_dataset(path, engine="zarr", chunks=None, consolidated=False, decode_times=False, cache=False)
        _load_small(path, dataset, on_disk)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except Exception as error:  # on damaged bytes these libraries raise almost any exception
        raise InputError(f"{path}: not a Zarr store with arrays, or damaged.") from error
    return dataset


def _load_small(path: Path, dataset: "xr.Dataset", on_disk: str) -> bool:
    """Reads a dataset, but for a large variable of this name; whether that was all of it."""
    large = {on_disk} & set(dataset.data_vars) if dataset.nbytes > ON_DISK else set()
    check_size(path, dataset.nbytes, dataset.nbytes - sum(dataset[name].nbytes for name in large))
    for each, variable in dataset.variables.items():
        if each not in large:
            variable.load()
    return not large


def check_netcdf_name(path: str | Path) -> None:
    """Checks that a name ends in `.nc`.

    Raises:
        InputError: It does not.
    """
    if Path(path).suffix.lower() != ".nc":
        raise InputError(f"{path}: the file name must end in .nc.")


def _holds_folders(folder: Path) -> bool:
    """Whether a folder can be created in this one; permissions are not sufficient on virtual file systems."""
    try:
        with tempfile.TemporaryDirectory(prefix=_TRIED, dir=folder):
            return True
    except OSError:
        return False


def check_folder(path: str | Path, force: bool = False) -> Path:
    """Checks that a folder of results can be written, and returns its path.

    Raises:
        InputError: It is a file or lies in one, is not writable, or is a folder that is not empty while `force` is not
            set.
    """
    path = check_path(path)
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: is a file, expected a folder.")
    there = next(parent for parent in (path.absolute(), *path.absolute().parents) if parent.exists())
    if not there.is_dir():
        raise InputError(f"{path}: cannot create the folder: {there} is a file.")
    if not os.access(there, os.W_OK | os.X_OK) or not _holds_folders(there):
        what = "the folder" if path.is_dir() else f"cannot create the folder: {there}"
        raise InputError(f"{path}: {what} is not writable.")
    if path.is_dir() and any(path.iterdir()) and not force:
        raise InputError(f"{path}: already exists; use --force to overwrite the files in it (in Python: force=True).")
    return path


@contextmanager
def complete_folder(path: str | Path, force: bool = False) -> Iterator[Path]:
    """Temporary folder whose files appear in `path` if the block ends without an exception.

    With `force`, files of the same name in an existing folder are overwritten and others kept. Where there are no
    others, this happens at once, too, unless the system has no means for that or the folder is the working directory.

    Raises:
        InputError: The folder exists and is not empty while `force` is not set, or it cannot be written.
    """
    path = check_folder(path, force)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise InputError(f"{path}: cannot write: {error.strerror}.") from error
    try:
        yield temporary
        files = sorted(temporary.iterdir())
        if not check_folder(path, force).exists():
            temporary.chmod(0o777 & ~_umask())
            temporary.rename(path)  # all files at once, and refused if another program has put files there
        elif not _exchange(temporary, path.resolve()):
            for file in files:
                file.replace(path / file.name)
    except OSError as error:
        raise InputError(f"{path}: cannot write: {reason(error)}.") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _exchange(new: Path, old: Path) -> bool:
    """Exchanges two folders, if the old one holds nothing but what is replaced; returns whether it did."""
    names = {entry.name for entry in new.iterdir()}
    try:
        here, there = new.stat(), old.stat()
        if (here.st_uid, here.st_gid) != (there.st_uid, there.st_gid) or Path.cwd().is_relative_to(old):
            return False  # a shell in the old folder would be left in one that is gone
        if any(entry.name not in names or entry.is_dir() for entry in _others(old)):
            return False
        shutil.copystat(old, new)
        _swap(new, old)
    except (OSError, AttributeError):  # the system has no exchange
        return False
    for entry in _others(new):
        if entry.name not in names:  # it came meanwhile
            entry.rename(old / entry.name)
    return True


def _others(folder: Path) -> list[Path]:
    """What a folder holds but for what is left of a program that was killed while it tried whether it could write."""
    return [entry for entry in folder.iterdir() if not entry.name.startswith(_TRIED)]


def _swap(one: Path, other: Path) -> None:
    """Exchanges two names at once; a function of Linux that Python does not offer."""
    here, exchange = -100, 2
    system = ctypes.CDLL(None, use_errno=True)
    if system.renameat2(here, os.fsencode(one), here, os.fsencode(other), exchange):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def _move(temporary: Path, path: Path, force: bool) -> None:
    """Moves a file; without `force` only if no other program has made one there since it was checked."""
    try:
        if not force:
            os.link(temporary, path)
            return
    except OSError:  # there is one, or the file system has no links
        check_writable(path)
    temporary.replace(path)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def read_object(path: str | Path, called: str) -> dict[str, Any]:
    """Object read from a JSON file.

    Args:
        path: The file.
        called: Expected content, for messages, such as `"setting"`.

    Raises:
        InputError: The file is missing, unreadable or not a JSON object, or a key is repeated.
    """
    path = check_path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file.")
    try:
        values = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_once)
    except OSError as error:
        raise InputError(f"{path}: cannot read: {error.strerror}.") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a valid {called} file: not JSON.") from error
    if not isinstance(values, dict):
        raise InputError(f"{path}: not a valid {called} file: not a JSON object.")
    return cast("dict[str, Any]", values)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    for name, number in Counter(name for name, _ in pairs).items():
        if number > 1:
            raise InputError(f"repeated key {name}.")
    return dict(pairs)
