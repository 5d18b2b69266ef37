"""Emulated bench: stage, fingertip, objects, ports and the matching `rig.toml`."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from ...models.errors import InputError
from ..rig.settings import RigFile, StageSettings
from ..simulator.settings import PRESETS, RigSettings
from .adapter import Adapter
from .bench import Bench
from .emulation import Emulation
from .faults import Switches
from .finger import Finger
from .grbl.controller import Controller, ControllerSettings
from .line_array import LineArray
from .link import Device, Link
from .rig_file import SensorKind, emulated_rig
from .shared_clock import SharedClock
from .skin_board import SkinBoard

_UNHOMED_MM = (-5.0, -5.0, -5.0)
"""Machine position before homing: outside the range and away from the objects."""
_HOMING_S = 12.0  # GRBL takes 7 to 23 s


class EmulatedBench(NamedTuple):
    """Emulated devices in this process.

    Attributes:
        rig: Their settings, as in `rig.toml`.
        emulation: The devices and their fault switches.
        clock: Clock that the drivers share with them.
    """

    rig: RigFile
    emulation: Emulation
    clock: SharedClock


@contextmanager
def emulated_bench(
    folder: Path,
    settings: RigSettings = PRESETS["paper"],
    *,
    seed: int = 0,
    session: int = 0,
    kind: SensorKind = "icub",
    name: str = "emulated",
    shared_clock: bool = True,
    homed: bool = False,
    place_mm: tuple[float, float] | None = None,
    switches: Switches | None = None,
) -> Iterator[EmulatedBench]:
    """Emulated devices on ports in a folder, removed when the block ends.

    Args:
        folder: Folder of the ports; created if missing.
        settings: The simulated finger and its objects.
        seed: Seed of the data set: sensor, sessions and noise.
        session: Session that sets gains and mounting.
        kind: Type of the sensor electronics.
        name: Name of the rig.
        shared_clock: Whether drivers use the emulator's time.
        homed: Whether the stage is homed; if not, it is in alarm until homed.
        place_mm: Where the finger is in the rig frame; default where homing ends or, if not homed, outside the range.
        switches: Faults; all off by default.

    Raises:
        InputError: The ports cannot be created, or the finger does not match the sensor.
    """
    folder = folder.absolute()
    rig = emulated_rig(folder, settings, kind, name, shared_clock)
    _make(folder)
    switches = switches or Switches(seed)
    start_mm = None if homed else _UNHOMED_MM
    if place_mm is not None:
        start_mm = _machine_mm(rig.stage, place_mm)
    controller = Controller(switches, ControllerSettings(homed=homed, start_mm=start_mm, homing_s=_HOMING_S))
    place = _Place(controller, rig.stage)
    finger = Finger(settings, place, seed, session)
    links: list[Link] = []
    try:
        links.append(Link("stage", Path(rig.stage.port), controller, switches))
        links.append(Link("sensor", Path(rig.sensor.port), _sensor(kind, switches, finger, settings), switches))
        objects = [rod.name for rod in settings.rods]
        emulation = Emulation(Bench(links), switches, finger, place, objects)
        yield EmulatedBench(rig, emulation, SharedClock(emulation))
    finally:
        for link in links:
            link.close()


def _machine_mm(stage: StageSettings, place_mm: tuple[float, float]) -> tuple[float, float, float]:
    """Machine position of a place in the rig frame."""
    machine = dict.fromkeys("XYZ", 0.0)
    for axis, mm in zip((stage.x, stage.y), place_mm, strict=True):
        machine[axis.letter] = axis.machine_mm(mm)
    return machine["X"], machine["Y"], machine["Z"]


class _Place:
    """Position of the finger in the rig frame, by time."""

    def __init__(self, controller: Controller, stage: StageSettings) -> None:
        self._controller = controller
        self._axes = tuple((axis, "XYZ".index(axis.letter)) for axis in (stage.x, stage.y))

    def __call__(self, time_s: float) -> tuple[float, float]:
        machine = self._controller.position_mm(time_s)
        (x, i), (y, j) = self._axes
        return x.rig_mm(machine[i]), y.rig_mm(machine[j])


def _sensor(kind: SensorKind, switches: Switches, finger: Finger, settings: RigSettings) -> Device:
    if kind == "lines":
        return LineArray(switches, finger, settings.rate_hz)
    return Adapter(switches, SkinBoard(switches, finger))


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot create the folder: {error.strerror}.") from error
