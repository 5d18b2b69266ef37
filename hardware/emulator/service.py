"""Serves an emulated bench over a Unix socket, with a shared clock or in real time.

Requests and answers are JSON objects, one per line. `{"number": 7, "advance": 1.25, "sent": {"/bench/stage": 40}}`
advances time, and `{"number": 8, "order": {"object": 2}}` changes the bench; the answer has the number of its request,
and `error`, a sentence, if it failed. With a shared clock, time stands still between requests.
"""

import select
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import msgspec

from ...models.errors import InputError
from .emulation import Emulation
from .shared_clock import socket_path

_LONGEST_WAIT_S = 0.05
_SEND_S = 1.0
_MOST_LINE_BYTES = 1 << 20


class Service:
    """Answers requests on a socket.

    Args:
        emulation: The bench.
        path: Path of the socket.
        real_time: Whether rig time follows this computer's clock; requests to advance it are then refused.
        after: Called after every request, and in real time after every advance.

    Raises:
        InputError: The path is too long or exists, or another emulator serves there.
    """

    def __init__(
        self, emulation: Emulation, path: Path, real_time: bool = False, after: Callable[[], object] = lambda: None
    ) -> None:
        self._emulation = emulation
        self._path = path
        self._real_time = real_time
        self._after = after
        self._listener = _listen(path)
        self._unread: dict[socket.socket, bytes] = {}
        self._driver: socket.socket | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Serves until `stop` returns True or an exception ends it.

        Args:
            stop: Called about 20 times per second of real time.
        """
        start_s = time.monotonic() - self._emulation.bench.now_s
        while not stop():
            for ready in select.select(self._files(), [], [], self._patience_s(start_s))[0]:
                if ready is self._listener:
                    connection = self._listener.accept()[0]
                    connection.settimeout(_SEND_S)
                    self._unread[connection] = b""
                elif isinstance(ready, socket.socket):
                    self._hear(ready)
            if self._real_time:
                self._emulation.bench.catch_up(time.monotonic() - start_s)
                self._after()

    def close(self) -> None:
        """Closes all connections and removes the socket."""
        for connection in (*self._unread, self._listener):
            connection.close()
        self._unread.clear()
        self._path.unlink(missing_ok=True)

    def _files(self) -> list[socket.socket | int]:
        files: list[socket.socket | int] = [self._listener, *self._unread]
        if self._real_time:  # a terminal without a program always looks readable
            links = (link for link in self._emulation.bench.links if link.is_open)
            files += [file for link in links if (file := link.terminal.fileno()) is not None]
        return files

    def _patience_s(self, start_s: float) -> float:
        if not self._real_time:
            return _LONGEST_WAIT_S
        next_s = min(link.next_event_s() for link in self._emulation.bench.links)
        return min(_LONGEST_WAIT_S, max(0.0, start_s + next_s - time.monotonic()))

    def _hear(self, connection: socket.socket) -> None:
        try:
            data = connection.recv(65536)
            *lines, rest = (self._unread[connection] + data).split(b"\n")
            for line in lines:
                connection.sendall(self.answer(line, connection) + b"\n")
        except OSError:  # it has gone, or does not read
            data, rest = b"", b""
        self._unread[connection] = rest
        if not data or len(rest) > _MOST_LINE_BYTES:
            del self._unread[connection]
            self._driver = None if self._driver is connection else self._driver
            connection.close()

    def answer(self, line: bytes, asker: socket.socket | None = None) -> bytes:
        """Answer to a request; both are one line without its end.

        Only the first client to advance time may do so until it disconnects: if another one advanced it, devices would
        seem silent to the first.
        """
        question: dict[str, Any] = {}
        try:
            question = msgspec.json.decode(line, type=dict[str, Any])
            if "advance" in question and self._driver not in (None, asker):
                answer = {"busy": "another program drives the emulated rig"}
            else:
                answer = self._carry_out(question)
                self._driver = asker if "advance" in question else self._driver
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            answer = {"error": f"Invalid request: {error}."}
        except InputError as error:
            answer = {"error": str(error)}
        self._after()
        return msgspec.json.encode({"number": question.get("number"), **answer})

    def _carry_out(self, question: dict[str, Any]) -> dict[str, Any]:
        match question:
            case {"advance": int() | float()} if self._real_time:
                raise InputError("The emulator runs in real time; its time cannot be advanced.")
            case {"advance": int() | float() as until_s, "sent": dict(sent)}:
                return self._emulation.advance(until_s, msgspec.convert(sent, dict[str, int]))._asdict()
            case {"order": dict(order)}:
                return self._emulation.control(order)
        raise InputError("A request needs advance and sent, or order.")


def check_free(path: Path) -> None:
    """Checks that an emulator can serve at a path.

    Raises:
        InputError: Another emulator serves there, or the path is too long.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        if probe.connect_ex(socket_path(path)) == 0:
            raise InputError(f"{path}: another emulator is running there; stop it or choose another folder.")


def _listen(path: Path) -> socket.socket:
    check_free(path)
    if path.is_socket():
        path.unlink()
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        listener.bind(str(path))
        listener.listen()
    except OSError as error:
        listener.close()
        raise InputError(f"{path}: cannot create the socket: {error.strerror}.") from error
    return listener
