"""Files of unknown origin: what they declare is compared with their size, and C libraries first read them elsewhere.

On damaged bytes the libraries of HDF5, MATLAB and Zarr files can crash, hang or ask for any amount of memory. A
process with limits reads such a file first: a fork of a child that has loaded the library, or the child itself where
systems have no forks. A file that this software wrote and nobody changed since bears a seal and is read at once.
"""

import atexit
import hashlib
import json
import os
import selectors
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from ..errors import InputError

_CHANGED = "the file may be damaged"
_SECONDS = 5  # of a processor
_BYTES_PER_SECOND = 5_000_000
_BUSY = 20  # times these seconds may pass, as a computer may be busy
_MEMORY = 1 << 30
_NO_MEMORY = 3  # exit code of a process that reached its limit
_NO_TIME = -getattr(signal, "SIGXCPU", 24)
_FORKS = hasattr(os, "fork")
_idle: list[subprocess.Popen[str]] = []  # children that wait for a file
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
    """Lets another process read a file before this one does; whether it could.

    Args:
        module: Module of `io.isolated`.
        path: The file or folder.
        arguments: Further arguments of its `read`.

    Raises:
        InputError: The process crashed, took more than 5 s of a processor and 0.2 s per megabyte of the file, or
            reached its limit of memory, 1 GiB and 250 times the file or what is available.
    """
    size = _size(path)
    seconds = _SECONDS + size // _BYTES_PER_SECOND
    memory = min(_MEMORY + _DENSEST * size, available_memory())
    request = json.dumps(
        [_FORKS, f"{__package__}.isolated.{module}", seconds, memory, str(path.absolute()), *map(str, arguments)]
    )
    code = _ask(request, _BUSY * seconds)
    if code == _NO_TIME:
        raise InputError(f"reading it takes longer than {seconds} s; {_CHANGED}.")
    if code == _NO_MEMORY:
        raise InputError(f"reading it takes more than {in_bytes(memory)} of memory; {_CHANGED}.")
    if code not in (0, 1):
        raise InputError(f"reading it crashes the library of its format; {_CHANGED}.")
    return code == 0


def _ask(request: str, seconds: float) -> int:
    """Exit code of the process that reads a file for a child, or of the child; `_NO_TIME` after these seconds."""
    child, answer = _child(), ""  # no other thread has this child now
    try:
        with suppress(BrokenPipeError):
            child.stdin.write(f"{request}\n")
            child.stdin.flush()
        if _FORKS and _ready(child.stdout, seconds=seconds):
            answer = child.stdout.readline()
        elif _FORKS:
            return _NO_TIME
        return int(answer or child.wait(seconds))
    except subprocess.TimeoutExpired:
        return _NO_TIME
    finally:
        _idle.append(child) if answer else _end(child)


def _child() -> Any:
    """A child that waits for a request."""
    with suppress(IndexError):
        while (child := _idle.pop()).poll() is not None:
            _end(child)
        return child
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    how: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    how |= {"text": True, "env": os.environ | one_thread, "start_new_session": True}
    return subprocess.Popen([sys.executable, "-P", "-m", __name__], **how)  # noqa: S603


def _ready(*files: Any, seconds: float | None = None) -> list[Any]:
    """Those of some pipes that can be read or are closed, once there is one or the time is over."""
    with selectors.DefaultSelector() as selector:
        for file in files:
            selector.register(file, selectors.EVENT_READ)
        return [key.fileobj for key, _ in selector.select(seconds)]


def _end(child: Any) -> None:
    """Ends a child and its fork."""
    if child.poll() is None:
        os.killpg(child.pid, signal.SIGKILL) if _FORKS else child.kill()
    child.communicate()


@atexit.register
def _end_all() -> None:
    while _idle:
        _end(_idle.pop())


if _FORKS:
    os.register_at_fork(after_in_child=_idle.clear)


def _read(read: Callable[..., object], seconds: int, memory: int, *arguments: str) -> NoReturn:
    """Reads a file within limits, where the system has them, and ends this process, without a dump if it crashes."""
    with suppress(ImportError, ValueError, OSError):
        import resource  # noqa: PLC0415

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    try:
        read(*arguments)
    except MemoryError:
        os._exit(_NO_MEMORY)
    except BaseException:
        os._exit(1)
    os._exit(0)


def main() -> None:
    """Reads files, one for each line that comes in, and prints the exit codes of the processes that did."""
    for line in sys.stdin:
        forks, module, *request = json.loads(line)
        read = import_module(module).read
        if not forks:
            _read(read, *request)
        ended, held = os.pipe()
        if not (fork := os.fork()):
            os.dup2(2, 1)  # what a library prints is no answer
            _read(read, *request)
        os.close(held)
        if ended not in _ready(sys.stdin, ended):  # nobody waits any longer
            os.kill(fork, signal.SIGKILL)
        os.close(ended)
        os.write(1, b"%d\n" % os.waitstatus_to_exitcode(os.waitpid(fork, 0)[1]))


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


if __name__ == "__main__":
    main()
