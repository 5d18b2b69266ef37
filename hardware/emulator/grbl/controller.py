"""Emulated stage with a GRBL 1.1 or grblHAL controller, seen from its port.

Real-time commands are taken from the stream as they arrive, even within a line; all other bytes wait in the receive
buffer for the firmware's main program.
"""

from ..faults import Switches
from .firmware import Firmware
from .motion import Vector
from .settings import ControllerSettings

__all__ = ["Controller", "ControllerSettings"]

_AS_BUILT = ControllerSettings()
_RESET, _STATUS, _HOLD, _RESUME, _DOOR, _JOG_CANCEL = 0x18, ord("?"), ord("!"), ord("~"), 0x84, 0x85


class Controller:
    """Controller and machine, in rig time.

    Args:
        switches: Faults.
        settings: Settings of the controller.
    """

    def __init__(self, switches: Switches, settings: ControllerSettings = _AS_BUILT) -> None:
        self._switches = switches
        self._firmware = Firmware(switches, settings)
        self._real_time = {
            _RESET: self._firmware.reset,
            _STATUS: self._firmware.ask_status,
            _HOLD: self._firmware.hold,
            _RESUME: self._firmware.resume,
            _DOOR: self._firmware.open_door,
            _JOG_CANCEL: self._firmware.cancel_jog,
        }

    def opened(self, time_s: float) -> None:
        """Handles a program opening the port, which resets the controller on some boards."""
        self._firmware.advance(time_s)
        if self._switches.strikes("reset_on_open", time_s) is not None:
            self._firmware.lose_power()

    def closed(self, time_s: float) -> None:
        """Handles the port closing; motion continues."""
        self._firmware.advance(time_s)

    def receive(self, data: bytes, time_s: float) -> None:
        """Takes bytes. Feed, rapid and spindle overrides are discarded; a jog ignores them on a real controller too."""
        self._firmware.advance(time_s)
        for byte in data:
            if byte in b"\r\n?" and self._firmware.runs and self._switches.strikes("brown_out", time_s) is not None:
                self._firmware.lose_power()
            if self._firmware.is_deaf:
                continue
            if (act := self._real_time.get(byte)) is not None:
                act()
            elif byte < 0x80:
                self._firmware.put(byte)
        self._firmware.wake()

    def next_event_s(self) -> float:
        """Time of the next event."""
        return self._firmware.next_event_s()

    def step(self, time_s: float) -> bytes:
        """Handles all events due by this time; returns the bytes to send."""
        self._firmware.advance(time_s)
        return self._firmware.take_output()

    def position_mm(self, time_s: float) -> Vector:
        """True position in machine coordinates, at a time that is not past."""
        return self._firmware.position_mm(time_s)
