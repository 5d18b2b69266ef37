"""Opens a port that another program may still be using."""

from ..errors import PortBusy
from ..journal import Journal
from .loop import Loop
from .port import Port

BUSY_S = 15.0
"""Time in seconds that a port may stay busy; a modem manager probes a new one for about ten."""
_RETRY_S = 0.5


def open_patiently(port: Port, loop: Loop, journal: Journal) -> None:
    """Opens a port, retrying while another program has it open.

    Raises:
        PortBusy: The other program keeps it open.
        PortError: It cannot be opened.
        RigError: As `Loop.turn`.
    """
    until = loop.now + BUSY_S
    while True:
        try:
            port.open()
            return
        except PortBusy as error:
            if loop.now >= until:
                raise
            journal.event(loop.now, "busy", str(error))
        loop.sleep(_RETRY_S)
