"""Files that are either whole or not there.

Everything this software writes goes to a temporary name in the target's own folder first and is moved into place
when it is complete, so an interrupted command leaves no half-written file behind.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import InputError

if TYPE_CHECKING:
    import xarray as xr


def check_writable(path: str | Path, force: bool = False) -> Path:
    """The path, if a file may be written there.

    Args:
        path: The file to be written.
        force: Whether an existing file may be replaced.

    Raises:
        InputError: The file exists and `force` is not set, it is a directory, or its folder cannot be written.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path} is a directory, a file name is needed.")
    if path.exists() and not path.is_file():
        raise InputError(f"{path} is no regular file and is not replaced.")
    if path.exists() and not force:
        raise InputError(f"{path} exists already; --force overwrites it.")
    folder = path.parent
    if not folder.is_dir():
        raise InputError(f"{path} cannot be written: there is no folder {folder}.")
    if not os.access(folder, os.W_OK):
        raise InputError(f"{path} cannot be written: the folder {folder} is not writable.")
    return path


@contextmanager
def complete_file(path: str | Path, force: bool = False) -> Iterator[Path]:
    """A temporary file name that becomes `path` when the block ends without an exception.

    Raises:
        InputError: As `check_writable`, or the operating system refuses the write (for example a full disk).
    """
    path = check_writable(path, force)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}.") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from error
    finally:
        temporary.unlink(missing_ok=True)


def write_groups(groups: "Mapping[str, xr.Dataset]", path: str | Path, force: bool = False) -> None:
    """Writes datasets as the groups of a netCDF file, complete or not at all.

    Raises:
        InputError: As `complete_file`.
    """
    import xarray as xr  # noqa: PLC0415

    with complete_file(path, force) as temporary:
        xr.DataTree.from_dict(groups).to_netcdf(temporary, engine="h5netcdf")


def check_netcdf_name(path: str | Path) -> None:
    """Refuses names that do not say what they are.

    Raises:
        InputError: The name does not end in `.nc`.
    """
    if Path(path).suffix.lower() != ".nc":
        raise InputError(f"{path} must end in .nc, the format that it is written in.")


def _holds_folders(folder: Path) -> bool:
    """Whether a folder can be made in this one; rights alone do not tell where a kernel makes the files."""
    try:
        with tempfile.TemporaryDirectory(dir=folder):
            return True
    except OSError:
        return False


def check_folder(path: str | Path, force: bool = False) -> Path:
    """The path, if a folder of results may be written there.

    Raises:
        InputError: It is a file or lies in one, may not be written, or is a folder that is not empty while `force` is
            not set.
    """
    path = Path(path)
    if path.exists() and not path.is_dir():
        raise InputError(f"{path} is a file, a folder is needed.")
    there = next(parent for parent in (path.absolute(), *path.absolute().parents) if parent.exists())
    if not there.is_dir():
        raise InputError(f"{path} cannot be made: {there} is a file.")
    if not os.access(there, os.W_OK | os.X_OK) or not _holds_folders(there):
        raise InputError(f"{path} cannot be made: {there} cannot be written.")
    if path.is_dir() and any(path.iterdir()) and not force:
        raise InputError(f"{path} exists already; --force overwrites the files in it.")
    return path


@contextmanager
def complete_folder(path: str | Path, force: bool = False) -> Iterator[Path]:
    """A temporary folder whose files appear in `path` when the block ends without an exception.

    With `force` files of the same name in an existing folder are replaced and others stay.

    Raises:
        InputError: The folder exists and is not empty while `force` is not set, or it cannot be written.
    """
    path = check_folder(path, force)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}.") from error
    try:
        yield temporary
        path.mkdir(exist_ok=True)
        for file in sorted(temporary.iterdir()):
            file.replace(path / file.name)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
