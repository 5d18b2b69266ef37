"""Exchanges with a stage, byte by byte."""

from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.rig.settings import AxisSettings, StageSettings

X = AxisSettings(letter="X", origin_mm=-60.0, low_mm=-1.0, high_mm=17.0, speed_mm_s=20.0)
Y = AxisSettings(letter="Y", origin_mm=-40.0, low_mm=-2.0, high_mm=3.0, speed_mm_s=12.0, direction=-1)
SETTINGS = StageSettings(port="scripted", x=X, y=Y, boot_s=2.0, homing_s=30.0)
VALUES = {1: 255, 10: 1, 13: 0, 20: 1, 21: 1, 22: 1, 23: 0, 27: 1.0}
VALUES |= {first + i: value for first, value in ((100, 250), (110, 3000), (120, 500), (130, 200)) for i in range(3)}
BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
PROTECT = (
    (b"G80G21\n", b"ok\r\n"),
    (b"$G\n", b"[GC:G80 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]\r\nok\r\n"),
)


def report(x_mm=0.0, y_mm=0.0, state="Idle", more=None):
    """A status report of a place in the rig frame, in motion without a speed."""
    more = ("|FS:0,0" if state == "Idle" else "|Ov:100,100,100") if more is None else more
    return f"<{state}|MPos:{X.machine_mm(x_mm):.3f},{Y.machine_mm(y_mm):.3f},0.000{more}>\r\n".encode()


def status(*place, **options):
    return b"?", report(*place, **options), 0.01


def dollar(**changed):
    values = VALUES | {int(name[1:]): value for name, value in changed.items()}
    lines = "".join(f"${number}={value:.3f}\r\n" for number, value in values.items() if value is not None)
    return b"$$\n", lines.encode() + b"ok\r\n"


def jog(x_mm=0.0, y_mm=0.0, feed=1200, answer=b"ok\r\n"):
    """A jog to a place in the rig frame."""
    return f"$J=G53X{X.machine_mm(x_mm):.4f}Y{Y.machine_mm(y_mm):.4f}Z0.0000F{feed}\n".encode(), answer


def back(x_mm=0.0, y_mm=0.0, feed=720, answer=b"ok\r\n"):
    """A jog by a distance in the rig frame."""
    return f"$J=G91X{x_mm:.4f}Y{-y_mm:.4f}Z0.0000F{feed}\n".encode(), answer


class Notes(NoJournal):
    """Keeps events, reports and commands."""

    def __init__(self):
        self.events, self.reports, self.sent = [], [], []

    def event(self, *told, **_):
        self.events.append(told[1])

    def status(self, *told):
        self.reports.append(told[1:])

    def command(self, *told):
        self.sent.append(told[2])


READY = status(), dollar(), status(), *PROTECT, status()
