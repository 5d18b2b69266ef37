"""Ctrl-C and SIGTERM: while libraries load, in their callbacks, and as the end of a command."""

import os
import signal
import sys
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from .process import empty, keep_memory, kept, without

INTERRUPTED = 130  # exit code, as in shells and Typer
TERMINATED = 143
MESSAGE = "solidtouch: interrupted; no file is left incomplete."
_AGAIN_S = 0.05
_HAS_TIMER = hasattr(signal, "SIGALRM")
"""Windows lacks it; there an interruption that a library swallows is not repeated."""


@contextmanager
def loading() -> Iterator[None]:
    """Exits at once on Ctrl-C or SIGTERM inside the block, in which imports run and nothing is written.

    An exception would be raised inside the library being imported, which may swallow it or abort. Pandas would load
    pyarrow if it is installed, numba cffi, and SciPy all that NumPy has, for nothing here.
    """
    before = {number: signal.signal(number, _end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with kept(), without("pyarrow", "pandas"), without("cffi", "numba"), empty("numpy.f2py", "scipy"):
            yield
        keep_memory()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a signal handler
    print(MESSAGE, file=sys.stderr, flush=True)
    os._exit(INTERRUPTED if signum == signal.SIGINT else TERMINATED)


class _Interrupted(KeyboardInterrupt):
    """Ctrl-C, as an exception whose end can be seen."""


class _Terminated(SystemExit):
    """SIGTERM, as an exception whose end can be seen."""


@contextmanager
def terminable() -> Iterator[None]:
    """Makes SIGTERM unwind the program like Ctrl-C, so that rigs stop and files are closed; exit code 143."""
    before = signal.signal(signal.SIGTERM, _stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def repeated() -> Iterator[None]:
    """Repeats a Ctrl-C or SIGTERM whose exception is gone though the program runs on.

    Python can only report exceptions in destructors and in callbacks, such as that of a weak reference, and libraries
    swallow some. While files are closed and rigs stop, the exception still exists.
    """
    report = sys.unraisablehook

    def hook(unraisable: "sys.UnraisableHookArgs") -> None:
        if not isinstance(unraisable.exc_value, _Interrupted | _Terminated):
            report(unraisable)

    handlers = {signal.SIGINT: _stop} | ({signal.SIGALRM: _again} if _HAS_TIMER else {})
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    sys.unraisablehook = hook
    try:
        yield
    finally:
        _forget()
        sys.unraisablehook = report
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def ended_by_interrupt() -> Iterator[None]:
    """Ends the block at Ctrl-C; the program goes on behind it."""
    with suppress(KeyboardInterrupt):
        yield
    _forget()


_last: list[tuple[int, Callable[[], BaseException | None]]] = []


def _stop(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a signal handler
    error = _Interrupted() if signum == signal.SIGINT else _Terminated(TERMINATED)
    _last[:] = [(signum, weakref.ref(error))]
    if _HAS_TIMER and signal.getsignal(signal.SIGALRM) is _again:
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S, _AGAIN_S)
    try:
        raise error
    finally:
        del error  # its traceback holds this frame


def _again(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a signal handler
    for number, error in tuple(_last):
        if error() is None:
            _stop(number, frame)


def _forget() -> None:
    _last.clear()
    if _HAS_TIMER:
        signal.setitimer(signal.ITIMER_REAL, 0)
