"""Simulated rig for live use: taps and moves."""

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError, check_numbers
from ...models.preprocessing import Preprocessing
from ...models.taps import RIG_UNIT
from ..sensor import clipped_move
from .physics import taxel_positions_mm
from .session import TapStream
from .settings import RigSettings, settings_of
from .signal_chain import Purpose


class SimulatedRig:
    """A `TouchSensor` at any continuous position, with the gains and mounting that `simulate_session` gives a session.

    Its noise is independent of that of the data collection. The high-pass filter remembers the previous position for a
    few seconds; recordings, made in steps of 0.05 mm, contain no such jumps. The rig therefore makes `settling_taps`
    unrecorded taps after each change of position, as the operator of a real one would. Thermal drift accumulates as
    long as the rig taps; a new `run` starts without it.

    >>> rig = SimulatedRig("paper", seed=4, session=1, position_mm=2.5, what=1)
    >>> rig.tap().shape, rig.move(-5), rig.position_mm, rig.room
    ((50, 12), -2, 0.5, (0, 15))

    Args:
        settings: Settings of the rig, or the name of a preset.
        seed: Seed of the data set.
        session: Session that sets gains and mounting.
        position_mm: First position.
        what: Index of the object.
        run: Number of the run; runs have independent noise.
        settling_taps: Unrecorded taps after each change of position; default: `settings.settling_taps`.
        noise_seed: Seed of the noise; default: `seed`.

    Attributes:
        settings: Settings of the rig.
        position_mm: Current position.
        what: Index of the current object.
        clamped: Number of moves cut short at the end of the range.

    Raises:
        InputError: The preset or the object is unknown, or the position is outside the range.
    """

    def __init__(
        self,
        settings: RigSettings | str,
        seed: int,
        session: int,
        position_mm: float,
        what: int,
        run: int = 0,
        settling_taps: int | None = None,
        noise_seed: int | None = None,
    ) -> None:
        self.settings = settings = settings_of(settings)
        self._stream = TapStream(settings, seed, session, Purpose.LIVE, run, noise_seed)
        self._settling_taps = settings.settling_taps if settling_taps is None else settling_taps
        self.clamped = 0
        self.what = what
        self.place(position_mm)

    @property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing of the taps."""
        return self.settings.preprocessing

    @property
    def step(self) -> float:
        """Length of a step in mm."""
        return self.settings.cell_mm

    @property
    def units(self) -> str:
        """Unit of the samples."""
        return RIG_UNIT

    @property
    def taxel_mm(self) -> NDArray[np.float64]:
        """Places of the taxels in mm, shape (K, 3)."""
        return taxel_positions_mm(self.settings.taxels)

    @property
    def where_index(self) -> int:
        """Index of the current position."""
        return int(self.settings.where_index(self.position_mm))

    @property
    def room(self) -> tuple[int, int]:
        """Steps left to either end of the range."""
        return self.where_index, self.settings.where_classes - 1 - self.where_index

    def place(self, position_mm: float, what: int | None = None) -> None:
        """Sets the position, and the object if given.

        Raises:
            InputError: The position is outside the range, or the object is unknown.
        """
        settings = self.settings
        if not settings.start_mm <= check_numbers(position_mm, "position_mm") <= settings.end_mm:
            raise InputError(
                f"Position {position_mm} mm is outside the range, {settings.start_mm} to {settings.end_mm} mm."
            )
        what = self.what if what is None else what
        if not (isinstance(what, int | np.integer) and 0 <= what < len(settings.rods)):
            raise InputError(f"Unknown object {what!r}; choose 0 to {len(settings.rods) - 1}.")
        self.position_mm = float(position_mm)
        self.what = int(what)
        self._unsettled = self._settling_taps

    def tap(self) -> NDArray[np.float64]:
        """Samples of one tap, shape (J, K)."""
        position = self.settings.spread([self.position_mm] * (self._unsettled + 1))
        self._unsettled = 0
        return self._stream.tap(position, self.what)[-1]

    def move(self, delta: int) -> int:
        """Moves by `delta` positions, at most to the end of the range; returns the steps made."""
        steps = clipped_move(delta, self.room)
        self.clamped += steps != delta
        if steps:
            self.place(self.position_mm + steps * self.settings.cell_mm)
        return steps
