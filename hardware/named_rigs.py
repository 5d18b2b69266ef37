"""Rigs by name for live commands: `--rig` simulated, recorded or real, placed at one object after another."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.errors import InputError
from ..models.grid import ClassGrid, episode_sessions
from ..models.io.load import load_taps
from ..models.io.recording import naming
from ..models.io.rig_recording import TapLabel
from ..models.preprocessing import Preprocessing
from ..models.seeds import Purpose, generator
from ..models.settings import Missing
from ..models.taps import RIG_UNIT, TapSet
from .journal import Journal, NoJournal
from .replay import ReplayRig
from .sensor import TouchSensor, check_step
from .simulator.physics import taxel_positions_mm
from .simulator.rig import SimulatedRig
from .simulator.session import sensor_seed
from .simulator.settings import RigSettings, preset

if TYPE_CHECKING:
    from .rig.rig import Rig
    from .rig.settings import RigFile


class LabelledRig:
    """A `TouchSensor` with labelled taps, so that a recording of them can be read as a tap set.

    Args:
        rig: Rig, connected.

    Attributes:
        what: Index of the object in the recording; None if unknown, and then taps are not labelled.
    """

    def __init__(self, rig: "Rig") -> None:
        self.what: int | None = None
        self._rig = rig
        self._trial = 0

    @property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing of the taps."""
        return self._rig.preprocessing

    @property
    def step(self) -> float:
        """Length of a step in mm."""
        return self._rig.step

    @property
    def room(self) -> tuple[int, int]:
        """Steps left to either end of the range."""
        return self._rig.room

    def move(self, delta: int) -> int:
        """Moves by `delta` positions, at most to the end of the range; returns the steps made."""
        return self._rig.move(delta)

    def tap(self) -> NDArray[np.float64]:
        """Samples of one tap, shape (J, K)."""
        self._rig.label = {}
        if self.what is not None:
            label = TapLabel(trial=self._trial, what=self.what, where_mm=self._rig.place_mm, session=0)
            self._rig.label = msgspec.to_builtins(label)
        self._trial += 1
        return self._rig.tap()


_ROUNDING = 1e-6  # of a cell
_SIMULATED, _REPLAY, _PRESET, _SESSION = "simulated", "replay:", "paper", 1000  # a session that occurs in no data set


def check_training_taps(keep: bool, rig: str | None) -> None:
    """Checks that `--training-taps` is used with recorded taps only.

    Raises:
        InputError: The rig does not replay a file.
    """
    if keep and not (rig or "").startswith(_REPLAY):
        raise InputError("--training-taps requires --rig replay:FILE.")


def objects(grid: ClassGrid, what: str | None) -> list[str]:
    """Objects of a recording: those of the model, and the named one if it is new."""
    names = [name for members in grid.what_members for name in members]
    new = what is not None and not what.isdecimal() and what not in (*names, *grid.what_name)
    return [*names, what] if new and what is not None else names


class Truth(NamedTuple):
    """True object and position, as far as known.

    Attributes:
        what: Name of the object.
        where: Position in the unit of the grid.
    """

    what: str | None
    where: float | None


class Placed(NamedTuple):
    """A sensor placed at an object.

    Attributes:
        sensor: The sensor.
        truth: Returns the truth at the time of the call.
    """

    sensor: TouchSensor
    truth: Callable[[], Truth]


class PlaceableRig(NamedTuple):
    """A rig that can be placed.

    Attributes:
        name: Printable name.
        place: Places the sensor at an object; takes the number of the episode, counted from 0.
        taxel_mm: Places of the taxels in mm, shape (K, 2) or (K, 3), or `None`.
        units: Unit of the samples; empty if it is not known.
    """

    name: str
    place: Callable[[int], Placed]
    taxel_mm: ArrayLike | None = None
    units: str = ""


type ChosenRig = Callable[[bool, Journal | None], AbstractContextManager[PlaceableRig]]
"""A rig that is checked and not opened, see `choose_rig`."""


class Wish(NamedTuple):
    """Where episodes start; what is not given is random for each episode.

    Attributes:
        start: Position index, or position with unit, such as `"2.3mm"`.
        what: Name of the object, or its index from 0.
        seed: Random seed.
        sensor: Seed of the sensor of a simulated rig; default: `seed`.
    """

    start: str | None
    what: str | None
    seed: int
    sensor: int | None = None

    def place(self, grid: ClassGrid, episode: int) -> float:
        """Initial position of an episode; for a position index, the centre of the class.

        Raises:
            InputError: The start is neither a position index nor a position with unit.
        """
        if self.start is None:
            return float(grid.where_value[generator(self.seed, Purpose.START, episode).integers(grid.L)])
        if re.fullmatch(r"\d+", self.start) and int(self.start) < grid.L:
            return float(grid.where_value[int(self.start)])
        number = re.fullmatch(r"(-?\d+(?:\.\d+)?)\s*([^\d\s.].*)", self.start)
        if number is None or number[2] != grid.where_unit.split(maxsplit=1)[0].rstrip(",;"):
            raise InputError(
                f"--start must be an index from 0 to {grid.L - 1} or a position in {grid.where_unit or 'no unit'}, "
                f"such as {grid.where_label(0).replace(' ', '')}, got {self.start!r}."
            )
        return float(number[1])

    def object(self, names: Sequence[str], episode: int, there: Sequence[int] | None = None) -> int:
        """Index of the object of an episode.

        Args:
            names: Names of all objects.
            episode: Number of the episode, counted from 0.
            there: Indices to draw from; default: all.

        Raises:
            InputError: The object is unknown.
        """
        if self.what is None:
            drawn = generator(self.seed, Purpose.OBJECT, episode)
            return int(drawn.choice(range(len(names)) if there is None else there))
        if self.what in names:
            return list(names).index(self.what)
        if re.fullmatch(r"\d+", self.what) and int(self.what) < len(names):
            return int(self.what)
        raise InputError(
            f"--object must be one of {', '.join(names)} or an index from 0 to {len(names) - 1}, got {self.what!r}."
        )


def choose_rig(
    rig: str,
    grid: ClassGrid,
    wish: Wish,
    fresh: Callable[[TapSet], TapSet] | None = None,
    missing: Missing = "refuse",
) -> ChosenRig:
    """Rig named by `--rig`, checked but not opened.

    Args:
        rig: `simulated`, `simulated:PRESET`, `replay:FILE` or a rig.toml.
        grid: The classes of the model.
        wish: Where episodes start.
        fresh: Selects the recorded taps to use; default: all.
        missing: What to do with recorded samples that are NaN: `"refuse"` or `"drop"` them.

    Returns:
        Opens the rig: whether to home a real stage first and the journal of its events give a context manager, which
        brings it to rest. It raises `RigError` if a device fails, `InputError` if an emulator lacks the object.

    Raises:
        InputError: The rig is unknown or cannot be placed as requested, or as `fresh`.
    """
    if _is_simulated(rig):
        source = _simulated(rig, grid, wish)
    elif rig.startswith(_REPLAY):
        source = _replayed(rig.removeprefix(_REPLAY), grid, wish, fresh, missing)
    elif rig.endswith(".toml"):
        return partial(_real, _checked(rig, grid, wish), grid, wish)
    else:
        raise InputError(f"--rig must be simulated, simulated:PRESET, replay:FILE or a .toml file, got {rig!r}.")
    source.place(0)
    return lambda _home, _journal: nullcontext(source)


def _is_simulated(rig: str) -> bool:
    return rig == _SIMULATED or rig.startswith(f"{_SIMULATED}:")


def sensor_of(rig: str, source: str, seed: int | None) -> tuple[int, str]:
    """Seed of the sensor of a simulated rig, and a warning if it is not that of the training taps.

    Args:
        rig: Name of the rig.
        source: Origin of the training taps, as `TapModel.source`.
        seed: The seed asked for; `None` takes that of the training taps, 0 where it is not known.

    Raises:
        InputError: A seed is asked for, and the rig is not simulated.
    """
    if seed is not None and not _is_simulated(rig):
        raise InputError("--sensor-seed requires --rig simulated.")
    trained = sensor_seed(source)
    used = (trained or 0) if seed is None else seed
    if trained is None or used == trained:
        return used, ""
    return used, (
        f"Warning: the model was trained on taps of the simulated sensor of seed {trained}, and this rig has the one "
        f"of seed {used}; expect wrong answers."
    )


def _simulated(rig: str, grid: ClassGrid, wish: Wish) -> PlaceableRig:
    name = rig.partition(":")[2] or _PRESET
    settings = _stepping(preset(name), grid)
    check_step(settings.cell_mm, grid, f"The simulated rig {name}")
    names = [rod.name for rod in settings.rods]

    def place(episode: int) -> Placed:
        what = wish.object(names, episode)
        finger = wish.seed if wish.sensor is None else wish.sensor
        start_mm = wish.place(grid, episode)
        sensor = SimulatedRig(settings, finger, _SESSION, start_mm, what, episode, noise_seed=wish.seed)
        return Placed(sensor, lambda: Truth(names[what], sensor.position_mm))

    return PlaceableRig(f"simulated rig, preset {name}", place, taxel_positions_mm(settings.taxels), RIG_UNIT)


def _replayed(
    path: str, grid: ClassGrid, wish: Wish, fresh: Callable[[TapSet], TapSet] | None, missing: Missing
) -> PlaceableRig:
    taps = load_taps(path, missing)
    if fresh is not None:
        with naming(path):
            taps = fresh(taps)
    known = {name for members in grid.what_members for name in members}
    new = [name for name in taps.what_name if name not in known]
    # Objects that the model does not know stand behind those that it does: perception should call them unknown.
    whole = replace(grid, what_members=(*grid.what_members, *((name,) for name in new)), what_value=None)
    names = whole.what_name
    where, held = taps.indices(whole)
    apart, inside = episode_sessions(where, held, taps.session).any(), where >= 0
    there = np.unique(held[inside & (held >= 0)]).tolist()
    if not there:
        raise InputError(f"{path}: no tap belongs to a class of the model.")

    def place(episode: int) -> Placed:
        start = int(whole.where_index(wish.place(grid, episode)))
        if start < 0:
            raise InputError(f"--start {wish.start} is outside the classes of the model.")
        what = wish.object(names, episode, there)
        chance = generator(wish.seed, Purpose.REPLAY, episode)
        sessions = np.unique(taps.session[inside & (held == what)]).tolist()
        session = sessions[int(chance.integers(len(sessions)))] if apart and sessions else None
        sensor = ReplayRig(taps, whole, start, what, chance, session=session)
        return Placed(sensor, lambda: Truth(names[what], float(grid.where_value[sensor.where_index])))

    return PlaceableRig(f"taps of {Path(path).name}", place, taps.taxel_mm, taps.units)


def _checked(rig: str, grid: ClassGrid, wish: Wish) -> "RigFile":
    """Settings of a real rig that can be placed as requested."""
    from .rig.settings import load_rig  # noqa: PLC0415 - other rigs do without devices

    settings = load_rig(rig)
    check_step(settings.range.cell_mm, grid, settings.name)
    if grid.where_place is not None:
        raise InputError(f"{settings.name} moves along a line, but the positions of the model are places in a plane.")
    if grid.where_unit.split(maxsplit=1)[:1] != ["mm"]:
        raise InputError(f"{settings.name} moves in mm, but the positions of the model are in {grid.where_unit!r}.")
    start_mm, limits = wish.place(grid, 0), settings.range
    if not limits.start_mm <= start_mm <= limits.end_mm:
        raise InputError(
            f"{start_mm:g} mm is outside the range of {settings.name}, {limits.start_mm:g} to {limits.end_mm:g} mm."
        )
    if settings.emulator is None:
        wish.object(grid.what_name, 0)
    return settings


@contextmanager
def _real(
    settings: "RigFile", grid: ClassGrid, wish: Wish, home: bool, journal: Journal | None
) -> Iterator[PlaceableRig]:
    from .rig.open_rig import connected, unconnected  # noqa: PLC0415

    table = objects(grid, wish.what)
    journal = journal or NoJournal()
    with unconnected(settings, journal) as sensor:
        _object(sensor, grid, wish, 0)  # before anything moves
        with connected(sensor, home):
            labelled = LabelledRig(sensor)

            def place(episode: int) -> Placed:
                sensor.go(wish.place(grid, episode))
                what = _object(sensor, grid, wish, episode)
                if what is not None:
                    if sensor.emulator is not None:
                        sensor.emulator.control({"object": what})
                    journal.event(sensor.loop.now, "object", f"the finger is above {what}", name=what)
                labelled.what = None if what is None else table.index(what)
                return Placed(labelled, lambda: Truth(what, sensor.place_mm))

            yield PlaceableRig(settings.name, place, settings.sensor.positions_mm or None, RIG_UNIT)


def _object(sensor: "Rig", grid: ClassGrid, wish: Wish, episode: int) -> str | None:
    """Name of the object of an episode: one of the emulator, or that of `--object`.

    Raises:
        InputError: The object is unknown.
    """
    if sensor.emulator is None:
        return None if wish.what is None else grid.what_members[wish.object(grid.what_name, episode)][0]
    there = sensor.emulator.control({})["objects"]
    new = [name for name in there if grid.what_index([name])[0] < 0]  # perception should answer `unknown`
    what = wish.object([*grid.what_name, *new], episode, range(grid.M))
    return grid.what_members[what][0] if what < grid.M else new[what - grid.M]


def _stepping(settings: RigSettings, grid: ClassGrid) -> RigSettings:
    """Settings of a simulated rig with the steps of a finer grid, if the rig supports them."""
    steps = np.diff(grid.where_value)
    if not len(steps) or np.ptp(steps) > _ROUNDING * steps[0] or settings.position_spread_mm < settings.cell_mm:
        return settings
    cells = settings.cell_mm / steps[0]
    if round(cells) < 2 or abs(cells - round(cells)) > _ROUNDING * cells:
        return settings
    step = settings.cell_mm / round(cells)
    return replace(settings, cell_mm=step, position_spread_mm=step)
