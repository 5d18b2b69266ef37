"""A process that draws figures, so that neither matplotlib nor its loading keeps this process's Python busy.

It is a fork of this process from before it has threads, and is sent functions with their arguments. What it cannot
draw, as it was killed or the arguments cannot be sent, is drawn here. It ends with this process, however that ends.
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


class NotDrawn(Exception):
    """The process is gone, or cannot draw a figure."""


class DrawingProcess:
    """A process that draws one figure at a time.

    Raises:
        OSError: It cannot be started.
    """

    def __init__(self) -> None:
        (requests, mine), (answered, answers) = os.pipe(), os.pipe()
        # Ctrl-C reaches every process of a terminal's session; what to do about it is decided here alone.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
        try:
            self._process = os.fork()
            if not self._process:
                _live(requests, answers, (mine, answered))
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            os.close(requests)
            os.close(answers)
        self._requests, self._answers = os.fdopen(mine, "wb"), os.fdopen(answered, "rb")
        self._turn = threading.Lock()
        self._warned: dict[Any, Any] = {}

    def draw(self, draw: Callable[[], Any]) -> tuple[int, bytes, float, Any] | None:
        """Draws a figure: its number, SVG, width in inches and curves, or `None` where there is nothing to draw.

        Raises:
            NotDrawn: It is drawn by nobody yet.
        """
        return self._ask(draw)

    def png(self, number: int) -> bytes:
        """A figure that it drew, in pixels.

        Raises:
            NotDrawn: The process is gone.
        """
        return self._ask(number)

    def _ask(self, request: Any) -> Any:
        try:
            sent = pickle.dumps(request)
            with self._turn:
                pickle.dump(sent, self._requests)
                self._requests.flush()
                drawn, answer, warned = pickle.load(self._answers)  # noqa: S301 - of our own process
        except Exception as error:  # of a class that is sent, or of a pipe
            raise NotDrawn from error
        if not drawn:
            raise NotDrawn
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
def drawing_process() -> Iterator[DrawingProcess | None]:
    """A `DrawingProcess` that ends with the block; `None` where this process cannot fork."""
    process = None
    if can_fork():
        with suppress(OSError):
            process = DrawingProcess()
    try:
        yield process
    finally:
        if process is not None:
            process.close()


def _live(requests: int, answers: int, others: tuple[int, ...]) -> NoReturn:
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
        with os.fdopen(requests, "rb") as asked, os.fdopen(answers, "wb") as told:
            _serve(asked, told)
    finally:
        os._exit(0)


def _serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Draws what is asked for until nobody asks any more."""
    from .figure_style import Drawing, draw_nothing, drawn  # noqa: PLC0415 - the process that asks needs it later

    draw_nothing()
    drawings: list[Drawing] = []

    def answer(request: Any) -> Any:
        if isinstance(request, int):
            return drawings[request].png()
        drawing = drawn(request)
        if drawing is None:
            return None
        drawings.append(drawing)
        return len(drawings) - 1, drawing.svg, drawing.inches, drawing.curves

    while True:
        sent = pickle.load(requests)  # noqa: S301 - of our own process
        pickle.dump(_answered(answer, sent), answers)
        answers.flush()


def _answered(answer: Callable[[Any], Any], sent: bytes) -> tuple[bool, Any, _Warned]:
    """Whether there is an answer, the answer, and warnings on the way to it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = answer(pickle.loads(sent))  # noqa: S301 - of our own process
        except Exception:  # drawn again by who asks, who is told why it fails
            return False, None, []
    return True, found, [(str(one.message), one.category, one.filename, one.lineno) for one in caught]
