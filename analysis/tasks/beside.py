"""A process that works beside this one, so that its libraries and their loading do not keep this one's Python busy.

It is a fork of this process from before it has threads, and is sent functions with their arguments. What it cannot do,
as it was killed or the arguments cannot be sent, is left to who asks. It ends with this process, however that ends.
"""

import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import IO, Any, NoReturn

type _Warned = list[tuple[str, type[Warning], str, int]]

_SIGNALS = signal.SIGINT, signal.SIGTERM
_TOLD, _DONE, _FAILED = range(3)


class NotDone(Exception):
    """The process is gone, or cannot do what it was asked for."""


class SideProcess:
    """A process that does one thing at a time.

    Args:
        first: What it does before it is asked for anything.

    Raises:
        OSError: It cannot be started.
    """

    def __init__(self, first: Callable[[], object]) -> None:
        (requests, mine), (answered, answers) = os.pipe(), os.pipe()
        # Ctrl-C reaches every process of a terminal's session; what to do about it is decided here alone.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
        try:
            self._process = os.fork()
            if not self._process:
                _live(first, requests, answers, (mine, answered))
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            os.close(requests)
            os.close(answers)
        self._requests, self._answers = os.fdopen(mine, "wb"), os.fdopen(answered, "rb")
        self._turn = threading.Lock()
        self._warned: dict[Any, Any] = {}

    def ask(self, work: Callable[..., Any], *arguments: Any, told: Callable[[Any], object] | None = None) -> Any:
        """Has the process do some work, and returns its result.

        Args:
            work: A function of a module.
            arguments: Its arguments.
            told: Called with what the work tells on its way, by a function that it is given as a further argument.

        Raises:
            NotDone: It is done by nobody yet.
        """
        try:
            sent = pickle.dumps((work, arguments, told is not None))
            with self._turn:
                pickle.dump(sent, self._requests)
                self._requests.flush()
                while True:
                    kind, answer, warned = pickle.load(self._answers)  # noqa: S301 - of our own process
                    if kind != _TOLD:
                        break
                    told(answer)  # pyright: ignore[reportOptionalCall]
        except Exception as error:  # of a class that is sent, or of a pipe
            raise NotDone from error
        if kind == _FAILED:
            raise NotDone
        for one in warned:
            warnings.warn_explicit(*one, registry=self._warned)
        return answer

    def kill(self) -> None:
        """Ends the process, whatever it does."""
        if self._process:
            os.kill(self._process, signal.SIGKILL)
            os.waitpid(self._process, 0)
        self._process = 0

    def close(self) -> None:
        """Ends the process when no thread waits for it any more."""
        self.kill()
        for pipe in (self._requests, self._answers):
            with suppress(OSError):  # of what could not be sent
                pipe.close()


def can_fork() -> bool:
    """Whether a fork of this process is safe: on Linux, without other threads and JAX, which has some."""
    return sys.platform == "linux" and threading.active_count() == 1 and "jax" not in sys.modules


@contextmanager
def side_process(first: Callable[[], object]) -> Iterator[SideProcess | None]:
    """A `SideProcess` that ends with the block; `None` where this process cannot fork."""
    process = None
    if can_fork():
        with suppress(OSError):
            process = SideProcess(first)
    try:
        yield process
    finally:
        if process is not None:
            process.close()


def _live(first: Callable[[], object], requests: int, answers: int, others: tuple[int, ...]) -> NoReturn:
    """The life of the process, with nothing but its two pipes."""
    try:
        os.setsid()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
        nothing = os.open(os.devnull, os.O_RDWR)
        for file in (0, 1, 2):
            os.dup2(nothing, file)
        for file in others:
            os.close(file)
        with os.fdopen(requests, "rb") as asked, os.fdopen(answers, "wb") as tells:
            first()
            _serve(asked, tells)
    finally:
        os._exit(0)


def _serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Does what is asked for until nobody asks any more."""

    def tell(kind: int, answer: Any, warned: _Warned) -> None:
        pickle.dump((kind, answer, warned), answers)
        answers.flush()

    while True:
        sent = pickle.load(requests)  # noqa: S301 - of our own process
        tell(*_answered(sent, lambda told: tell(_TOLD, told, [])))


def _answered(sent: bytes, tell: Callable[[Any], None]) -> tuple[int, Any, _Warned]:
    """Whether there is an answer, the answer, and warnings on the way to it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            work, arguments, tells = pickle.loads(sent)  # noqa: S301 - of our own process
            found = work(*arguments, *([tell] if tells else []))
        except Exception:  # done again by who asks, who is told why it fails
            return _FAILED, None, []
    return _DONE, found, [(str(one.message), one.category, one.filename, one.lineno) for one in caught]
