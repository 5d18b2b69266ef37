"""Request and results of a reproduction, from which figures, tables and files are made."""

import math
from collections.abc import Iterable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, partial
from threading import Lock
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...inference.engines.engine import make_engine
from ...inference.trials.resampling import USED_UP_SELECTED, Spread, taps_per_class, too_few
from ...models.grid import ClassGrid, can_act
from ...models.splits import Split
from ..experiment.crosscheck import CrossCheck, crosscheck_model
from ..experiment.policies import Outcomes
from ..experiment.settings import ExperimentSettings
from ..experiment.study import Study
from ..page.figure_episodes import BeliefCase
from ..page.figure_style import unit_name
from ..page.labelled import labelled, with_units
from ..page.page import Embedded
from ..page.stages import StageClock
from ..stats import metrics
from ..stats.contacts import summarise
from ..stats.jackknife import shared_training
from ..tasks.beside import NotDone
from .check import Check, check
from .examples import Trajectories, belief_cases, example_episode, trajectories
from .record import ErrorRow, PolicyRow

_QUANTITIES = [name for name in metrics.QUANTITIES for name in (name, f"{name}_low", f"{name}_high")]
_CHANGES = {f"{name}{end}": f"{name}_difference{end}" for name in metrics.QUANTITIES for end in ("", "_low", "_high")}


@dataclass(frozen=True)
class Request:
    """Data and settings of a reproduction.

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
    """Everything that the files are made of; what only the page needs is computed when it is first asked for.

    Attributes:
        request: What was asked for.
        grid: The classes that were told apart.
        left_out: Classes without a training tap, by name.
        studies: One per data set.
        stored: Outcomes with taps drawn with replacement, all data sets.
        fresh: Outcomes with no tap drawn twice, at the shown threshold and those below.
        fixation: The fixation point of the curves.
        clock: Told of every stage.
        begun: The engines compared, as by `check_ahead`.
    """

    request: Request
    grid: ClassGrid
    left_out: tuple[str, ...]
    studies: list[Study]
    stored: Outcomes[xr.Dataset]
    fresh: Outcomes[xr.Dataset]
    fixation: int
    clock: StageClock
    begun: Future[CrossCheck] | None = None
    _one_thread: Lock = field(default_factory=Lock, init=False, repr=False, compare=False)

    @cached_property
    def check(self) -> CrossCheck:
        """The engines compared on the first data set."""
        if self.begun is not None:
            with suppress(NotDone):
                return self.begun.result()
        return check(comparison(self.request, self.studies[0]), self.request.episodes, self.clock)

    @property
    def cases(self) -> tuple[BeliefCase, BeliefCase]:
        """A clear and an ambiguous sequence of beliefs."""
        return self._examples[0]

    @property
    def paths(self) -> Trajectories | None:
        """Example trajectories; `None` where nothing can be acted on."""
        return self._examples[1]

    @property
    def _examples(self) -> tuple[tuple[BeliefCase, BeliefCase], Trajectories | None]:
        with self._one_thread:  # figures that are drawn ahead ask on a thread of their own
            return self._followed

    @cached_property
    def _followed(self) -> tuple[tuple[BeliefCase, BeliefCase], Trajectories | None]:
        settings, first = self.request.settings, self.studies[0]
        with self.clock.stage("Following single episodes", 1):
            engine = make_engine("filter", first.model, settings.play.border)
            cases = belief_cases(first, engine, settings)
            return cases, trajectories(first, settings, self.fixation) if can_act(self.grid) else None

    @cached_property
    def example(self) -> Embedded:
        """An episode to play on the page, with p-values if the model gives them."""
        first, still = self.studies[0], not can_act(self.grid)
        scored = first.model.with_scores(self.request.split.folds[0].train)
        engine = make_engine("filter", scored, self.request.settings.play.border)
        return example_episode(first, engine, self.request.settings, None if still else self.fixation)

    @property
    def elapsed_s(self) -> dict[str, float]:
        """Seconds of every stage, those that only the page needs included."""
        _ = self.check, self._examples
        return self.clock.elapsed_s

    @property
    def spread(self) -> Spread:
        """How resamples of a single data set, or several, turn into intervals, where trials draw stored taps."""
        return self._of_data_sets(self.studies[0].played.spread)

    @property
    def fresh_spread(self) -> Spread:
        """Likewise where no tap is drawn twice."""
        return self._of_data_sets(self.studies[0].played.fresh_spread)

    def _of_data_sets(self, spread: Spread) -> Spread:
        F = len(self.studies)
        if F == 1:
            return spread
        return spread._replace(factor=1.0 if self.request.simulated else shared_training(F))

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


def comparison(request: Request, first: Study) -> Check:
    """The comparison of the engines on the first data set."""
    return partial(
        crosscheck_model,
        first.model,
        first.test,
        train=request.split.folds[0].train,
        settings=request.settings,
        border=request.settings.play.border,
        episodes=request.episodes,
        sequence_taps=request.sequence_taps,
        seed=request.settings.seed,
    )


def _curves(outcomes: Outcomes[xr.Dataset], spread: Spread) -> dict[str, xr.Dataset]:
    curves = {"passive": metrics.over_places(outcomes.passive, spread)}
    if outcomes.active is not None and outcomes.difference is not None:
        curves["active"] = metrics.over_places(outcomes.active, spread)
        slowest = xr.concat([curve["taps"] for curve in curves.values()], "policy").max("policy")
        curves["difference"] = metrics.over_places(outcomes.difference, spread, difference=True, slowest=slowest)
    return curves


def decisions_table(found: Results) -> xr.Dataset:
    """Errors and reaction times of passive and active perception, and their difference, against the threshold."""
    stored, fresh = (_decisions(curves, found.grid) for curves in (found.curves, found.fresh_curves))
    fresh = fresh.rename({name: f"fresh_{name}" for name in fresh.data_vars})
    return stored.merge(fresh, join="outer")


def places_table(found: xr.Dataset, dim: str, grid: ClassGrid) -> xr.Dataset:
    """Errors and reaction times by place, with the places along another dim."""
    return with_units(found.rename(place=dim).drop_attrs(deep=False), _units(grid))


def _decisions(curves: dict[str, xr.Dataset], grid: ClassGrid) -> xr.Dataset:
    units = _units(grid)
    rows = (row for name, curve in curves.items() if name != "difference" for row in curve_rows(name, curve))
    table = labelled(rows, ("policy", "theta"), units)
    if "difference" not in curves:
        return table
    change = labelled(difference_rows(curves["difference"]), ["theta"], units).drop_vars("policy")
    return table.merge(change.rename({name: _CHANGES[str(name)] for name in change.data_vars}))


def _units(grid: ClassGrid) -> dict[str, str]:
    return {"what_error": grid.what_error_unit, "where_error": unit_name(grid.where_unit), "taps": "taps"}


def curve_rows(policy: str, curve: xr.Dataset) -> list[PolicyRow]:
    """A row per threshold with quantities, their intervals and fractions; `None` where a number is missing."""
    names = (*_QUANTITIES, *metrics.FRACTIONS)
    return [PolicyRow(policy=policy, **_at(curve, h, names)) for h in range(curve.sizes["theta"])]


def difference_rows(curve: xr.Dataset | None) -> list[ErrorRow]:
    """Passive minus active, a row per threshold with intervals; none where nothing can be acted on."""
    if curve is None:
        return []
    return [ErrorRow(policy="passive - active", **_at(curve, h, _QUANTITIES)) for h in range(curve.sizes["theta"])]


def _at(curve: xr.Dataset, h: int, names: Iterable[str]) -> dict[str, Any]:
    """The threshold of an index and the numbers there."""
    return {"theta": float(curve["theta"][h])} | {name: finite(curve[name][h]) for name in names}


def finite(value: Any) -> float | None:
    """A number, or `None` where it is missing."""
    return None if not math.isfinite(value) else value if isinstance(value, int) else float(value)
