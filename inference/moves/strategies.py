"""Control strategies by name, for commands and sweeps.

What a strategy needs besides the belief is passed in: outcomes of training taps, or a table learned from them. Test
taps are never used.
"""

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...hardware.stage.leg import trapezoid_time
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ..information import About, TapOutcomes
from ..names import MOVES
from ..reference import Border
from .control import MovePolicy, check_fixation, fixation, passive, random_place, random_step
from .information import informative
from .table import TargetTable, lookup

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
    return grid.where_error(np.arange(grid.L)[:, np.newaxis], np.arange(grid.L))


def _check_positive(name: str, value: float) -> None:
    if not 0 < value < np.inf:
        raise InputError(f"The {name} must be above 0, got {value}.")


_INFORMATION = re.compile(r"info-(what|where|joint)(?:-per-(mm|s))?")
_WITH_NUMBER = ("fixation", "step")
_REACH = 1
_LARGEST = 1000  # largest number in a name


class Strategy(NamedTuple):
    """Parsed name of a strategy.

    Attributes:
        kind: `"passive"`, `"fixation"`, `"random"`, `"step"`, `"info"` or `"table"`.
        number: theta_X of `fixation`, reach of `step`.
        about: Subject of the information.
        per: `"mm"` or `"s"` for information per millimetre or second.
    """

    kind: str
    number: float = 0.0
    about: About = "what"
    per: str = ""

    @property
    def theta_x(self) -> float | None:
        """Threshold for a move to the fixation point, if compiled trials can play the strategy, else `None`."""
        return {"passive": 1.0, "fixation": self.number}.get(self.kind)

    @property
    def aims(self) -> bool:
        """Whether it uses the fixation point."""
        return self.kind == "fixation"

    @property
    def needs_outcomes(self) -> bool:
        """Whether it needs training taps."""
        return self.kind == "info"


def parse_strategy(name: str) -> Strategy:
    """Parses the name of a strategy.

    Raises:
        InputError: The strategy is unknown, or its number out of range.
    """
    if found := _INFORMATION.fullmatch(name):
        about: About = found[1]  # pyright: ignore[reportAssignmentType] - the expression allows nothing else
        return Strategy("info", about=about, per=found[2] or "")
    kind, colon, number = name.partition(":")
    if colon and kind in _WITH_NUMBER:
        return Strategy(kind, _number(name, kind, number))
    if name not in MOVES:
        raise InputError(f"Unknown control strategy {name!r}; choose from {', '.join(MOVES)}.")
    return Strategy(name, _REACH if name == "step" else 0.0)


def make_policy(
    name: str,
    grid: ClassGrid,
    *,
    border: Border = "uniform",
    fixation_index: int | None = None,
    outcomes: TapOutcomes | None = None,
    table: TargetTable | None = None,
) -> MovePolicy:
    """Control strategy by name.

    Args:
        name: One of `names.MOVES`.
        grid: Class grid.
        border: Interpretation of Eq. 9 at the ends of the range, for strategies that look ahead.
        fixation_index: Fixation point of `fixation`; default: the middle.
        outcomes: Training taps as outcomes, see `moves.information.training_outcomes`, for `info-...`.
        table: Learned targets, see `moves.table`, for `table`.

    Raises:
        InputError: The strategy is unknown, or what it needs is missing or has other classes.
    """
    strategy = parse_strategy(name)
    if strategy.kind == "fixation":
        return fixation(check_fixation(fixation_index, grid.L), strategy.number)
    if strategy.kind == "table":
        if table is None:
            raise InputError("Strategy 'table' needs a table of targets.")
        return lookup(table.checked(grid))
    if strategy.needs_outcomes:
        return _looking_ahead(strategy, name, grid, border, outcomes)
    if strategy.kind == "step":
        return random_step(int(strategy.number or 1))
    return passive() if strategy.kind == "passive" else random_place()


def _looking_ahead(
    strategy: Strategy, name: str, grid: ClassGrid, border: Border, outcomes: TapOutcomes | None
) -> MovePolicy:
    if outcomes is None:
        raise InputError(f"Strategy {name!r} needs training taps.")
    if outcomes.possible.shape != grid.shape:
        raise InputError(f"The training taps have {outcomes.possible.shape} classes, the model {grid.shape}.")
    costs = {"mm": way_costs, "s": time_costs}
    return informative(outcomes, strategy.about, border, per=costs[strategy.per](grid) if strategy.per else None)


def _number(name: str, kind: str, text: str) -> float:
    """The number in a name."""
    try:
        number = float(text) if kind == "fixation" else int(text)
    except ValueError:
        number = -1.0
    if kind == "fixation" and not 0 <= number <= 1:
        raise InputError(f"theta_X of a strategy must be between 0 and 1, got {name!r}.")
    if kind != "fixation" and not 1 <= number <= _LARGEST:
        raise InputError(f"The number of a strategy must be an integer from 1 to {_LARGEST}, got {name!r}.")
    return number
