"""Faults of any tactile sensor, whatever its electronics: drift, stuck values, overload, lost readings."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .faults import Switches
from .finger import Finger

OVERLOAD_COUNTS = 400.0
"""Counts of an overloaded taxel: beyond the range of a byte, but not so far that a board reports it broken."""

_DRIFT_COUNTS_PER_S = 1.0


class FaultyFinger:
    """A finger whose readings drift, stick or overload while these faults are on.

    Accumulated drift remains after the fault is switched off.

    Args:
        switches: Faults.
        finger: The finger.
    """

    def __init__(self, switches: Switches, finger: Finger) -> None:
        self._switches = switches
        self._finger = finger
        self._drift = 0.0
        self._last_s: float | None = None
        self._last: NDArray[np.float64] | None = None

    @property
    def taxels(self) -> int:
        """`K`."""
        return self._finger.taxels

    def read(self, time_s: float) -> NDArray[np.float64]:
        """Next reading in counts that rise under load, shape (K,); drift and overload exceed 0 to 255."""
        if self._last is not None and self._switches.strikes("stuck", time_s) is not None:
            return self._last
        counts = self.load(time_s)
        if (fault := self._switches.strikes("overload", time_s)) is not None:
            counts = np.where(masked(fault, self.taxels), OVERLOAD_COUNTS, counts)
        self._last = counts
        return counts

    def load(self, time_s: float) -> NDArray[np.float64]:
        """Next reading without stuck or overloaded values, as a calibrating board sees it; shape (K,)."""
        if self._last_s is not None and (fault := self._switches.strikes("drift", time_s)) is not None:
            self._drift += fault.get("counts_per_s", _DRIFT_COUNTS_PER_S) * (time_s - self._last_s)
        self._last_s = time_s
        return self._finger.read(time_s) + self._drift


class LostReadings:
    """Counts down consecutive lost readings.

    Args:
        switches: Faults.
    """

    def __init__(self, switches: Switches) -> None:
        self._switches = switches
        self._left = 0

    def strikes(self, time_s: float) -> bool:
        """Whether the reading at this time is lost."""
        if self._left == 0 and (fault := self._switches.strikes("lost_frames", time_s)) is not None:
            self._left = int(fault.get("count", 1))
        self._left, lost = max(0, self._left - 1), self._left > 0
        return lost


def masked(fault: dict[str, Any], taxels: int) -> NDArray[np.bool_]:
    """Mask of the taxels that a fault affects: the bits of its `mask`, or all; shape (taxels,)."""
    mask = int(fault.get("mask", -1))
    return np.array([mask >> k & 1 == 1 for k in range(taxels)])
