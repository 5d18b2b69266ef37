"""An emulated stage with a GRBL 1.1 or grblHAL controller, as its port sees it.

Bytes that act at once are picked out of the stream as they arrive, even in the middle of a line; all others wait in the
receive buffer for the firmware's main program.
"""

from ..faults import Switches
from .firmware import Firmware
from .motion import Vector
from .settings import ControllerSettings

__all__ = ["Controller", "ControllerSettings"]

_AS_BUILT = ControllerSettings()
_RESET, _STATUS, _HOLD, _RESUME, _JOG_CANCEL = 0x18, ord("?"), ord("!"), ord("~"), 0x85


class Controller:
    """Bytes in, bytes out, and the place of a machine, all in rig time.

    Args:
        switches: Faults.
        settings: How it is set up.
    """

    def __init__(self, switches: Switches, settings: ControllerSettings = _AS_BUILT) -> None:
        self._switches = switches
        self._firmware = Firmware(switches, settings)
        self._real_time = {
            _RESET: self._firmware.reset,
            _STATUS: self._firmware.ask_status,
            _HOLD: self._firmware.hold,
            _RESUME: self._firmware.resume,
            _JOG_CANCEL: self._firmware.cancel_jog,
        }

    def opened(self, time_s: float) -> None:
        """A program opened the port, which on some boards resets the controller."""
        self._firmware.advance(time_s)
        if self._switches.strikes("reset_on_open", time_s) is not None:
            self._firmware.lose_power()

    def closed(self, time_s: float) -> None:
        """The program closed the port; whatever moves goes on."""
        self._firmware.advance(time_s)

    def receive(self, data: bytes, time_s: float) -> None:
        """Bytes came. Those beyond ASCII that mean nothing are thrown away, feed overrides and the door among them."""
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
        """When it does something next by itself."""
        return self._firmware.next_event_s()

    def step(self, time_s: float) -> bytes:
        """Does all that is due; returns what it sends then."""
        self._firmware.advance(time_s)
        return self._firmware.take_output()

    def position_mm(self, time_s: float) -> Vector:
        """Where the machine truly stands, in machine coordinates, at a time that is not past."""
        return self._firmware.position_mm(time_s)
