"""Who changes the objects of a data collection: the person at the terminal, or the emulator."""

import os
import select
import sys
import termios
from collections.abc import Callable
from contextlib import suppress

from ...hardware.link.shared_clock import Connection
from ...hardware.recording.plan import ObjectSettings
from ...models.errors import InputError


class Person:
    """Asks on the terminal and goes on when Enter is pressed.

    Args:
        say: Prints a line.
        file: Number of the open file that Enter is read from; default standard input.
    """

    def __init__(self, say: Callable[[str], None], file: int | None = None) -> None:
        self._say = say
        self._file = sys.stdin.fileno() if file is None else file

    def place(self, what: int, thing: ObjectSettings) -> None:  # noqa: ARG002 - the interface of an operator
        """Asks for an object; what was typed before does not count."""
        with suppress(termios.error, OSError):  # not a terminal
            termios.tcflush(self._file, termios.TCIFLUSH)
        self._say(f"Put the {thing.name} under the finger, take your hands away and press Enter.")

    def ready(self) -> bool:
        """Whether Enter was pressed.

        Raises:
            InputError: Nobody can press it, as the input ended.
        """
        if not select.select([self._file], [], [], 0)[0]:
            return False
        typed = os.read(self._file, 1)
        if not typed:
            raise InputError("standard input ended while an object was to be changed; someone must press Enter.")
        return typed == b"\n"


class Emulator:
    """Has the emulator change the object.

    Args:
        connection: The way to it.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def place(self, what: int, thing: ObjectSettings) -> None:  # noqa: ARG002 - the interface of an operator
        """Changes the object, which the plan must call as the emulator does.

        Raises:
            InputError: The emulator has no object of that name.
            RigError: The emulator is gone.
        """
        self._connection.control({"object": thing.name})

    def ready(self) -> bool:
        """It always is."""
        return True
