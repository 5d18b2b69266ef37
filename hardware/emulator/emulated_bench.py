"""A whole emulated bench: stage, fingertip, objects, ports and the `rig.toml` that goes with them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from ...models.errors import InputError
from ..link.shared_clock import SharedClock
from ..rig.settings import RigFile, StageSettings
from ..simulator.presets import PRESETS
from ..simulator.settings import RigSettings
from .adapter import Adapter
from .bench import Bench
from .device import Device
from .emulation import Emulation
from .faults import Switches
from .finger import Finger
from .grbl.controller import Controller, ControllerSettings
from .line_array import LineArray
from .link import Link
from .rig_file import SensorKind, emulated_rig
from .skin_board import SkinBoard

_UNHOMED_MM = (-5.0, -5.0, -5.0)
"""Where the machine stands before homing: off the range and away from the objects."""


class EmulatedBench(NamedTuple):
    """Emulated devices in this process.

    Attributes:
        rig: What `rig.toml` says of them.
        emulation: The devices, and the faults to switch on.
        clock: Their time, for the drivers.
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
    switches: Switches | None = None,
) -> Iterator[EmulatedBench]:
    """Emulated devices on ports in a folder, taken away when the block ends.

    Args:
        folder: Where the ports are made; made if needed.
        settings: The simulated finger and its objects.
        seed: The data set: sensor, sessions and all noise.
        session: Session whose gains and mounting hold.
        kind: Which sensor the finger sits behind.
        name: What the rig is called.
        shared_clock: Whether drivers share the emulator's time.
        homed: Whether the stage knows where it is, as it does after homing; else it waits for homing in alarm.
        switches: Faults; default all off.

    Raises:
        InputError: The ports cannot be made, or the finger does not fit to the sensor.
    """
    folder = folder.absolute()
    rig = emulated_rig(folder, settings, kind, name, shared_clock)
    _make(folder)
    switches = switches or Switches(seed)
    controller = Controller(switches, ControllerSettings(homed=homed, start_mm=None if homed else _UNHOMED_MM))
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


class _Place:
    """Where the finger stands in the rig frame at a time."""

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
        raise InputError(f"The folder {folder} cannot be made: {error.strerror}.") from error
