"""What was asked for and what came out: the data that figures, tables and files are made of."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...inference.trials.resampling import USED_UP_SELECTED, Spread, taps_per_class, too_few
from ...models.grid import ClassGrid
from ...models.splits import Split
from ..experiment.crosscheck import CrossCheck
from ..experiment.policies import Outcomes
from ..experiment.settings import ExperimentSettings
from ..experiment.study import Study
from ..stats import metrics
from ..stats.contacts import summarise
from .examples import Trajectories
from .figures import BeliefCase


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
    settings: ExperimentSettings
    simulated: str | None = None
    command: str = ""
    files: tuple[str, ...] = ()
    episodes: int = 10
    sequence_taps: int = 20


@dataclass(frozen=True)
class Results:
    """Everything that the files are made of.

    Attributes:
        grid: The classes that were told apart.
        left_out: Classes without a training tap, by name.
        studies: One per data set.
        stored: Outcomes with taps drawn with replacement, all data sets.
        fresh: Outcomes with no tap drawn twice, at the shown threshold and those below.
        fixation: The fixation point of the curves.
        cases: A clear and an ambiguous sequence of beliefs.
        paths: Example trajectories; `None` where nothing can be acted on.
        check: The engines compared.
        elapsed_s: Seconds per stage.
    """

    grid: ClassGrid
    left_out: tuple[str, ...]
    studies: list[Study]
    stored: Outcomes[xr.Dataset]
    fresh: Outcomes[xr.Dataset]
    fixation: int
    cases: tuple[BeliefCase, BeliefCase]
    paths: Trajectories | None
    check: CrossCheck
    elapsed_s: dict[str, float]

    @property
    def spread(self) -> Spread:
        """How resamples of a single data set turn into intervals, where trials draw stored taps."""
        return self.studies[0].played.spread

    @property
    def fresh_spread(self) -> Spread:
        """Likewise where no tap is drawn twice."""
        return self.studies[0].played.fresh_spread

    @property
    def used_up(self) -> float:
        """Share of the fresh decisions made because all stored taps of a class were drawn, over the data sets.

        That of the policy with more of them.
        """
        return float(self._used_up[0][:, self._shown].max())

    @property
    def few(self) -> str:
        """Whether there are too few test taps, in a sentence; empty where there are enough."""
        pool, how = self.studies[0].table.pool, self.studies[0].played.fresh_spread
        used_up, selected = (shares[:, self._shown] for shares in self._used_up)
        p = int((used_up + selected).argmax())
        shares, decisions = (float(used_up[p]), float(selected[p])), f"{('passive', 'active')[p]} decisions"
        return too_few(taps_per_class(pool), *shares, how.sessions, how.freedom, decisions)

    @property
    def enough(self) -> float | None:
        """The highest threshold at which the test taps suffice, where that is below the one that is shown."""
        thetas = self.fresh.passive["theta"].values
        fine = thetas[np.max(self._used_up, axis=(0, 1)) <= USED_UP_SELECTED]
        return float(fine.max()) if len(fine) and fine.max() < thetas.max() else None

    @property
    def _used_up(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Shares of each policy, and where a quarter of the taps is left out, (policy, thresholds of `fresh`)."""
        played = [part.played for part in self.studies]
        return np.mean([one.used_up for one in played], axis=0), np.mean([one.selected for one in played], axis=0)

    @property
    def _shown(self) -> int:
        return int(self.fresh.passive["theta"].values.argmax())

    @cached_property
    def curves(self) -> dict[str, xr.Dataset]:
        """Each policy's errors and reaction time against the threshold, dim theta, and their difference."""
        return _curves(self.stored, self.spread)

    @cached_property
    def fresh_curves(self) -> dict[str, xr.Dataset]:
        """The same on fresh taps, at the shown threshold and those below."""
        return _curves(self.fresh, self.fresh_spread)

    @cached_property
    def by_position(self) -> xr.Dataset:
        """Passive outcomes with intervals, dims (place, theta)."""
        return metrics.by_place(self.stored.passive, self.spread)

    @cached_property
    def by_fixation(self) -> xr.Dataset | None:
        """Active outcomes with intervals, likewise; `None` where nothing can be acted on."""
        fixations = self.stored.fixations
        return None if fixations is None else metrics.by_place(fixations, self.spread, parts=1)

    @property
    def confusions(self) -> tuple[NDArray[np.int64], NDArray[np.int64] | None]:
        """Confusion counts (M, M) of passive and active trials over all data sets."""
        played = [part.played for part in self.studies]
        passive = np.sum([part.passive_confusion for part in played], axis=0)
        active = [part.active_confusion for part in played if part.active_confusion is not None]
        return passive, np.sum(active, axis=0) if active else None

    @cached_property
    def accuracy(self) -> list[dict[str, float | int]]:
        """Accuracy for the numbers of contacts that every data set can answer, one row each."""
        pooled = zip(*(part.accuracy for part in self.studies), strict=False)
        return [summarise(rows, self.fresh_spread) for rows in pooled]

    @property
    def accuracy_dataset(self) -> xr.Dataset:
        """`accuracy` along the dim contacts."""
        rows = self.accuracy
        columns = {name: ("contacts", [row[name] for row in rows]) for name in rows[0] if name != "contacts"}
        return xr.Dataset(columns, {"contacts": [row["contacts"] for row in rows]})


def _curves(outcomes: Outcomes[xr.Dataset], spread: Spread) -> dict[str, xr.Dataset]:
    curves = {"passive": metrics.over_places(outcomes.passive, spread)}
    if outcomes.active is not None and outcomes.difference is not None:
        curves["active"] = metrics.over_places(outcomes.active, spread)
        slowest = xr.concat([curve["taps"] for curve in curves.values()], "policy").max("policy")
        curves["difference"] = metrics.over_places(outcomes.difference, spread, difference=True, slowest=slowest)
    return curves
