"""What was asked for and what came out: the data that figures, tables and files are made of."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..models.classes import ClassGrid
from ..models.splits import Split
from . import metrics
from .contacts import summarise
from .crosscheck import CrossCheck
from .examples import Trajectories
from .figures import BeliefCase
from .study import Settings, Study


@dataclass(frozen=True)
class Request:
    """What to reproduce.

    Attributes:
        split: The data sets; every fold is one.
        grid: The classes.
        settings: What changes the numbers.
        simulated: Name of the preset, `None` for recorded data.
        command: How it was asked for.
        files: Names of the recorded files.
        episodes: Episodes of the cross-check.
        sequence_taps: Taps of each that are enumerated at once.
    """

    split: Split
    grid: ClassGrid
    settings: Settings
    simulated: str | None = None
    command: str = ""
    files: tuple[str, ...] = ()
    episodes: int = 10
    sequence_taps: int = 20


class Results(NamedTuple):
    """Everything that the files are made of.

    Attributes:
        grid: The classes that were told apart.
        left_out: Classes without a training tap, by name.
        studies: One per data set.
        passive: Outcomes by sensing position, all data sets.
        active: Outcomes by fixation point; `None` where nothing can be acted on.
        fixation: The fixation point of the curves.
        cases: A clear and an ambiguous sequence of beliefs.
        paths: Example trajectories; `None` where nothing can be acted on.
        check: The engines compared.
        elapsed_s: Seconds per stage.
    """

    grid: ClassGrid
    left_out: tuple[str, ...]
    studies: list[Study]
    passive: xr.Dataset
    active: xr.Dataset | None
    fixation: int
    cases: tuple[BeliefCase, BeliefCase]
    paths: Trajectories | None
    check: CrossCheck
    elapsed_s: dict[str, float]

    @property
    def curves(self) -> dict[str, xr.Dataset]:
        """Each policy's errors and reaction time against the threshold, dim theta."""
        curves = {"passive": metrics.over_places(self.passive)}
        if self.active is not None:
            curves["active"] = metrics.at_place(self.active, self.fixation)
        return curves

    @property
    def confusions(self) -> tuple[NDArray[np.int64], NDArray[np.int64] | None]:
        """Confusion counts (M, M) of passive and active trials over all data sets."""
        passive = np.sum([part.passive_confusion for part in self.studies], axis=0)
        active = [part.active_confusion for part in self.studies if part.active_confusion is not None]
        return passive, np.sum(active, axis=0) if active else None

    @property
    def accuracy(self) -> list[dict[str, float | int]]:
        """Accuracy for the numbers of contacts that every data set can answer, one row each."""
        pooled = zip(*(part.accuracy for part in self.studies), strict=False)
        return [summarise(rows) for rows in pooled]

    @property
    def accuracy_dataset(self) -> xr.Dataset:
        """`accuracy` along the dim contacts."""
        rows = self.accuracy
        columns = {name: ("contacts", [row[name] for row in rows]) for name in rows[0] if name != "contacts"}
        return xr.Dataset(columns, {"contacts": [row["contacts"] for row in rows]})
