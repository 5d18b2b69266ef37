"""Files of unknown origin: what they declare is compared with their size, and C libraries first read them elsewhere.

On damaged bytes the libraries of HDF5 and MATLAB files can crash, hang or ask for any amount of memory. A child
process with limits reads such a file first. A file that this software wrote and nobody changed since bears a seal and
is read at once.
"""

import hashlib
import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..errors import InputError

_CHANGED = "the file may be damaged"
_SECONDS = 5  # of a processor
_BYTES_PER_SECOND = 5_000_000
_BUSY = 20  # times these seconds may pass, as a computer may be busy
_MEMORY = 1 << 30
_NO_MEMORY = 3  # exit code of a child that reached its limit
_NO_TIME = -getattr(signal, "SIGXCPU", 24)
_SEAL = b"solidtouch-seal\n"
_DIGEST = 16
_MOST_SEALED = 1 << 26
_SMALL = 1 << 28
_DENSEST = 250  # times the size of a file that its content may have; measured samples are packed 2 to 30 times


def check_size(path: Path, declared: int, in_memory: int | None = None) -> None:
    """Checks the size of what a file says that it holds, before it is read.

    Args:
        path: The file or folder.
        declared: Bytes of its arrays, unpacked.
        in_memory: How many of them are in memory at once; default all.

    Raises:
        InputError: They are more than 256 MiB and 250 times the file, or more than the memory that is available.
    """
    if declared > _SMALL and declared > _DENSEST * (held := _size(path)):
        raise InputError(
            f"declares {in_bytes(declared)} of content in {in_bytes(held)}; more than {_DENSEST} times its size is not "
            "read."
        )
    needed, there = declared if in_memory is None else in_memory, available_memory()
    if needed > there:
        raise InputError(f"needs {in_bytes(needed)} of memory, but {in_bytes(there)} are available.")


def _size(path: Path) -> int:
    return sum(file.stat().st_size for file in (path.rglob("*") if path.is_dir() else (path,)))


def in_bytes(number: int) -> str:
    """A number of bytes with a unit, such as `"8.7 GB"`."""
    power = min(max(len(str(number)) - 1, 0) // 3, 6)
    return f"{number / 1000**power:.3g} {('bytes', 'kB', 'MB', 'GB', 'TB', 'PB', 'EB')[power]}"


def available_memory() -> int:
    """Bytes of memory that programs can still have; all of it where the system does not tell, 1 TB if unknown."""
    with suppress(OSError), Path("/proc/meminfo").open(encoding="ascii") as lines:
        return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
    with suppress(AttributeError, ValueError, OSError):
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return 10**12


def read_first(module: str, path: Path, *arguments: str | Path) -> bool:
    """Lets a child process read a file before this one does; whether it could.

    Args:
        module: Module of this folder that reads the file and calls `set_limits` before.
        path: The file.
        arguments: Further arguments of the module.

    Raises:
        InputError: The child crashed, took more than 5 s of a processor and 0.2 s per megabyte of the file, or reached
            its limit of memory, 1 GiB and 250 times the file or what is available.
    """
    size = path.stat().st_size
    seconds = _SECONDS + size // _BYTES_PER_SECOND
    memory = min(_MEMORY + _DENSEST * size, available_memory())
    name = f"{__package__}.{module}"
    command = [sys.executable, "-P", "-m", name, f"{seconds}", f"{memory}", str(path.absolute()), *map(str, arguments)]
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    how: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    how |= {"env": os.environ | one_thread, "timeout": _BUSY * seconds}
    try:
        code = subprocess.run(command, check=False, **how).returncode  # noqa: S603
    except subprocess.TimeoutExpired:
        code = _NO_TIME
    if code == _NO_TIME:
        raise InputError(f"reading it takes longer than {seconds} s; {_CHANGED}.")
    if code == _NO_MEMORY:
        raise InputError(f"reading it takes more than {in_bytes(memory)} of memory; {_CHANGED}.")
    if code not in (0, 1):
        raise InputError(f"reading it crashes the library of its format; {_CHANGED}.")
    return code == 0


def set_limits() -> list[str]:
    """Limits this process, where the system can, and has it leave no dump where it crashes; its other arguments."""
    seconds, memory, *others = sys.argv[1:]
    with suppress(ImportError, ValueError, OSError):
        import resource  # noqa: PLC0415

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
        resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
    return others


def out_of_memory() -> None:
    """Ends the process as `read_first` expects it after a `MemoryError`."""
    os._exit(_NO_MEMORY)


def seal(path: Path) -> None:
    """Appends a digest to a file of at most 64 MiB, which HDF5 ignores at the end of a file and removes on changes."""
    if path.stat().st_size <= _MOST_SEALED:
        digest = _digest(path.read_bytes())
        with path.open("ab") as file:
            file.write(_SEAL + digest)


def is_sealed(path: Path) -> bool:
    """Whether a file ends in the digest of what is before it."""
    end = len(_SEAL) + _DIGEST
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        if not end <= size <= _MOST_SEALED + end:
            return False
        file.seek(-end, os.SEEK_END)
        told = file.read()
        if not told.startswith(_SEAL):
            return False
        file.seek(0)
        return told == _SEAL + _digest(file.read(size - end))


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_DIGEST).digest()
