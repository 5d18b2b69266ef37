"""What an emulated bench does, in lines for whoever watches it."""

from collections import Counter
from collections.abc import Callable

from ..rig.settings import TapSettings
from .emulation import Emulation

_EVERY_S = 0.02
_STILL_MM = 0.005
_LEAST_MM = 0.05


class Narrator:
    """Tells taps, moves, objects and faults of an emulated bench.

    Args:
        emulation: The bench.
        tap: Where the finger is clear of the objects.
        say: Takes a line.
    """

    def __init__(self, emulation: Emulation, tap: TapSettings, say: Callable[[str], object]) -> None:
        self._emulation = emulation
        self._clear_mm = tap.clear_mm
        self._say = say
        self._looked_s = 0.0
        self._last = self._rest = emulation.place_mm
        self._deepest_mm = self._rest[1]
        self._what = emulation.finger.what
        self._struck: Counter[str] = Counter()

    def look(self) -> None:
        """Tells what happened since the last look; called at least after every advance of time."""
        emulation = self._emulation
        if emulation.finger.what != self._what:
            self._what = emulation.finger.what
            self._tell("no object" if self._what is None else f"object {emulation.objects[self._what]}")
        struck = emulation.switches.tally()
        for name in struck - self._struck:
            self._tell(f"fault {name}, {struck[name]} so far")
        self._struck = struck
        if emulation.bench.now_s - self._looked_s >= _EVERY_S:
            self._looked_s = emulation.bench.now_s
            self._follow(emulation.place_mm)

    def _follow(self, place_mm: tuple[float, float]) -> None:
        still = max(abs(a - b) for a, b in zip(place_mm, self._last, strict=True)) < _STILL_MM
        self._last = place_mm
        self._deepest_mm = max(self._deepest_mm, place_mm[1])
        if not still:
            return
        (x, y), (old_x, old_y), deepest = place_mm, self._rest, self._deepest_mm
        self._rest, self._deepest_mm = place_mm, y
        if abs(x - old_x) < _LEAST_MM and deepest - max(y, old_y) > _LEAST_MM and y <= self._clear_mm + _LEAST_MM:
            self._tell(f"tap at x = {x:z.2f} mm, y up to {deepest:z.2f} mm")
        elif max(abs(x - old_x), abs(y - old_y)) >= _LEAST_MM:
            self._tell(f"moved to x = {x:z.2f}, y = {y:z.2f} mm")

    def _tell(self, line: str) -> None:
        self._say(f"{self._emulation.bench.now_s:9.2f} s  {line}")
