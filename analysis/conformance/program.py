"""Runs a program in any language with a case on its standard input, robust to crashes and time-outs."""

import os
import shlex
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import IO, NamedTuple

from ...models.errors import InputError

_AT_ONCE = 1 << 16
_MOST_OUTPUT = 1 << 28  # a quarter of a gigabyte
_KEPT_ERRORS = 1 << 16


class Ended(NamedTuple):
    """What a program did.

    Attributes:
        output: Its standard output.
        failure: How it failed, as the end of a sentence that begins with "it"; empty where it ended well.
        late: Whether that was for want of time.
    """

    output: str
    failure: str
    late: bool = False


def split_command(command: str) -> list[str]:
    """The words of a command.

    Raises:
        InputError: It is empty or has an open quotation mark.
    """
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise InputError(f"--command {command!r} cannot be read: {error}.") from error
    if not words:
        raise InputError("--command needs the name of a program.")
    return words


def run_program(words: list[str], lines: Iterable[str], timeout: float) -> Ended:
    """Runs a program to its end.

    Args:
        words: The program and its arguments.
        lines: Of its standard input.
        timeout: Seconds after which it is stopped.

    Raises:
        InputError: There is no such program.
    """
    with tempfile.TemporaryFile("w+", encoding="utf-8") as given:
        given.writelines(f"{line}\n" for line in lines)
        given.seek(0)
        try:
            process = subprocess.Popen(  # noqa: S603 - running the user's program is what this is for
                words, stdin=given, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
            )
        except OSError as error:
            raise InputError(f"--command: {words[0]} cannot be run: {error.strerror}.") from error
    assert process.stdout is not None  # noqa: S101 - for the type checker
    assert process.stderr is not None  # noqa: S101
    output = _Kept(process.stdout, _MOST_OUTPUT, lambda: _kill(process))
    errors = _Kept(process.stderr, _KEPT_ERRORS)
    late = False
    end = time.monotonic() + timeout
    try:
        process.wait(timeout)
        for kept in (output, errors):  # something that it started may still hold them open
            kept.join(max(end - time.monotonic(), 0.0))
    except subprocess.TimeoutExpired:
        late = True
    finally:
        _kill(process)  # also what it has started itself
        process.wait()
    output.join(1.0)
    errors.join(1.0)
    return Ended(output.text, _failure(process.returncode, late, output.overflowed, errors.text, timeout), late)


class _Kept(Thread):
    """Reads a stream to its end and keeps the beginning."""

    def __init__(self, stream: IO[bytes], most: int, overflow: Callable[[], None] = lambda: None) -> None:
        super().__init__(daemon=True)
        self._stream, self._most, self._overflow = stream, most, overflow
        self._parts: list[bytes] = []
        self._size = 0
        self.overflowed = False
        self.start()

    def run(self) -> None:
        with self._stream:
            while part := self._stream.read1(_AT_ONCE):  # pyright: ignore[reportAttributeAccessIssue]
                if self._size < self._most:
                    self._parts.append(part)
                    self._size += len(part)
                elif not self.overflowed:
                    self.overflowed = True
                    self._overflow()

    @property
    def text(self) -> str:
        return b"".join(self._parts).decode("utf-8", errors="replace")


def _kill(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def _failure(code: int, late: bool, overflowed: bool, errors: str, timeout: float) -> str:
    if overflowed:
        return f"writes more than {_MOST_OUTPUT >> 20} MiB"
    if late:
        return f"has not ended after {timeout:g} s and was stopped"
    if code < 0:
        return f"crashed with signal {_signal_name(-code)}"
    said = errors.strip().splitlines()
    if code:
        return f"ended with exit code {code}" + (f" and said: {printable(said[-1][:200])}" if said else "")
    return ""


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
    try:
        return Ended(path.read_text(encoding="utf-8", errors="replace"), "")
    except OSError as error:
        return Ended("", f"cannot be read: {path}: {error.strerror}")
