"""Communication with a GRBL controller: one command at a time, status on request, unsolicited messages.

Send-response, as recommended by GRBL: each line is sent after the previous one was answered, so the controller's buffer
of 128 bytes never overflows. An unexpected `ok` is counted and dropped.
"""

from collections.abc import Callable
from contextlib import suppress

from ..errors import (
    CommandRefused,
    NoAnswer,
    PortLost,
    RigError,
    StageAlarm,
    StageFault,
    WriteTimeout,
    WrongDevice,
)
from ..journal import Journal
from ..link.loop import Loop, open_patiently
from ..link.port import Port
from . import grbl
from .grbl import Error, State, StatusReport
from .state import ControllerState

POLL_S = 0.1
"""Time in seconds between two status requests at rest; GRBL recommends at most 10 per second (interface.md)."""
MOVING_POLL_S = 0.03
"""The same in a motion, in which it limits how far a stage strays; a report takes 5 ms of the line."""
SILENT_POLLS = 20
"""Unanswered requests after which the link is dead; a restarting controller may be silent for 1.5 s."""
ANSWER_S = 0.5
"""Timeout in seconds for the answer to a line, which takes milliseconds."""
_KNOCK_S = 0.25
_AT_REST = (State.IDLE, State.ALARM)
_STUCK = {
    State.HOLD: "press its cycle start to finish the motion that it holds, or home it (--home), which drops the motion",
    State.DOOR: "close its safety door and press cycle start, or home it (--home)",
    State.CHECK: "it checks G-code without moving: send $C, or home it (--home)",
    State.SLEEP: "it sleeps: press its reset, or home it (--home)",
}
"""States that only a person or a reset ends, and how."""
_DEAF_S = 1.0  # a reset is ignored while an alarm is printed


def remedy(state: State, otherwise: str = "reset it, then home it") -> str:
    """What a person does to end a state, as a clause."""
    return _STUCK.get(state, otherwise)


class GrblLink:
    """The controller behind a port.

    Args:
        port: Port of the controller.
        loop: Loop that reads the port.
        journal: Journal for commands and events.
        on_status: Called with every status report.

    Attributes:
        port: Port of the controller.
        loop: Loop that reads the port.
        said: State from the controller's messages; every wait raises its `trouble`.
    """

    def __init__(self, port: Port, loop: Loop, journal: Journal, on_status: Callable[[StatusReport], None]) -> None:
        self.port = port
        self.loop = loop
        self._journal = journal
        self.said = ControllerState(port.address, self.note, on_status)
        self._half_line = False
        self._polled_s = -POLL_S

    def open(self) -> None:
        """Opens the port, waiting for another program to release it, and resets the known state.

        Raises:
            PortError: It cannot be opened.
        """
        self.close()
        self.said.forget()
        self._half_line = False
        open_patiently(self.port, self.loop, self._journal)
        self.loop.attach(self.port, self.said.receive)

    def close(self) -> None:
        """Closes the port."""
        self.loop.detach(self.port)
        self.port.close()

    def greet(self, boot_s: float, may_reset: bool = False) -> None:
        """Waits until the controller is at rest and answers `$$`, including its boot if opening the port reset it.

        The first line must not be empty: it would complete a jog that a killed program left incomplete.

        Args:
            boot_s: Timeout in seconds.
            may_reset: Whether to reset a controller that is silent, as after an alarm, or in a state that only a reset
                ends, and wait once more.

        Raises:
            WrongDevice: The device is not a GRBL 1.1 controller.
            StageFault: The controller is busy.
            NoAnswer: Nothing answers.
        """
        until = self.loop.now + boot_s
        while not self._introduced():
            if self.loop.now < until:
                continue
            stuck = self.said.status is not None and self.said.status.state in _STUCK
            if not may_reset or self.said.noise or (self.said.status is not None and not stuck):
                raise self._stranger(boot_s)
            may_reset, until = False, self.loop.now + boot_s
            self.write(grbl.RESET)
        if self.said.banner is not None and not self.said.banner.version.startswith("1.1"):
            raise WrongDevice(f"{self.port.address}: requires GRBL 1.1, the controller has {self.said.banner.version}.")

    def _introduced(self) -> bool:
        """Whether the controller is at rest and has sent its settings; only GRBL 1.1 reports and prints them so."""
        before = self.said.reports + self.said.starts
        self.write(grbl.STATUS)
        if not self.wait(lambda: self.said.reports + self.said.starts > before, _KNOCK_S):
            return False
        self.said.values.clear()
        rests = self.said.status is None or self.said.status.state in _AT_REST
        with suppress(CommandRefused):  # it may complete a line that another program left incomplete
            if self.ask(grbl.SETTINGS) and self.said.values and rests:
                return True
        self.wait(lambda: False, _KNOCK_S)
        return False

    def _stranger(self, boot_s: float) -> RigError:
        if self.said.status is not None and self.said.status.state not in _AT_REST:
            state = self.said.status.state
            return StageFault(
                f"{self.port.address}: the controller must be idle, but was in state {state} for {boot_s:g} s; "
                f"{remedy(state, 'wait until it ends or reset it')}."
            )
        if self.said.noise:
            said = f"sent {self.said.heard!r}" if self.said.heard is not None else "sent noise"
            return WrongDevice(
                f"{self.port.address}: no GRBL controller answers; the device {said}; check the port and its baud rate."
            )
        return NoAnswer(
            f"{self.port.address}: no answer for {boot_s:g} s; the controller is off, on another port, or "
            f"locked by an alarm until its reset button is pressed."
        )

    def write(self, data: bytes) -> None:
        """Sends bytes without waiting.

        Raises:
            PortLost: The port was lost.
            WriteTimeout: The controller may have received them; its position is then unknown until it reports.
        """
        self._journal.command(self.loop.now, self.port.address, data)
        machine, self.said.machine = self.said.machine, None
        try:
            self.port.write(data)
        except WriteTimeout:
            self._half_line = True
            raise
        self.said.machine = machine

    def ask(self, line: bytes, timeout_s: float = ANSWER_S) -> bool:
        """Sends a line; returns whether its `ok` arrived in time.

        If not, the controller may hold an incomplete line, which the next command would extend; a line that cannot
        extend another is then sent first.

        Raises:
            CommandRefused: The answer was an error.
            RigError: The port or the controller failed.
        """
        if self._half_line:
            self._half_line = False
            with suppress(CommandRefused):
                self.ask(grbl.SETTINGS)
        self.loop.turn(self.loop.now)
        self.said.answer, self.said.asking = None, True
        try:
            self.write(line)
            answered = self.wait(lambda: self.said.answer is not None, timeout_s)
        finally:
            self.said.asking = False
        self.said.counts.unanswered += not answered
        self._half_line = not answered
        if isinstance(self.said.answer, Error):
            self.said.counts.refused += 1
            code = self.said.answer.code
            why = f", {grbl.ERRORS[code]}" if code in grbl.ERRORS else ""
            raise CommandRefused(
                f"{self.port.address}: the controller refused {line.decode('ascii').strip()}: error:{code}{why}.",
                code,
            )
        return answered

    def poll(self, after_s: float = POLL_S) -> StatusReport:
        """Next status report.

        Args:
            after_s: Shortest time in seconds since the last request.

        Raises:
            NoAnswer: None arrived.
            RigError: The port or the controller failed.
        """
        for _ in range(SILENT_POLLS):
            self.wait(lambda: False, self._polled_s + after_s - self.loop.now)
            self._polled_s = self.loop.now
            self.said.status = None
            self.write(grbl.STATUS)
            self.wait(lambda: self.said.status is not None, POLL_S)
            if self.said.status is not None:
                return self.said.status
            self.said.counts.silent_polls += 1
        raise NoAnswer(f"{self.port.address}: no answer from the controller to {SILENT_POLLS} status requests.")

    def request(self, after_s: float) -> None:
        """Asks for a status report without waiting, if the last request is at least that many seconds ago."""
        if self.loop.now - self._polled_s >= after_s:
            self._polled_s = self.loop.now
            self.write(grbl.STATUS)

    def restart(self, timeout_s: float) -> None:
        """Resets the controller, the only command that it may accept after an alarm; it then accepts homing.

        Raises:
            NoAnswer: It does not restart in time.
            RigError: The port failed.
        """
        trouble, before, until = self.said.trouble, self.said.starts, self.loop.now + timeout_s
        self.said.trouble, self.said.booting = None, True
        try:
            while self.said.starts == before:
                if self.loop.now >= until:
                    raise NoAnswer(f"{self.port.address}: the controller did not restart in {timeout_s:g} s of resets.")
                self.write(grbl.RESET)
                self.wait(lambda: self.said.starts > before, _DEAF_S)
            self.poll()
        except BaseException:
            self.said.trouble = trouble
            raise
        finally:
            self.said.booting = False

    def halt(self, why: str) -> None:
        """Resets the controller to stop a motion; it then needs homing."""
        self.said.trouble = StageAlarm(f"{self.port.address}: {why}; home it again.")
        self.note("halt", str(self.said.trouble))
        with suppress(RigError):
            self.write(grbl.RESET)

    def wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Runs the loop until a condition holds; returns whether it did in time.

        Raises:
            RigError: The port was lost, the controller failed, or a guard objects.
        """
        until = self.loop.now + timeout_s
        self.check()
        while not condition():
            if self.loop.now >= until:
                return False
            self.loop.turn(until)
            self.check()
        return True

    def check(self) -> None:
        """Raises unsolicited errors of the controller.

        Raises:
            PortLost: The port was lost.
            StageFault: It restarted or stopped with an alarm.
        """
        if self.said.trouble is not None:
            raise self.said.trouble
        if not self.port.is_open:
            raise PortLost(f"{self.port.address}: the port is closed.")

    def note(self, kind: str, text: str) -> None:
        """Records an event in the journal."""
        self._journal.event(self.loop.now, kind, text)
