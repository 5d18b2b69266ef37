"""Ctrl-C while libraries load."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130  # exit code, as shells and Typer have it
TERMINATED = 143
MESSAGE = "solidtouch: interrupted; every file that is there is whole."


@contextmanager
def loading() -> Iterator[None]:
    """Ends the program at once on Ctrl-C, for the seconds in which imports run and nothing is written.

    An exception would be raised somewhere inside the library that is being imported, which may swallow it or abort.
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
    """Has SIGTERM unwind the program as Ctrl-C does, so that a rig comes to rest and files are ended; exit code 143."""
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _terminate(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a signal handler
    raise SystemExit(TERMINATED)
