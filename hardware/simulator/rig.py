"""The simulated rig, live: stands somewhere, taps there, moves."""

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.preprocessing import Preprocessing
from ..sensor import clipped_move
from .nuisances import Purpose
from .presets import preset
from .settings import RigSettings
from .tap_stream import TapStream


class SimulatedRig:
    """A `TouchSensor` at any continuous position, with the gains and mounting that `simulate_session` gives a session.

    Its noise is its own, so that it never repeats the taps of the data collection. The high-pass filter remembers the
    former place for a few seconds; recordings, made in steps of 0.05 mm, know no such jumps. The rig therefore taps
    `settling_taps` times unrecorded after each change of place, as the operator of a real one would. Thermal
    drift goes on as long as the rig taps; a new `run` starts without it.

    Args:
        settings: The rig, or the name of a preset.
        seed: The data set.
        session: Session whose gains and mounting hold.
        position_mm: Where it stands first.
        what: Index of the rod.
        run: Tells repeated runs with other noise apart.
        settling_taps: Taps not recorded after each change of place; default `settings.settling_taps`.

    Attributes:
        settings: The rig.
        position_mm: Where it stands.
        what: Index of the rod before it.
        clamped: Moves that the end of the range cut short.

    Raises:
        InputError: There is no such preset, or the position or the rod is not on the rig.
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
    ) -> None:
        self.settings = settings = preset(settings) if isinstance(settings, str) else settings
        self._stream = TapStream(settings, seed, session, Purpose.LIVE, run)
        self._settling_taps = settings.settling_taps if settling_taps is None else settling_taps
        self.clamped = 0
        self.place(position_mm, what)

    @property
    def preprocessing(self) -> Preprocessing:
        """How the taps are prepared."""
        return self.settings.preprocessing

    @property
    def where_index(self) -> int:
        """The where class in which it stands."""
        return int(self.settings.where_index(self.position_mm))

    @property
    def room(self) -> tuple[int, int]:
        """Class steps left to either side."""
        return self.where_index, self.settings.where_classes - 1 - self.where_index

    def place(self, position_mm: float, what: int | None = None) -> None:
        """Stands at a position, and before another rod if one is named.

        Raises:
            InputError: The position or the rod is not on the rig.
        """
        settings = self.settings
        if not settings.start_mm <= position_mm <= settings.end_mm:
            raise InputError(
                f"Position {position_mm} mm lies outside the range from {settings.start_mm} to {settings.end_mm} mm."
            )
        if what is not None and not 0 <= what < len(settings.rods):
            raise InputError(f"There is no rod {what}; the rig has {len(settings.rods)}, counted from 0.")
        self.position_mm = float(position_mm)
        self.what = self.what if what is None else what
        self._unsettled = self._settling_taps

    def tap(self) -> NDArray[np.float64]:
        """The samples of one tap, shape (J, K)."""
        position = self.settings.spread([self.position_mm] * (self._unsettled + 1))
        self._unsettled = 0
        return self._stream.tap(position, self.what)[-1]

    def move(self, delta: int) -> int:
        """Moves by `delta` where classes, at most to the end of the range; returns the steps made."""
        steps = clipped_move(delta, self.room)
        self.clamped += steps != delta
        if steps:
            self.place(self.position_mm + steps * self.settings.cell_mm)
        return steps
