"""`plan.toml`: objects, positions, number and order of the taps of a data collection."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from ...models.errors import InputError
from ...models.io.recording import naming
from ...models.io.rig_recording import TapLabel
from ...models.io.toml import parse_settings, read_settings
from ...models.seeds import Purpose, generator
from ..rig.settings import Length, RangeSettings, Width

_ROUNDING = 1e-6
_MOST_POSITIONS = 1_000_000
MOST_TAPS = 10_000_000
"""Taps of a plan; ten million take a third of a year at one per second."""


class _PlanTable(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file; unknown keys are refused."""


class ObjectSettings(_PlanTable, frozen=True):
    """An object to tap.

    Attributes:
        name: Name of the object.
        size_mm: Size of the object, given for all objects or none.
    """

    name: Annotated[str, Meta(min_length=1)]
    size_mm: Width | None = None


class SpacedPositions(_PlanTable, frozen=True):
    """Equally spaced positions, each in the middle of its interval of a range.

    Attributes:
        start_mm: Lower end of the range.
        end_mm: Upper end of the range.
        spacing_mm: Distance between neighbours (paper: 0.05 mm over 16 mm).
    """

    start_mm: Length
    end_mm: Length
    spacing_mm: Width


class Plan(_PlanTable, frozen=True):
    """Plan of a data collection.

    Attributes:
        objects: Objects, in the order in which they are tapped.
        positions: Positions along x of the rig frame, spaced or as a list in mm.
        taps_per_position: Taps of each object at each position.
        order: `"forward"` taps the positions as listed, `"shuffled"` in a random order for each object.
        seed: Random seed of the order.
        session: Number of the recording session.
        settle_taps: Unlabelled taps after each change of object.
    """

    objects: Annotated[list[ObjectSettings], Meta(min_length=1)]
    positions: SpacedPositions | list[Length]
    taps_per_position: Annotated[int, Meta(ge=1, le=MOST_TAPS)] = 1
    order: Literal["forward", "shuffled"] = "forward"
    seed: Annotated[int, Meta(ge=0)] = 0
    session: Annotated[int, Meta(ge=0)] = 0
    settle_taps: Annotated[int, Meta(ge=0, le=1000)] = 3

    @property
    def positions_mm(self) -> list[float]:
        """Positions in mm, in the order of the file."""
        if isinstance(self.positions, list):
            return self.positions
        spaced = self.positions
        middles = np.arange(_shares(spaced)) + 0.5
        return np.round(spaced.start_mm + spaced.spacing_mm * middles, 6).tolist()

    def taps(self) -> Iterator[TapLabel]:
        """Labels of all labelled taps, in order; `trial` counts them."""
        trial = 0
        for what in range(len(self.objects)):
            places = np.repeat(self.positions_mm, self.taps_per_position)
            if self.order == "shuffled":
                generator(self.seed, Purpose.ORDER, self.session, what).shuffle(places)
            for where_mm in places.tolist():
                yield TapLabel(trial, what, where_mm, self.session)
                trial += 1

    def check_range(self, limits: RangeSettings) -> None:
        """Checks that all positions lie in the range of a rig.

        Raises:
            InputError: A position lies outside.
        """
        for place in self.positions_mm:
            if not limits.start_mm <= place < limits.end_mm:
                raise InputError(
                    f"positions: {place:g} mm is outside the range of the rig, "
                    f"{limits.start_mm:g} mm up to but not including {limits.end_mm:g} mm."
                )


def load_plan(path: str | Path) -> Plan:
    """Plan read from a file.

    Raises:
        InputError: The file is missing or not TOML, a key is unknown, missing or of the wrong type, or values
            contradict each other; the message names file and key.
    """
    text = read_settings(path)
    with naming(path):
        return parse_plan(text)


def parse_plan(text: str) -> Plan:
    """Plan read from the text of a file.

    Raises:
        InputError: As `load_plan`.
    """
    plan = parse_settings(text, Plan)
    names = [entry.name for entry in plan.objects]
    if len(set(names)) != len(names):
        raise InputError("objects: two objects have the same name.")
    sizes = [entry.size_mm for entry in plan.objects if entry.size_mm is not None]
    if sizes and len(sizes) != len(names):
        raise InputError("objects: size_mm is given for some objects only; give it for all or none.")
    if isinstance(plan.positions, SpacedPositions):
        _check_spaced(plan.positions)
    elif not plan.positions:
        raise InputError("positions: must list at least one number.")
    taps = len(names) * len(plan.positions_mm) * plan.taps_per_position
    if taps > MOST_TAPS:
        raise InputError(f"taps_per_position: the plan has {taps} taps, at most {MOST_TAPS} are allowed.")
    return plan


def _check_spaced(spaced: SpacedPositions) -> None:
    shares = (spaced.end_mm - spaced.start_mm) / spaced.spacing_mm
    if not 0.5 <= shares <= _MOST_POSITIONS or abs(shares - round(shares)) > _ROUNDING * shares:
        raise InputError(
            f"positions: the range must be a whole number of spacings, 1 to {_MOST_POSITIONS}, got {shares:g}."
        )


def _shares(spaced: SpacedPositions) -> int:
    return round((spaced.end_mm - spaced.start_mm) / spaced.spacing_mm)
