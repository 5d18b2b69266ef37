"""`plan.toml`: which objects are tapped where, how often and in what order."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta, Struct

from ...models.errors import InputError
from ...models.io.recording import naming
from ...models.io.rig_recording import TapLabel
from ...models.seeds import Purpose, generator
from ..rig.settings import Count, Positive, RangeSettings, parse_settings, read_settings

_ROUNDING = 1e-6
_MOST_POSITIONS = 1_000_000


class _PlanTable(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file: keys that are not known are refused."""


class ObjectSettings(_PlanTable, frozen=True):
    """An object to tap.

    Attributes:
        name: What it is called.
        size_mm: Its size, where that is known of all objects.
    """

    name: Annotated[str, Meta(min_length=1)]
    size_mm: Positive | None = None


class SpacedPositions(_PlanTable, frozen=True):
    """Positions at equal distances, each in the middle of its share of a range.

    Attributes:
        start_mm: Lower end of the range.
        end_mm: Upper end of the range.
        spacing_mm: Distance between neighbours (paper: 0.05 mm over 16 mm).
    """

    start_mm: float
    end_mm: float
    spacing_mm: Positive


class Plan(_PlanTable, frozen=True):
    """The whole file.

    Attributes:
        objects: In the order in which they are tapped.
        positions: Places along x of the rig frame, spaced or as a list in mm.
        taps_per_position: Taps of each object at each position.
        order: `"forward"` taps the positions as they come, `"shuffled"` in an order drawn for each object.
        seed: Of that draw.
        session: Number of the recording session.
        settle_taps: Taps after each change of the object that get no label.
    """

    objects: Annotated[list[ObjectSettings], Meta(min_length=1)]
    positions: SpacedPositions | list[float]
    taps_per_position: Count = 1
    order: Literal["forward", "shuffled"] = "forward"
    seed: Annotated[int, Meta(ge=0)] = 0
    session: Annotated[int, Meta(ge=0)] = 0
    settle_taps: Annotated[int, Meta(ge=0)] = 3

    @property
    def positions_mm(self) -> list[float]:
        """Every position, as the file has them."""
        if isinstance(self.positions, list):
            return self.positions
        spaced = self.positions
        middles = np.arange(_shares(spaced)) + 0.5
        return np.round(spaced.start_mm + spaced.spacing_mm * middles, 6).tolist()

    def taps(self) -> Iterator[TapLabel]:
        """Every tap that is kept, in order; `trial` counts them."""
        trial = 0
        for what in range(len(self.objects)):
            places = np.repeat(self.positions_mm, self.taps_per_position)
            if self.order == "shuffled":
                generator(self.seed, Purpose.ORDER, self.session, what).shuffle(places)
            for where_mm in places.tolist():
                yield TapLabel(trial, what, where_mm, self.session)
                trial += 1

    def check_range(self, limits: RangeSettings) -> None:
        """Whether a rig has a where class for each position.

        Raises:
            InputError: It has not.
        """
        for place in self.positions_mm:
            if not limits.start_mm <= place < limits.end_mm:
                raise InputError(
                    f"positions: {place:g} mm lies outside the where classes of the rig, which cover "
                    f"{limits.start_mm:g} mm up to but not including {limits.end_mm:g} mm."
                )


def load_plan(path: str | Path) -> Plan:
    """The plan in a file.

    Raises:
        InputError: The file is missing or no TOML, a key is unknown, missing or of the wrong kind, or values
            contradict each other; the sentence names file and key.
    """
    text = read_settings(path)
    with naming(path):
        return parse_plan(text)


def parse_plan(text: str) -> Plan:
    """The plan in the text of a file.

    Raises:
        InputError: As `load_plan`.
    """
    plan = parse_settings(text, Plan)
    names = [entry.name for entry in plan.objects]
    if len(set(names)) != len(names):
        raise InputError("objects: two of them have the same name.")
    sizes = [entry.size_mm for entry in plan.objects if entry.size_mm is not None]
    if sizes and len(sizes) != len(names):
        raise InputError("objects: size_mm is given for some of them only; all or none need it.")
    if not all(map(math.isfinite, sizes)):
        raise InputError("objects: size_mm must be finite.")
    if isinstance(plan.positions, SpacedPositions):
        _check_spaced(plan.positions)
    elif not plan.positions or not all(map(math.isfinite, plan.positions)):
        raise InputError("positions: the list must hold at least one number, and only finite ones.")
    return plan


def _check_spaced(spaced: SpacedPositions) -> None:
    for key, value in msgspec.to_builtins(spaced).items():
        if not math.isfinite(value):
            raise InputError(f"positions.{key}: the number must be finite, not {value}.")
    shares = (spaced.end_mm - spaced.start_mm) / spaced.spacing_mm
    if not 0.5 <= shares <= _MOST_POSITIONS or abs(shares - round(shares)) > _ROUNDING * shares:
        raise InputError(
            f"positions: the range must be a whole number of spacings, 1 to {_MOST_POSITIONS}, not {shares:g}."
        )


def _shares(spaced: SpacedPositions) -> int:
    return round((spaced.end_mm - spaced.start_mm) / spaced.spacing_mm)
