"""State of a GRBL controller from its messages: answers, reports, settings and errors."""

from collections.abc import Callable
from dataclasses import dataclass

from ..errors import StageAlarm, StageFault
from . import grbl
from .grbl import (
    Alarm,
    Banner,
    Error,
    Feedback,
    GrblDecoder,
    GrblSetting,
    Ok,
    State,
    StatusReport,
    Unit,
    Unknown,
    Vector,
)

_HEARD = 40

Note = Callable[[str, str], None]
"""Takes the kind of an event and its description."""


@dataclass
class StageCounts:
    """Counts of faults so far.

    Attributes:
        resets: Restarts of the controller by itself.
        alarms: Alarms.
        refused: Commands answered with an error.
        unanswered: Commands without an answer.
        extra_answers: Unexpected answers.
        silent_polls: Status requests without a report.
        false_idle: Reports of Idle before the motion had ended.
        unknown: Readable lines of unknown form, such as an interrupted status report.
        dropped: Noisy or overlong lines.
    """

    resets: int = 0
    alarms: int = 0
    refused: int = 0
    unanswered: int = 0
    extra_answers: int = 0
    silent_polls: int = 0
    false_idle: int = 0
    unknown: int = 0
    dropped: int = 0


class ControllerState:
    """Decodes the bytes of a controller and keeps its state.

    Args:
        address: Port, for messages.
        note: Called with noteworthy events.
        on_status: Called with every status report.

    Attributes:
        counts: Counts of faults so far.
        trouble: Error that stopped the controller, until it is cleared.
        booting: Whether restarts and alarms are expected.
        banner: Welcome message of the last restart, None if there was none.
        starts: Number of welcome messages so far.
        modes: Answer to `$G`, its words.
        values: Answer to `$$`, values by number.
        status: Last status report, None before the first.
        reports: Number of status reports so far.
        machine: Machine position in mm from the last report, None if unknown.
        asking: Whether an answer is expected; any other is counted and dropped.
        answer: The expected answer, once received.
        heard: Last readable line that no GRBL controller sends.
    """

    def __init__(self, address: str, note: Note, on_status: Callable[[StatusReport], None]) -> None:
        self.counts = StageCounts()
        self._address = address
        self._note = note
        self._on_status = on_status
        self.forget()

    def forget(self) -> None:
        """Resets the state, as when the port is opened; keeps the counts."""
        self.trouble: StageFault | None = None
        self.booting = True
        self.banner: Banner | None = None
        self.starts = self.reports = 0
        self.modes: frozenset[str] = frozenset()
        self.values: dict[int, float] = {}
        self.status: StatusReport | None = None
        self.machine: Vector | None = None
        self.asking = False
        self.answer: Ok | Error | None = None
        self.heard: str | None = None
        self._decoder = GrblDecoder()
        self._offset: Vector | None = None

    @property
    def noise(self) -> bool:
        """Whether bytes were received that no GRBL controller sends."""
        dropped = self._decoder.lines.dropped
        return self.heard is not None or bool(dropped.line_count or self._decoder.lines.pending)

    def receive(self, data: bytes, _: float) -> None:
        """Takes bytes from the port."""
        noise = self._decoder.lines.dropped.line_count
        for unit in self._decoder.push(data):
            self._take(unit)
        self.counts.dropped += self._decoder.lines.dropped.line_count - noise

    def _take(self, unit: Unit) -> None:
        match unit:
            case Ok() | Error():
                self._take_answer(unit)
            case StatusReport():
                self._take_status(unit)
            case Banner():
                self._take_banner(unit)
            case Alarm(code):
                self._alarm(code)
            case GrblSetting(number, value):
                self.values[number] = value
            case Feedback("GC", text):
                self.modes = frozenset(text.split())
            case Feedback("MSG", "Caution: Unlocked") if not self.booting and self.trouble is None:
                self.trouble = StageFault(
                    f"{self._address}: the controller was unlocked without homing, so the position is unknown; home it."
                )
                self._note("unlocked", str(self.trouble))
            case Unknown(text):
                self.counts.unknown += 1
                self.heard = text[:_HEARD]
                self._note("unknown", f"{self._address}: the controller sent {self.heard!r}.")
            case Feedback(kind, text):
                self._note("message", f"{self._address}: message of the controller: {kind}: {text}.")

    def _take_answer(self, answer: Ok | Error) -> None:
        if self.asking and self.answer is None:
            self.answer = answer
            return
        self.counts.extra_answers += 1
        self._note("extra answer", f"{self._address}: unexpected answer {answer}.")

    def _take_status(self, status: StatusReport) -> None:
        self._offset = status.offset or self._offset
        self.machine = status.machine
        if status.work is not None and self._offset is not None:
            x, y, z = (work + offset for work, offset in zip(status.work, self._offset, strict=True))
            self.machine = x, y, z
        self.status = status
        self.reports += 1
        if status.state is State.ALARM:
            self._alarm(status.substate)
        self._on_status(status)

    def _take_banner(self, banner: Banner) -> None:
        self.banner = banner
        self.starts += 1
        self.answer = self._offset = self.machine = None
        name = f"{banner.firmware} {banner.version}"
        if self.booting or isinstance(self.trouble, StageAlarm):  # GRBL restarts by itself when homing fails
            self._note("start", f"{self._address}: {name} started.")
            return
        self.counts.resets += 1
        self.trouble = StageFault(
            f"{self._address}: the controller restarted by itself ({name}), so the position is unknown; check its "
            f"power supply, then home it."
        )
        self._note("reset", str(self.trouble))

    def _alarm(self, code: int | None) -> None:
        if self.booting or isinstance(self.trouble, StageAlarm):
            return
        self.counts.alarms += 1
        name = "an alarm" if code is None else f"ALARM:{code}"
        why = f", {grbl.ALARMS[code]}" if code in grbl.ALARMS else ""
        lost = ", and lost its position" if code in grbl.POSITION_LOST else ""
        self.trouble = StageAlarm(
            f"{self._address}: the controller stopped with {name}{why}{lost}; clear its path, then home it.", code
        )
        self._note("alarm", str(self.trouble))
