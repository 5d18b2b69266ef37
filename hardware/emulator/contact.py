"""Contact of one reading, as in `physics.py`, with the terms that depend on the position alone cached."""

import numpy as np
from numpy.typing import NDArray

from ..simulator.physics import effective_radius_mm, receptive_field
from ..simulator.settings import RigSettings


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
