"""SLCAN adapter on a port: opens the bus, sends and receives frames.

Some adapters do not answer commands (stock CANable firmware), others answer each with a carriage return or a bell; the
answer to `V` distinguishes them.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Literal

from ..errors import NoAnswer, RigError, WrongDevice
from ..journal import Journal
from ..link.loop import Loop, open_patiently
from ..link.port import Port
from .slcan import (
    CLOSE,
    END_LINE,
    OPEN,
    STAMPS_OFF,
    VERSION,
    Bell,
    Done,
    RemoteFrame,
    Reply,
    SlcanDecoder,
    SlcanFrame,
    bit_rate,
    transmit,
)

ANSWER_S = 0.5
"""Timeout in seconds for an answer, which takes milliseconds."""
QUIET_S = 0.2
"""Time in seconds for which stale input is discarded after closing the adapter."""
BUS_KBIT = 1000
_LEAVE_S = 0.02
_NOISE_BYTES = 32


class CanAdapter:
    """A CAN bus behind an SLCAN adapter.

    Args:
        port: Port of the adapter.
        acks: Whether it answers commands; `"auto"` detects it.
        loop: Loop that reads the port.
        journal: Journal for commands.
        on_frame: Called with each frame received and its time.

    Attributes:
        port: Port of the adapter.
        refused: Number of commands refused since `open`.
        frames: Number of frames received since `open`.
    """

    def __init__(
        self,
        port: Port,
        acks: Literal["auto", "none", "strict"],
        loop: Loop,
        journal: Journal,
        on_frame: Callable[[SlcanFrame | RemoteFrame, float], None],
    ) -> None:
        self.port = port
        self.refused = 0
        self.frames = 0
        self._mode = acks
        self._answers = acks == "strict"
        self._loop = loop
        self._journal = journal
        self._on_frame = on_frame
        self._decoder = SlcanDecoder(stamps="never")
        self._answer: Done | Bell | None = None
        self._version: str | None = None

    @property
    def dropped(self) -> int:
        """Number of malformed and overlong lines."""
        return self._decoder.lines.dropped.line_count

    @property
    def is_noise(self) -> bool:
        """Whether bytes arrive, but nothing that an SLCAN adapter sends."""
        return not self.frames and self._decoder.lines.dropped.byte_count + self._decoder.lines.pending >= _NOISE_BYTES

    def open(self) -> None:
        """Opens the port and the bus.

        Raises:
            PortError: The port cannot be opened.
            WrongDevice: The adapter refused a command, or the device is not an adapter.
            NoAnswer: An expected answer did not arrive.
        """
        open_patiently(self.port, self._loop, self._journal)
        self._loop.attach(self.port, self.receive)
        self._write(END_LINE)
        self._write(CLOSE)
        self._loop.sleep(QUIET_S)
        self._forget()
        if self._mode == "auto":
            self._find_out()
        self._command(STAMPS_OFF, "no time stamps (Z0)", optional=self._mode == "auto")
        self._command(bit_rate(BUS_KBIT), f"{BUS_KBIT} kbit/s (S8)")
        self._command(OPEN, "open the bus (O)")

    def transmit(self, frame: SlcanFrame, name: str) -> None:
        """Sends a frame.

        Args:
            frame: The frame.
            name: Name of the command, for messages.

        Raises:
            WrongDevice: The adapter refused it.
            NoAnswer: An expected answer did not arrive.
        """
        self._command(transmit(frame), name)

    def close(self, *last: SlcanFrame) -> None:
        """Sends last frames and closes bus and port; never raises a `RigError`."""
        try:
            with suppress(RigError), self._loop.unguarded():
                if self.port.is_open:
                    for frame in last:
                        self._write(transmit(frame))
                    self._write(CLOSE)
                    self._loop.sleep(_LEAVE_S)
        finally:
            self._loop.detach(self.port)
            self.port.close()

    def receive(self, data: bytes, time_s: float) -> None:
        """Takes bytes from the port."""
        for unit in self._decoder.push(data):
            match unit:
                case SlcanFrame() | RemoteFrame():
                    self.frames += 1
                    self._on_frame(unit, time_s)
                case Done() | Bell():
                    self._answer = unit
                    self.refused += isinstance(unit, Bell)
                case Reply(command="V", text=text):
                    self._version = text
                case _:
                    pass

    def _forget(self) -> None:
        self._decoder = SlcanDecoder(stamps="never")
        self.frames = self.refused = 0
        self._version = None

    def _find_out(self) -> None:
        """Detects whether the adapter answers, by requesting its version."""
        self._answer = None
        self._write(VERSION)
        with suppress(NoAnswer):
            self._loop.wait_for(self._has_spoken, ANSWER_S, "no version")
        self._answers = self._has_spoken()
        found = f"answers, version {self._version}" if self._answers else "does not answer commands"
        self._journal.event(self._loop.now, "adapter", f"{self.port.address}: the adapter {found}.")

    def _has_spoken(self) -> bool:
        return self._version is not None or isinstance(self._answer, Bell)

    def _command(self, data: bytes, name: str, optional: bool = False) -> None:
        self._answer = None
        self._write(data)
        if not self._answers:
            return
        try:
            self._loop.wait_for(lambda: self._answer is not None, ANSWER_S, self._silence(name))
        except NoAnswer as error:
            if self._mode == "strict":
                raise self.noise() if self.is_noise else error from None
            self._answers = False
            self._journal.event(self._loop.now, "adapter", f"{error} Continuing without answers.")
        if isinstance(self._answer, Bell):
            self._refuse(name, optional)

    def _silence(self, name: str) -> str:
        return (
            f"{self.port.address}: the adapter did not answer the command {name!r} within {ANSWER_S:g} s; check "
            f'sensor.baud, or set sensor.acks = "none" if it never answers.'
        )

    def _refuse(self, name: str, optional: bool) -> None:
        sentence = f"{self.port.address}: the adapter refused the command {name!r}."
        if not optional:
            raise self.noise() if self.is_noise else WrongDevice(sentence)
        self._journal.event(self._loop.now, "refused", sentence)

    def noise(self) -> WrongDevice:
        """Error for a port that only sends noise."""
        return WrongDevice(
            f"{self.port.address}: {self._decoder.lines.dropped.byte_count} bytes received, none of them SLCAN; "
            f"this is another device, or sensor.baud is wrong."
        )

    def _write(self, data: bytes) -> None:
        self.port.write(data)
        self._journal.command(self._loop.now, self.port.address, data)
