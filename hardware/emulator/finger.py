"""The simulator's fingertip, read one reading at a time at the current position of the stage."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.seeds import Purpose, seed_sequence
from ..simulator.physics import effective_radius_mm, peak_depth_mm, receptive_field
from ..simulator.settings import RigSettings
from ..simulator.signal_chain import SensorNoise, converted, session_nuisances
from .rig_file import CLEARANCE_MM

Place = Callable[[float], tuple[float, float]]
"""Position of the finger in the rig frame at a rig time: x along the finger, y towards the object, in mm."""

_BLOCK = 256  # readings per draw of noise; one draw per reading would dominate the run time


class Finger:
    """A finger, with or without an object in front of it.

    Pressed to `surface_mm + settings.depth_mm`, it is indented as by a tap of the simulator. Position and depth errors,
    which vary from tap to tap there, are redrawn whenever the finger lifts off.

    Args:
        settings: The simulated finger and its objects.
        place: Position of the finger, by time.
        seed: Seed of the data set.
        session: Session that sets gains and mounting.
        what: Index of the first object.
        surface_mm: y of the nearest point of the objects.

    Raises:
        InputError: The object is unknown.
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
        """Index of the object in front of it, or None."""
        return self._what

    @what.setter
    def what(self, what: int | None) -> None:
        if what is not None and not 0 <= what < len(self._settings.rods):
            raise InputError(f"Unknown object {what}; choose 0 to {len(self._settings.rods) - 1}.")
        self._what = what

    def read(self, time_s: float) -> NDArray[np.float64]:
        """Next reading: integer counts from 0 to 255 that rise under load, shape (K,).

        Noise advances with every reading, the foam's lag with time.

        Args:
            time_s: Rig time, not before the last reading.
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
        """Indentation at the nearest point in mm, 0 without contact."""
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
        """Depth of a full press at a position, and the gaps there, in mm."""
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


class Pad:
    """Taxels of a finger facing an object.

    Taxels at the same height on either side read the same and are computed once; those that face sideways read nothing.

    Args:
        settings: The simulated finger and its objects.
    """

    def __init__(self, settings: RigSettings) -> None:
        along, across, self._weight = receptive_field(settings.receptive_field_mm)
        places = [(taxel.along_mm, abs(taxel.lateral_mm)) for taxel in settings.taxels]
        distinct = sorted(set(places))
        self._image = np.array([distinct.index(place) for place in places])
        self._facing = np.array([taxel.facing for taxel in settings.taxels])
        self._along_mm = np.array([place[0] + along for place in distinct])
        self._lateral_gap_mm = np.array([(place[1] + across) ** 2 for place in distinct])
        self._lateral_gap_mm /= 2 * settings.lateral_radius_mm
        self._radius_mm = [effective_radius_mm(settings, rod.diameter_mm) for rod in settings.rods]

    def gap_mm(self, position_mm: float, what: int) -> NDArray[np.float64]:
        """Distance in mm of an object from the nodes of each distinct receptive field when just touching.

        Args:
            position_mm: Position of the object along the finger.
            what: Index of the object.
        """
        return (self._along_mm - position_mm) ** 2 / (2 * self._radius_mm[what]) + self._lateral_gap_mm

    def indentation_mm(self, gap_mm: NDArray[np.float64], depth_mm: float) -> NDArray[np.float64]:
        """Mean indentation of each taxel in mm, shape (K,), from the gaps and the depth of the nearest point."""
        return self._facing * (np.maximum(depth_mm - gap_mm, 0.0) @ self._weight)[self._image]
