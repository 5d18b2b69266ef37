"""The clock of emulated devices as their drivers read it, and the connection to the emulator.

The clock stands still while the driver computes. When the driver waits, it reports how many bytes it has written to
each port and until when it waits; the emulator reads those bytes, advances time until a device writes, and reports how
many bytes it wrote. So a run depends neither on the load of the machine nor on delays in the system, and is as fast as
both sides compute.
"""

import select
import socket
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, Self

import msgspec

from ...models.errors import InputError
from ..errors import NoAnswer, PortBusy, PortError, PortLost
from ..link.loop import HostClock
from ..link.port import Port

MOST_PATH_BYTES = 107
"""Longest path of a Unix socket on Linux, in bytes."""
_ANSWER_S = 30.0
_ARRIVAL_S = 0.2
_MOST_WAITING = 4095  # the system does not count further


class Advanced(NamedTuple):
    """Result of advancing time.

    Attributes:
        now_s: Rig time in seconds.
        wrote: Bytes that each device wrote by then, by address of its port; 1 for a lost port.
    """

    now_s: float
    wrote: dict[str, int]


class Connection(Protocol):
    """Connection to emulated devices."""

    def advance(self, until_s: float, sent: Mapping[str, int]) -> Advanced:
        """Advances time until a device writes, at most to `until_s`.

        Args:
            until_s: Rig time in seconds.
            sent: Bytes written to each open port since it was opened, by address.
        """
        ...

    def control(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Executes an order and returns the state; see `emulator/emulation.py`.

        Raises:
            InputError: The order cannot be executed.
        """
        ...


class SharedClock:
    """The clock of emulated devices.

    Args:
        connection: Connection to the devices.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._now = float(connection.control({})["now_s"])
        self._host = HostClock()

    def now(self) -> float:
        """Rig time in seconds."""
        return self._now

    def wait(self, ports: Sequence[Port], until: float) -> None:
        """Waits until a port has bytes or is lost, at most until rig time `until`.

        Raises:
            RigError: The emulator has ended or does not answer.
        """
        files = [file for port in ports if (file := port.fileno()) is not None]
        if len(files) < len(ports) or select.select(files, [], [], 0)[0]:
            return
        self._now, wrote = self._connection.advance(until, {port.address: port.sent for port in ports})
        for port in ports:
            if count := wrote.get(port.address):
                self._await(port, min(count, _MOST_WAITING))

    def control(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Executes an order, such as `{"object": 2}`, and returns the state.

        Raises:
            InputError: The order cannot be executed.
            RigError: The emulator has ended or does not answer.
        """
        return self._connection.control(order)

    def _await(self, port: Port, count: int) -> None:
        """Waits until written bytes have passed through the system, which takes microseconds."""
        limit = self._host.now() + _ARRIVAL_S
        while True:
            self._host.wait([port], limit)
            if port.waiting() >= count or self._host.now() >= limit:
                return


class SocketConnection:
    """Connection to emulated devices in another process.

    Args:
        path: Socket of `solidtouch emulate`, as in `rig.toml`.

    Raises:
        InputError: The path is too long for a socket.
        PortError: No emulator answers there.
    """

    def __init__(self, path: str | Path) -> None:
        self._path = socket_path(path)
        self._number = 0
        self._unread = b""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(_ANSWER_S)
        try:
            self._socket.connect(self._path)
        except OSError as error:
            self._socket.close()
            raise PortError(f"{path}: no emulator answers; start one with `solidtouch emulate`.") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def advance(self, until_s: float, sent: Mapping[str, int]) -> Advanced:
        """Advances time.

        Raises:
            RigError: The emulator has ended or does not answer.
        """
        answer = self._ask({"advance": until_s, "sent": dict(sent)})
        return Advanced(answer["now_s"], answer["wrote"])

    def control(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Executes an order.

        Raises:
            InputError: The order cannot be executed.
            RigError: The emulator has ended or does not answer.
        """
        return self._ask({"order": dict(order)})

    def close(self) -> None:
        """Closes the connection; rig time then stands still."""
        self._socket.close()

    def _ask(self, question: dict[str, Any]) -> dict[str, Any]:
        """Answer to a request; answers to earlier, interrupted requests are skipped."""
        self._number += 1
        try:
            self._socket.sendall(msgspec.json.encode({"number": self._number, **question}) + b"\n")
            while (answer := msgspec.json.decode(self._line()))["number"] != self._number:
                pass
        except TimeoutError as error:
            raise NoAnswer(f"{self._path}: no answer from the emulator for {_ANSWER_S:g} s.") from error
        except (OSError, msgspec.MsgspecError) as error:
            raise PortLost(f"{self._path}: the emulator ended.") from error
        if "busy" in answer:
            raise PortBusy(f"{self._path}: {answer['busy']}.")
        if "error" in answer:
            raise InputError(answer["error"])
        return answer

    def _line(self) -> bytes:
        while b"\n" not in self._unread:
            data = self._socket.recv(65536)
            if not data:
                raise ConnectionResetError
            self._unread += data
        line, _, self._unread = self._unread.partition(b"\n")
        return line


def socket_path(path: str | Path) -> str:
    """The path as text, if short enough for a socket.

    Raises:
        InputError: It is too long for the system.
    """
    size = len(str(path).encode())
    if size > MOST_PATH_BYTES:
        raise InputError(
            f"{path}: a socket path may have at most {MOST_PATH_BYTES} bytes, this one has {size}; use a folder with a "
            f"shorter path."
        )
    return str(path)
