"""SHA256SUMS of a folder, as `sha256sum -c` reads it."""

import errno
import hashlib
import re
from pathlib import Path

from ....models.errors import InputError

SUMS = "SHA256SUMS"
_LINE = re.compile(r"([0-9a-f]{64})  ([A-Za-z0-9][A-Za-z0-9._-]*)")


def sha256(path: Path) -> str:
    """The checksum of a file, in hexadecimal digits."""
    _check_regular(path)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _check_regular(path: Path) -> None:
    """Refuses a pipe, which would be waited for, and a device, which would be read without end."""
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "not a file")


def write_sums(folder: Path) -> None:
    """Writes the checksums of all files of a folder into it, but of hidden ones, which copies often lack."""
    lines = [f"{sha256(path)}  {path.name}\n" for path in sorted(folder.glob("[!.]*"))]
    (folder / SUMS).write_text("".join(lines), encoding="ascii", newline="\n")


def check_sums(folder: Path) -> list[str]:
    """Names of the files of a folder, which all are there and unchanged.

    Raises:
        InputError: There are no checksums, or a file is missing or another one.
    """
    path = folder / SUMS
    try:
        _check_regular(path)
        lines = path.read_text(encoding="ascii").splitlines()
    except FileNotFoundError:
        raise InputError(f"kit {folder}: incomplete: {SUMS} is missing.") from None
    except (OSError, UnicodeDecodeError):
        raise InputError(f"kit {folder}: damaged: {SUMS} cannot be read.") from None
    names = []
    for number, line in enumerate(lines, 1):
        if (parts := _LINE.fullmatch(line)) is None:
            raise InputError(f"kit {folder}: damaged: line {number} of {SUMS} is not a checksum and a name.")
        names.append(parts[2])
        _check(folder, *parts.groups())
    return names


def _check(folder: Path, right: str, name: str) -> None:
    try:
        found = sha256(folder / name)
    except FileNotFoundError:
        raise InputError(f"kit {folder}: incomplete: {name} is missing, which {SUMS} lists.") from None
    except OSError as error:
        raise InputError(f"kit {folder}: {name} cannot be read: {error.strerror}.") from None
    if found != right:
        windows = _with_line_feeds(folder / name) == right
        cause = ": its line ends are those of Windows, as git writes them with core.autocrlf" if windows else ""
        raise InputError(f"kit {folder}: damaged: {name} differs from its checksum in {SUMS}{cause}.")


def _with_line_feeds(path: Path) -> str:
    """The checksum that a file has with the line ends of an export."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        for line in file:
            digest.update(line.replace(b"\r\n", b"\n"))
    return digest.hexdigest()
