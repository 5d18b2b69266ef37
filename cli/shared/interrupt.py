"""Ctrl-C and SIGTERM: while libraries load, in their callbacks, and as the end of a command."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130  # exit code, as in shells and Typer
TERMINATED = 143
MESSAGE = "solidtouch: interrupted; all files written are complete."
_AGAIN_S = 0.01


@contextmanager
def loading() -> Iterator[None]:
    """Exits at once on Ctrl-C inside the block, in which imports run and nothing is written.

    An exception would be raised inside the library being imported, which may swallow it or abort.
    """
    before = signal.signal(signal.SIGINT, _end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _end(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a signal handler
    print(MESSAGE, file=sys.stderr, flush=True)
    os._exit(INTERRUPTED)


@contextmanager
def terminable() -> Iterator[None]:
    """Makes SIGTERM unwind the program like Ctrl-C, so that rigs stop and files are closed; exit code 143."""
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _terminate(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a signal handler
    raise SystemExit(TERMINATED)


@contextmanager
def repeated() -> Iterator[None]:
    """Repeats a Ctrl-C or SIGTERM that arrives inside a destructor or a callback, such as that of a weak reference.

    Python can only report exceptions there, and the program would run on.
    """
    lost: list[int] = []
    report = sys.unraisablehook

    def hook(unraisable: "sys.UnraisableHookArgs") -> None:
        number = _number(unraisable)
        if number is None:
            report(unraisable)
        else:
            lost[:] = [number]
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)  # raised here, it would be lost again

    before = signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(lost[0]))
    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = report
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _number(unraisable: "sys.UnraisableHookArgs") -> int | None:
    """Signal that an exception stands for; None for other exceptions."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        return signal.SIGINT
    terminated = isinstance(unraisable.exc_value, SystemExit) and unraisable.exc_value.code == TERMINATED
    return signal.SIGTERM if terminated else None
