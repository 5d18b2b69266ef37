"""Operators that change the objects of a data collection: a person at the terminal, or the emulator."""

import os
import select
import sys
from collections.abc import Callable
from contextlib import suppress

from ...hardware.emulator.shared_clock import Connection
from ...hardware.recording.plan import ObjectSettings
from ...models.errors import InputError
from ...models.extras import posix

with posix("A rig"):
    import termios


class Person:
    """Asks on the terminal and waits for Enter.

    Args:
        say: Prints a line.
        file: File descriptor from which Enter is read; default: standard input.
    """

    def __init__(self, say: Callable[[str], object], file: int | None = None) -> None:
        self._say = say
        self._file = sys.stdin.fileno() if file is None else file

    def place(self, what: int, thing: ObjectSettings) -> None:  # noqa: ARG002 - the interface of an operator
        """Asks for an object; discards earlier input."""
        with suppress(termios.error, OSError):  # not a terminal
            termios.tcflush(self._file, termios.TCIFLUSH)
        self._say(f"Put the {thing.name} under the finger, take your hands away and press Enter.")

    def ready(self) -> bool:
        """Whether Enter was pressed.

        Raises:
            InputError: The input ended.
        """
        if not select.select([self._file], [], [], 0)[0]:
            return False
        typed = os.read(self._file, 1)
        if not typed:
            raise InputError("Standard input ended before Enter was pressed; run this command in a terminal.")
        return typed == b"\n"


class Emulator:
    """Lets the emulator change the object.

    Args:
        connection: Connection to the emulator.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def place(self, what: int, thing: ObjectSettings) -> None:  # noqa: ARG002 - the interface of an operator
        """Changes the object, named as in the emulator.

        Raises:
            InputError: The emulator has no object of that name.
            RigError: The emulator does not answer.
        """
        self._connection.control({"object": thing.name})

    def ready(self) -> bool:
        """Always True."""
        return True
