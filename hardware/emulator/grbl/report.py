"""Output of an emulated GRBL controller (report.c), without line ends."""

from .gcode import Modal
from .motion import BLOCKS, Vector

_INCH_MM = 25.4
_HELP = {"Grbl": "['$' for help]", "GrblHAL": "['$' or '$HELP' for help]"}
_BUSY = frozenset({"Home", "Run", "Hold:0", "Hold:1", "Jog"})

PRESSED = "[MSG:Check Limits]"
LOCKED = "[MSG:'$H'|'$X' to unlock]"
UNLOCKED = "[MSG:Caution: Unlocked]"
ENABLED = "[MSG:Enabled]"
DISABLED = "[MSG:Disabled]"
DOOR = "[MSG:Check Door]"
CRITICAL = "[MSG:Reset to continue]"
SLEEPING = "[MSG:Sleeping]"
PROGRAM_END = "[MSG:Pgm End]"
HELP = "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]"


def banner(firmware: str, version: str) -> str:
    """Banner printed after every start."""
    return f"\r\n{firmware} {version} {_HELP.get(firmware, _HELP['Grbl'])}"


def build_info(version: str, receive_bytes: int) -> list[str]:
    """Output of `$I`."""
    return [f"[VER:{version}.20190830:]", f"[OPT:V,{BLOCKS},{receive_bytes}]"]


def parser_state(modal: Modal) -> str:
    """Output of `$G`."""
    units, distance = 20 if modal.inches else 21, 90 if modal.absolute else 91
    return f"[GC:G{modal.motion} G54 G17 G{units} G{distance} G94 M5 M9 T0 F{modal.feed_mm_min:.0f} S0]"


def offsets(work_mm: Vector, *, inches: bool) -> list[str]:
    """Output of `$#`; the only offset is that of G54."""
    zero = vector((0.0, 0.0, 0.0), inches=inches)
    places = dict.fromkeys(("G54", "G55", "G56", "G57", "G58", "G59", "G28", "G30", "G92"), zero)
    places["G54"] = vector(work_mm, inches=inches)
    return [*(f"[{name}:{place}]" for name, place in places.items()), f"[TLO:{zero.split(',')[0]}]", f"[PRB:{zero}:0]"]


def vector(place_mm: Vector, *, inches: bool) -> str:
    """Three coordinates, with 3 decimals in millimetres or 4 in inches."""
    return ",".join(f"{mm / _INCH_MM:.4f}" if inches else f"{mm:.3f}" for mm in place_mm)


class Counters:
    """Counters for the occasional fields of status reports."""

    def __init__(self) -> None:
        self._offset = self._override = 0

    def due(self, state: str) -> tuple[bool, bool]:
        """Whether the next report has WCO, and whether it has Ov: every 30th and 20th when busy, else every 10th."""
        offset_due = self._offset == 0
        self._offset = (30 if state in _BUSY else 10) - 1 if offset_due else self._offset - 1
        if offset_due and self._override == 0:
            self._override = 1
        override_due = self._override == 0
        self._override = (20 if state in _BUSY else 10) - 1 if override_due else self._override - 1
        return offset_due, override_due


def status(
    state: str,
    machine_mm: Vector,
    offset_mm: Vector,
    *,
    speed_mm_s: float,
    room: tuple[int, int],
    pressed: str,
    mask: int,
    inches: bool,
    due: tuple[bool, bool],
) -> str:
    """A status report.

    Args:
        state: First field.
        machine_mm: Position in machine coordinates.
        offset_mm: Work zero in machine coordinates.
        speed_mm_s: Speed.
        room: Free lines of the planner and free bytes of the receive buffer.
        pressed: Letters of the limit switches that are pressed.
        mask: `$10`, bit 0 for machine instead of work coordinates, bit 1 for `Bf`.
        inches: Whether lengths are inches.
        due: Whether it has WCO, and whether it has Ov.
    """
    x, y, z = (mm - offset for mm, offset in zip(machine_mm, offset_mm, strict=True))
    name, place = ("MPos", machine_mm) if mask & 1 else ("WPos", (x, y, z))
    feed = speed_mm_s * 60 / (_INCH_MM if inches else 1.0)
    fields = [state, f"{name}:{vector(place, inches=inches)}"]
    fields += [f"Bf:{room[0]},{room[1]}"] if mask & 2 else []
    fields += [f"FS:{feed:.{int(inches)}f},0"]
    fields += [f"Pn:{pressed}"] if pressed else []
    fields += [f"WCO:{vector(offset_mm, inches=inches)}"] if due[0] else []
    fields += ["Ov:100,100,100"] if due[1] else []
    return f"<{'|'.join(fields)}>"
