"""Runs a program in any language with a case on its standard input, whatever it does."""

import os
import re
import selectors
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
from codecs import BOM_UTF8
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import IO, NamedTuple

from ...hardware.rig.deferred_signals import signals_deferred
from ...models.errors import InputError

_AT_ONCE = 1 << 16
_LONGEST_WAIT = 3600.0  # seconds; systems count them in milliseconds of 32 bits
_MOST = 24 << 20  # bytes of a stream; the answers to all cases together have 10 MB
_MOST_LINE = 1 << 18  # bytes of a line; the longest answer has 6 kB
_GRACE_S = 0.1
_SAID, _LONGEST_SAID = 3, 200  # lines of standard error that are shown, and characters of each
_LINE = re.compile(rb"[^ \t\r\n][^\n]*")


class Ended(NamedTuple):
    """What a program did.

    Attributes:
        output: Its standard output.
        failure: How it failed, as the end of a sentence that begins with "it"; empty where it ended well.
        late: Whether that was for want of time.
        left: What it left running, likewise; empty where it left nothing.
        said: The last lines of its standard error.
    """

    output: bytes | bytearray
    failure: str
    late: bool = False
    left: str = ""
    said: str = ""

    def lines(self) -> Iterator[tuple[int, str]]:
        """Number and text of each line that is not blank."""
        number, begin = 1, 0
        for line in _LINE.finditer(self.output, 3 * self.output.startswith(BOM_UTF8)):
            number += self.output.count(b"\n", begin, line.start())
            begin = line.start()
            yield number, line[0].decode("utf-8", errors="replace")


def split_command(command: str | Path | Sequence[str | Path]) -> list[str]:
    """The words of a command, which is quoted as in a shell, the path of a program, or its words.

    Raises:
        InputError: It has an open quotation mark, or is none of these.
    """
    if isinstance(command, Path):
        return [str(command)]
    if not isinstance(command, str):
        if not isinstance(command, Sequence) or not all(isinstance(word, str | Path) for word in command):
            raise InputError(f"command must be a text, a path or a list of them, got {command!r}.")
        return [*map(str, command)]
    try:
        return shlex.split(command)
    except ValueError as error:
        raise InputError(f"command {command!r} cannot be read: {error}.") from error


def check_command(words: Sequence[str]) -> None:
    """Checks that a program can be started.

    Raises:
        InputError: None is named, there is none of this name, or it is not executable.
    """
    if not words:
        raise InputError("command is empty; it must name a program.")
    if shutil.which(words[0]) is None:
        there, path = Path(words[0]).exists(), "/" in words[0]
        reason = "Permission denied" if there and path else "No such file or directory"
        here = f"; in this folder it is ./{words[0]}" if there and words[0] and not path else ""
        raise InputError(f"command: {words[0]} cannot be run: {reason}{here}.")


def run_program(words: Sequence[str], lines: Iterable[str], timeout: float) -> Ended:
    """Runs a program to its end, with at most 24 MiB of its output in memory.

    It and its process group are stopped after the timeout, and where it writes more than that, or a line of more than
    256 KiB.

    Args:
        words: The program and its arguments.
        lines: Of its standard input.
        timeout: Seconds after which it is stopped.

    Raises:
        InputError: There is no such program.
    """
    with ExitStack() as stack:
        process = None
        try:
            with signals_deferred():  # one that comes before the program is known would leave it running
                process = stack.enter_context(_start(words, lines))
            assert process.stdout is not None  # noqa: S101 - for the type checker
            assert process.stderr is not None  # noqa: S101
            output, errors = streams = _Stream(process.stdout), _Stream(process.stderr, " to standard error", _AT_ONCE)
            end = time.monotonic() + timeout
            left = ""
            failure = _read(streams, end)
            with suppress(subprocess.TimeoutExpired):
                process.wait(0.0 if failure else max(end - time.monotonic(), 0.0))
            late = process.poll() is None and not failure
            if late:
                closed = "" if output.open else "closed its output but "
                failure = f"{closed}has not ended after {timeout:g} s and was stopped"
            elif not failure:
                failure = _failure(process.returncode)
                left = _left(process.pid, not (output.open or errors.open), timeout)
        finally:
            if process is not None:
                _kill(process.pid)  # also what it has started itself
                process.wait()
        end = time.monotonic() + _GRACE_S
        while (escaped := output.open or errors.open) and time.monotonic() < end:
            _read(streams, end)
        if escaped:
            left = "left a process running that could not be stopped, as it left the process group"
    return Ended(output.kept, failure, late, left, _said(errors.kept))


def _start(words: Sequence[str], lines: Iterable[str]) -> subprocess.Popen[bytes]:
    with tempfile.TemporaryFile("w+", encoding="utf-8") as given:
        given.writelines(f"{line}\n" for line in lines)
        given.seek(0)
        try:
            return subprocess.Popen(  # noqa: S603 - running the user's program is what this is for
                words, stdin=given, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
            )
        except OSError as error:
            raise InputError(f"command: {words[0]} cannot be run: {error.strerror}.") from error


class _Stream:
    """What is read of a stream.

    Args:
        pipe: The stream.
        name: Its name, behind "writes more than 24 MiB".
        tail: How many bytes of its end are kept; 0 keeps all.
    """

    def __init__(self, pipe: IO[bytes], name: str = "", tail: int = 0) -> None:
        self.pipe, self.open = pipe, True
        self.kept = bytearray()
        self._name, self._tail = name, tail
        self._size = self._line = 0

    def read(self) -> str:
        """Reads a part of it; returns what is too much, if anything is."""
        part = os.read(self.pipe.fileno(), _AT_ONCE)
        self.open = bool(part)
        self._size += len(part)
        begin = part.rfind(b"\n") + 1
        self._line = len(part) - begin + (0 if begin else self._line)
        if self._size > _MOST:
            return f"writes more than {_MOST >> 20} MiB{self._name} and was stopped"
        self.kept += part
        if self._tail:
            del self.kept[: -self._tail]
        elif self._line > _MOST_LINE:
            return f"writes a line of more than {_MOST_LINE >> 10} KiB and was stopped"
        return ""


def _read(streams: Sequence[_Stream], end: float) -> str:
    """Reads streams until they are closed or it is too late; returns what is too much, if anything is."""
    with selectors.DefaultSelector() as selector:
        for stream in streams:
            if stream.open:
                selector.register(stream.pipe, selectors.EVENT_READ, stream)
        while selector.get_map() and (rest := end - time.monotonic()) > 0:
            for key, _ in selector.select(min(rest, _LONGEST_WAIT)):
                if flood := key.data.read():
                    return flood
                if not key.data.open:
                    selector.unregister(key.fileobj)
    return ""


def _left(group: int, closed: bool, timeout: float) -> str:
    """What a program that has ended left running."""
    if not closed:
        return f"left a process running that kept its output open for {timeout:g} s and was stopped"
    end = time.monotonic() + _GRACE_S
    while running := _runs(group):
        if time.monotonic() > end:
            break
        time.sleep(_GRACE_S / 10)
    return "left a process running, which was stopped" if running else ""


def _runs(group: int) -> bool:
    """Whether a process of a group runs; those that have ended and that nobody waits for do not count."""
    try:
        os.killpg(group, 0)
    except OSError:
        return False
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, of = path.read_text(errors="replace").rpartition(")")[2].split()[:3]
            if int(of) == group and state != "Z":
                return True
    return not Path("/proc/self").exists()


def _kill(group: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)


def _failure(code: int) -> str:
    if code < 0:
        return f"crashed with signal {_signal_name(-code)}"
    return f"ended with exit code {code}" if code else ""


def _said(errors: bytearray) -> str:
    """The last lines of standard error that are not blank, in one line."""
    lines = [line.strip() for line in errors.decode("utf-8", errors="replace").splitlines()]
    shown = [line for line in lines if line][-_SAID:]
    return " | ".join(printable(line[:_LONGEST_SAID]) for line in shown)


def printable(text: str) -> str:
    """Text that does not paint or move on a terminal."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return str(number)


def read_answers(folder: Path, name: str) -> Ended:
    """Answers that are a file already, as if a program had written them."""
    path = folder / f"{name}.jsonl"
    if path.exists() and not path.is_file():
        return Ended(b"", f"is not a file: {path}")
    try:
        with path.open("rb") as file:
            output = file.read(_MOST + 1)
    except OSError as error:
        return Ended(b"", f"cannot be read: {path}: {error.strerror}")
    return Ended(output[:_MOST], f"has more than {_MOST >> 20} MiB: {path}" if len(output) > _MOST else "")
