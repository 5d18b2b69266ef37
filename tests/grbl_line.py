"""A serial line to an emulated controller, and what a real one prints."""

from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.grbl.controller import Controller, ControllerSettings

HOMED = ControllerSettings(homed=True)
BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
UNLOCK = b"[MSG:'$H'|'$X' to unlock]\r\n"
CRITICAL = b"[MSG:Reset to continue]\r\n"
PERIODIC = (b"|WCO:0.000,0.000,0.000", b"|Ov:100,100,100")


class Line:
    """A serial line to a controller, and the time; answers come event by event, as the bench would step them."""

    def __init__(self, settings=HOMED):
        self.switches = Switches()
        self.controller = Controller(self.switches, settings)
        self.now = 10.0
        self.controller.opened(self.now)

    def say(self, data, seconds=0.1):
        self.controller.receive(data, self.now)
        return self.listen(seconds)

    def listen(self, seconds):
        return b"".join(data for _, data in self.timed(seconds))

    def timed(self, seconds):
        """Times and bytes of what comes in the next seconds."""
        end = self.now + seconds
        came = []
        while True:
            due = self.controller.next_event_s()
            assert due >= self.now
            self.now = min(due, end)
            if data := self.controller.step(self.now):
                came.append((self.now, data))
            if due > end:
                return came

    def status(self):
        """A report without the fields that come now and then."""
        report = self.say(b"?", 0.05)
        for field in PERIODIC:
            report = report.replace(field, b"")
        return report.decode()

    def state(self):
        return self.status()[1:].partition("|")[0]

    @property
    def place(self):
        """Where the machine truly stands."""
        x, y, z = (round(mm, 6) for mm in self.controller.position_mm(self.now))
        return x, y, z
