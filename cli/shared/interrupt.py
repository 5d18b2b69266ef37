"""Ctrl-C while libraries load."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130  # exit code, as in shells and Typer
TERMINATED = 143
MESSAGE = "solidtouch: interrupted; all files written are complete."


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
