"""The simulator's fingertip, read one reading at a time wherever the stage holds it."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.seeds import Purpose, seed_sequence
from ..simulator.nuisances import session_nuisances
from ..simulator.physics import peak_depth_mm
from ..simulator.settings import RigSettings
from ..simulator.signal_chain import SensorNoise, converted
from .contact import Pad
from .rig_file import CLEARANCE_MM

Place = Callable[[float], tuple[float, float]]
"""Where the finger stands in the rig frame at a rig time: x along the finger, y rising towards the object, in mm."""

_BLOCK = 256  # readings for which noise is drawn at once, as drawing for each alone takes longer than all the rest


class Finger:
    """A finger with a rod before it, or with nothing.

    Pressed to `surface_mm + settings.depth_mm`, it is indented as by a tap of the simulator. What differs from tap to
    tap there, place and depth, is drawn anew here whenever the finger lifts off.

    Args:
        settings: The simulated finger and its objects.
        place: Where it stands.
        seed: The data set.
        session: Session whose gains and mounting hold.
        what: Index of the rod at first.
        surface_mm: Place in y of the nearest point of the rods.

    Raises:
        InputError: There is no such rod.
    """

    def __init__(
        self,
        settings: RigSettings,
        place: Place,
        seed: int,
        session: int,
        what: int | None = None,
        surface_mm: float = CLEARANCE_MM,
    ) -> None:
        self._settings = settings
        self._place = place
        self._surface_mm = surface_mm
        self._nuisances = session_nuisances(settings, seed, session)
        hand, noise = seed_sequence(seed, Purpose.EMULATED, session).spawn(2)
        self._hand = np.random.default_rng(hand)
        self._noise = SensorNoise(settings, noise)
        self._pad = Pad(settings)
        self._drawn = iter(())
        self._lagged_mm = self._held = self._untouched = np.zeros(self.taxels)
        self._readings = 0
        self._last_s = -math.inf
        self._touching = False
        self._spot: tuple[float, int, float, NDArray[np.float64]] | None = None
        self._wobble()
        self.what = what

    @property
    def taxels(self) -> int:
        """`K`."""
        return len(self._settings.taxels)

    @property
    def what(self) -> int | None:
        """Index of the rod before it, None for nothing."""
        return self._what

    @what.setter
    def what(self, what: int | None) -> None:
        if what is not None and not 0 <= what < len(self._settings.rods):
            raise InputError(f"There is no rod {what}; the finger has {len(self._settings.rods)}, counted from 0.")
        self._what = what

    def read(self, time_s: float) -> NDArray[np.float64]:
        """The next reading: whole counts from 0 to 255 that rise under load, shape (K,).

        Noise goes on with every reading, the foam's lag with time.

        Args:
            time_s: When, in rig time, not before the last reading.
        """
        self._lag(self._indentation_mm(*self._place(time_s)), time_s)
        noise = self._next_noise()
        if self._readings % self._settings.hold_samples == 0:
            self._held = converted(self._settings, self._nuisances, self._lagged_mm, noise)
        self._readings += 1
        return self._held

    def _indentation_mm(self, x_mm: float, y_mm: float) -> NDArray[np.float64]:
        depth_mm = self._depth_mm(x_mm, y_mm)
        if self._touching and depth_mm <= 0.0:
            self._wobble()
        self._touching = depth_mm > 0.0
        if self._spot is None or not self._touching:
            return self._untouched
        return self._pad.indentation_mm(self._spot[-1], depth_mm)

    def _depth_mm(self, x_mm: float, y_mm: float) -> float:
        """Indentation at the nearest point, 0 if nothing is touched."""
        what = self._what
        if what is None:
            return 0.0
        pressed_mm = y_mm - self._surface_mm + float(self._nuisances.mounting_y_mm[what])
        if pressed_mm <= 0.0:
            return 0.0
        if self._spot is None or self._spot[:2] != (x_mm, what):
            self._spot = (x_mm, what, *self._stand(x_mm, what))
        return max(0.0, pressed_mm - self._settings.depth_mm + self._spot[2]) * self._depth_factor

    def _stand(self, x_mm: float, what: int) -> tuple[float, NDArray[np.float64]]:
        """Depth of a full press at a place, and the gaps there."""
        position_mm = x_mm + float(self._nuisances.mounting_x_mm[what]) + self._astray_mm
        peak_mm = peak_depth_mm(self._settings, np.array(position_mm))
        return float(peak_mm), self._pad.gap_mm(position_mm, what)

    def _wobble(self) -> None:
        place, depth = self._hand.standard_normal(2)
        self._astray_mm = self._settings.tap_position_mm * float(place)
        self._depth_factor = math.exp(self._settings.tap_depth_log_sd * depth)
        self._spot = None

    def _lag(self, seen_mm: NDArray[np.float64], time_s: float) -> None:
        past_s = min(max(time_s - self._last_s, 0.0), 1e9)
        keep = math.exp(-past_s / self._settings.lag_s) if self._settings.lag_s else 0.0
        self._lagged_mm = seen_mm + keep * (self._lagged_mm - seen_mm)
        self._last_s = time_s

    def _next_noise(self) -> NDArray[np.float64]:
        noise = next(self._drawn, None)
        if noise is None:
            self._drawn = iter(self._noise.draw(_BLOCK))
            noise = next(self._drawn)
        return noise
