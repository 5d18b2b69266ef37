"""Cost of a tap and the move before it, for information per millimetre or per second.

A tap itself has a cost: otherwise the value of staying would be infinite.
"""

import re

import numpy as np
from numpy.typing import NDArray

from ...hardware.stage.motion_time import trapezoid_time
from ...models.errors import InputError
from ...models.grid import ClassGrid

TAP_MM = 5.0
"""Distance travelled by the fingertip in a tap: 2.5 mm down and up, as in `docs/examples/rig.toml`."""
TAP_S = 1.0
"""Duration of a tap, as in the paper."""
SPEED_MM_S, ACCELERATION_MM_S2 = 20.0, 500.0
"""Speed and acceleration of the stage in `docs/examples/rig.toml` and of the emulated controller."""


def way_costs(grid: ClassGrid, tap_mm: float = TAP_MM) -> NDArray[np.float64]:
    """Distance in mm of a move between each two positions and the tap after it, shape (L, L).

    Args:
        grid: Class grid.
        tap_mm: Distance travelled in a tap.

    Raises:
        InputError: The positions are not in mm, or `tap_mm` is not above 0.
    """
    _check_positive("distance of a tap", tap_mm)
    return distances_mm(grid) + tap_mm


def time_costs(
    grid: ClassGrid,
    tap_s: float = TAP_S,
    speed_mm_s: float = SPEED_MM_S,
    acceleration_mm_s2: float = ACCELERATION_MM_S2,
) -> NDArray[np.float64]:
    """Duration in seconds of a move between each two positions and the tap after it, shape (L, L).

    Args:
        grid: Class grid.
        tap_s: Duration of a tap.
        speed_mm_s: Speed of moves.
        acceleration_mm_s2: Acceleration and deceleration of moves.

    Raises:
        InputError: The positions are not in mm, or another argument is not above 0.
    """
    named = {"duration of a tap": tap_s, "speed of moves": speed_mm_s, "acceleration of moves": acceleration_mm_s2}
    for name, value in named.items():
        _check_positive(name, value)
    return tap_s + np.array(
        [[trapezoid_time(way, speed_mm_s, acceleration_mm_s2) for way in row] for row in distances_mm(grid).tolist()]
    )


def distances_mm(grid: ClassGrid) -> NDArray[np.float64]:
    """Distance in mm between each two positions, shape (L, L).

    Raises:
        InputError: The positions are not in mm.
    """
    unit = re.split(r"[,(;]", grid.where_unit, maxsplit=1)[0].strip()
    if unit != "mm":
        raise InputError(f"The cost of a move needs positions in mm, but these are in {grid.where_unit!r}.")
    return np.abs(grid.where_value[:, np.newaxis] - grid.where_value)


def _check_positive(name: str, value: float) -> None:
    if not 0 < value < np.inf:
        raise InputError(f"The {name} must be above 0, got {value}.")
